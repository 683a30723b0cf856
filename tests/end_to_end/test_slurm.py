"""A sweep over a real Slurm without accounting: jobs bound to cores, one killed and run again."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from slurm_cluster import SlurmError, cluster, slurm

from workbench.utils.run_files import read_summary
from workbench.utils.run_lock import is_locked

N_JOBS = 4
JOBS = (
    "experiment=walk_straight", "paths.data=null", f"seed=range({N_JOBS})", "dataset.n_frames=40",
    "inference.n_particles=3000", "dataset.width=160", "dataset.height=120", "dataset.person_px=80",
    "dataset.focal_px=175",
)  # fmt: skip
LAUNCHER = ("hydra/launcher=submitit_slurm", "hydra.launcher.cpus_per_task=1", "hydra.launcher.timeout_min=20")
PATIENCE_S = 600.0


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
def test_a_sweep_over_slurm_is_completed_after_a_job_was_killed(tmp_path, environment):
    """Without accounting submitit waits for a killed job until it is interrupted itself."""
    sweep, output = tmp_path / "sweep", tmp_path / "output.txt"
    environment = {**environment, "WORKBENCH_CACHE": str(tmp_path / "cache")}
    environment.pop("NUMBA_NUM_THREADS", None)  # the cores that Slurm binds a job to say how many
    command = [sys.executable, "-m", "workbench", "run", "-m", *LAUNCHER, *JOBS]
    with output.open("w") as out, subprocess.Popen(
        [*command, f"hydra.sweep.dir={sweep}"], cwd=tmp_path, env=environment, stdout=out, stderr=subprocess.STDOUT
    ) as process:  # fmt: skip
        wait_for(lambda: (sweep / "0" / "run.rrd.part").is_file() and is_locked(sweep / "0"), output)
        assert len(os.sched_getaffinity(process_of(sweep / "0"))) == 1
        os.kill(process_of(sweep / "0"), signal.SIGKILL)  # as the kernel does when it is out of memory
        wait_for(lambda: not slurm(environment, "squeue", "--noheader").strip(), output)
        process.send_signal(signal.SIGINT)
    words = output.read_text()
    assert process.returncode == 128 + signal.SIGINT, words
    assert f"1 of {N_JOBS} jobs are not complete" in words
    assert f"{sweep / '0'}: killed" in words
    assert (sweep / "0" / "run.rrd.part").is_file()

    before = [read_summary(sweep / str(job))["started"] for job in range(N_JOBS)]
    done = subprocess.run([*command, f"sweep.resume={sweep}"], cwd=tmp_path, env=environment, check=False)
    assert done.returncode == 0
    after = [read_summary(sweep / str(job)) for job in range(N_JOBS)]
    assert [each["started"] == started for each, started in zip(after, before, strict=True)] == [
        False,
        True,
        True,
        True,
    ]
    assert all(each["status"] == "complete" for each in after)


def wait_for(what, output):
    end = time.monotonic() + PATIENCE_S
    while not what():
        assert time.monotonic() < end, output.read_text()
        time.sleep(0.1)


def process_of(folder: Path) -> int:
    """The process that works in a folder."""
    return int(re.search(r"process (\d+)", (folder / ".lock").read_text())[1])
