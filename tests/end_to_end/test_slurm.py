"""A sweep over a real Slurm without accounting: jobs bound to cores, ended in three ways, and run again."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from slurm_cluster import SlurmError, cluster, slurm

from workbench.sweep.job import read_summary

N_JOBS = 6
JOBS = (
    "experiment=walk_straight", "paths.data=null", f"seed=range({N_JOBS})", "dataset.n_frames=40",
    "inference.n_particles=3000", "dataset.width=160", "dataset.height=120", "dataset.person_px=80",
    "dataset.focal_px=175",
)  # fmt: skip
# With more than ten minutes submitit takes a job whose time is up early for one that may run again.
LAUNCHER = ("hydra/launcher=submitit_slurm", "hydra.launcher.cpus_per_task=1", "hydra.launcher.timeout_min=10",
            "hydra.launcher.signal_delay_s=1")  # fmt: skip
PATIENCE_S = 1800.0


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """In which Slurm's commands reach a cluster on this machine."""
    pytest.importorskip("hydra_plugins.hydra_submitit_launcher")
    try:
        with cluster(tmp_path_factory.mktemp("slurm")) as found:
            yield found
    except SlurmError as reason:
        pytest.skip(f"no Slurm: {reason}")


@pytest.mark.slow
def test_a_sweep_over_slurm_ends_by_itself_names_what_was_ended_and_is_completed(tmp_path, environment):
    sweep, told = tmp_path / "sweep", tmp_path / "told.txt"
    environment = {**environment, "WORKBENCH_CACHE": str(tmp_path / "cache")}
    environment.pop("NUMBA_NUM_THREADS", None)  # the cores that Slurm binds a job to say how many
    command = [sys.executable, "-m", "workbench", "-m", *LAUNCHER, *JOBS]
    ends = {0: over_its_time, 1: killed, 2: cancelled}
    cores = {}
    with told.open("w") as out, subprocess.Popen(
        [*command, f"hydra.sweep.dir={sweep}"], cwd=tmp_path, env=environment, stdout=out, stderr=subprocess.STDOUT
    ) as process:  # fmt: skip
        deadline = time.monotonic() + PATIENCE_S
        while process.poll() is None:
            assert time.monotonic() < deadline, told.read_text()
            for job, pid in running(sweep):
                cores.setdefault(job, allowed_cores(pid))
                if end := ends.pop(job, None):
                    end(environment, f"{array_of(environment)}_{job}", pid)
            time.sleep(0.05)
    words = told.read_text()
    assert process.returncode == 1, words
    assert "Slurm's job" in words
    assert "3 of 6 jobs are not complete" in words
    assert f"{sweep / '0'}: interrupted by SIG" in words
    assert f"{sweep / '1'}: cut off" in words
    assert f"{sweep / '2'}: interrupted by SIGTERM" in words
    assert all((sweep / str(job) / "run.rrd.part").is_file() for job in range(3))
    assert set(map(len, cores.values())) == {1}
    assert os.cpu_count() == 1 or cores[0].isdisjoint(cores[1] | cores[2])  # which ran beside it

    before = starts(sweep)
    done = subprocess.run([*command, f"sweep.resume={sweep}"], cwd=tmp_path, env=environment, check=False)
    assert done.returncode == 0
    after = starts(sweep)
    assert {job for job in after if after[job] != before[job]} == {0, 1, 2}
    assert all(read_summary(sweep / str(job))["status"] == "complete" for job in range(N_JOBS))


def over_its_time(environment, job, pid):
    """The job hangs, and its time is up soon."""
    os.kill(pid, signal.SIGSTOP)
    slurm(environment, "scontrol", "update", f"JobId={job}", "EndTime=now+10")


def killed(environment, job, pid):
    """As by the kernel that is out of memory; stopped, so that it does not see that its parent has gone."""
    os.kill(pid, signal.SIGSTOP)
    os.kill(int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1]), signal.SIGKILL)
    os.kill(pid, signal.SIGKILL)


def cancelled(environment, job, pid):
    slurm(environment, "scancel", job)


def running(sweep):
    """The jobs that run and have begun to record, each with its process."""
    begun = [job for job in range(N_JOBS) if (sweep / str(job) / "run.rrd.part").is_file()]
    found = ((job, read_summary(sweep / str(job)) or {}) for job in begun)
    return [(job, summary["pid"]) for job, summary in found if summary.get("status") == "running"]


def allowed_cores(pid):
    try:
        return set(os.sched_getaffinity(pid))
    except ProcessLookupError:  # it has just ended
        return {None}


def array_of(environment):
    """The number of the array of jobs that is there."""
    return slurm(environment, "squeue", "--noheader", "--format=%F").split()[0]


def starts(sweep):
    return {int(each.parent.name): json.loads(each.read_text())["started"] for each in sweep.glob("*/summary.json")}
