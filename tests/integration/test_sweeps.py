"""Sweeps: failed and killed jobs are reported, do not stop the others, and are repeated by sweep.resume."""

import json
import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import psutil
import pytest

from workbench.recording.read.reader import read
from workbench.utils.errors import InputError
from workbench.utils.run_files import read_summary
from workbench.utils.run_lock import is_locked

TINY = ("dataset.n_frames=2", "inference.n_particles=20", "dataset.width=80", "dataset.height=60")
TINY += ("dataset.person_px=40", "dataset.focal_px=90", "experiment=walk_straight")
LONGER = ("dataset.n_frames=30", "dataset.width=160", "dataset.height=120", "dataset.person_px=80")
LONGER += ("dataset.focal_px=175", "paths.data=null")


@pytest.fixture
def sweep(tmp_path, run):
    """Return a function that runs a sweep in this process and returns exit code, output and the status of each job."""

    def command(*overrides):
        code, output, _ = run("alone", "-m", *overrides)
        return code, output, {job: summary["status"] for job, summary in summaries(tmp_path / "sweep").items()}

    return command


def summaries(folder):
    return {int(path.parent.name): json.loads(path.read_text()) for path in folder.glob("*/summary.json")}


@pytest.mark.slow
def test_a_failed_job_is_reported_and_only_incomplete_jobs_are_repeated(tmp_path, sweep):
    overrides, folder = ("seed=-1,0,1", *TINY), tmp_path / "sweep"
    code, output, status = sweep(*overrides, f"hydra.sweep.dir={folder}")
    assert (code, status) == (1, {0: "failed", 1: "complete", 2: "complete"})
    assert f"{folder / '0'}: InputError: seed: expected a non-negative integer, found -1" in output
    assert "InputError: seed: expected" in (folder / "0" / "run.log").read_text()
    rows = [line.split() for line in output.splitlines()[2:5]]
    assert [(row[0], row[1], row[4], row[-1]) for row in rows] == [
        ("0", "failed", "2", "seed=-1"),
        ("1", "complete", "1", "seed=0"),
        ("2", "complete", "0", "seed=1"),
    ]
    assert not is_locked(folder)
    code, output, _ = sweep(*overrides, f"hydra.sweep.dir={folder}")
    assert code == 2
    assert "sweep.resume=" in output

    before = summaries(folder)
    (folder / "2" / "summary.json").write_text(json.dumps({**before[2], "identity": "of another version"}))
    code, output, status = sweep(*overrides, f"sweep.resume={folder}")
    assert (code, status) == (1, {0: "failed", 1: "complete", 2: "complete"})
    after = summaries(folder)
    assert [job for job in after if after[job]["started"] == before[job]["started"]] == [1]
    assert "1  reused" in output
    assert after[2]["metrics"]["mpjpe_abs_mm"] == before[2]["metrics"]["mpjpe_abs_mm"]


@pytest.mark.slow
def test_a_job_stopped_by_stop_if_is_not_repeated(tmp_path, sweep):
    losing = ("dataset.n_frames=7", *TINY[1:], "body=height", "body.height_m=1.2", "sweep.stop_if=n_track_losses>0")
    folder = tmp_path / "sweep"
    code, output, status = sweep(*losing, f"hydra.sweep.dir={folder}")
    assert (code, status) == (0, {0: "stopped"})
    assert summaries(folder)[0]["stopped"] == "n_track_losses>0 in frame 5"
    recording = read(folder / "0" / "run.rrd")
    assert (recording.status, recording.properties["run"]["stopped"]) == ("stopped", "n_track_losses>0 in frame 5")
    assert recording.poses[0].tolist() == [*range(6)]
    code, output, _ = sweep(*losing, f"sweep.resume={folder}")
    assert code == 0
    assert output.count("  reused  ") == 1
    code, _, status = sweep(*losing[:-1], f"sweep.resume={folder}")  # without stop_if
    assert (code, status) == (0, {0: "complete"})


@pytest.mark.slow
def test_an_extended_sweep_runs_only_its_new_jobs(tmp_path, sweep):
    """With two keys the numbers of the jobs change: (20, 30) × (0,) becomes (20, 30) × (0, 1)."""
    folder, other = tmp_path / "sweep", tmp_path / "other"
    few, more = (("inference.n_particles=20,30", f"seed={seeds}", *TINY[:1], *TINY[2:]) for seeds in ("0", "0,1"))
    assert sweep(*few, f"hydra.sweep.dir={folder}")[0] == 0
    before = {summary["identity"]: summary["started"] for summary in summaries(folder).values()}
    assert sweep(*more, f"sweep.resume={folder}")[0] == 0
    after = summaries(folder)
    extended = {summary["identity"]: summary["started"] for summary in after.values()}
    assert len(extended) == len(after) == 4
    assert {identity: extended[identity] for identity in before} == before
    assert [(after[job]["settings"]["inference"]["n_particles"], after[job]["seed"]) for job in range(4)] == [
        (n, seed) for n in (20, 30) for seed in (0, 1)
    ]
    assert not (folder / ".aside").exists() or not list((folder / ".aside").iterdir())
    for job in range(4):
        assert read(folder / str(job) / "run.rrd").provenance["identity"] == after[job]["identity"]

    code, output, _ = sweep(*few, f"hydra.sweep.dir={other}", f"sweep.reuse={folder}")
    assert code == 0
    assert output.count("  reused  ") == 2
    assert os.stat(other / "1" / "run.rrd").st_ino == os.stat(folder / "2" / "run.rrd").st_ino

    code, output, _ = sweep("inference.n_particles=30", "seed=1", *TINY[:1], *TINY[2:], f"sweep.resume={folder}")
    assert code == 0
    assert read_summary(folder / "0")["taken_from"] == str(folder / "3")
    assert "1 complete runs of other configurations were moved" in output


@pytest.mark.slow
def test_a_job_of_a_sweep_is_bitwise_identical_to_a_single_run(tmp_path, run, sweep):
    """The process has run a job with another prior before."""
    code, _, _ = sweep("prior=smooth,walking", "seed=3", *TINY, f"hydra.sweep.dir={tmp_path / 'sweep'}")
    assert code == 0
    code, _, single = run("single", "seed=3", *TINY)
    assert code == 0
    job, alone = (read(folder / "run.rrd") for folder in (tmp_path / "sweep" / "1", single))
    np.testing.assert_array_equal(job.poses[1], alone.poses[1])
    assert job.config == alone.config
    assert summaries(tmp_path / "sweep")[1]["identity"] == read_summary(single)["identity"]


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["hydra.sweep.subdir=${seed}"], "hydra.sweep.subdir"),
        (["sweep.resume=no_such_sweep"], "no_such_sweep"),
        (["sweep.job_ids=[2]"], "expected numbers below 2"),
        (["sweep.stop_if=often"], "sweep.stop_if"),
        (["inference.n_particle=3"], "n_particle"),
    ],
)
def test_an_invalid_sweep_is_refused(sweep, overrides, message):
    code, output, status = sweep("seed=0,1", *overrides)
    assert code == 2
    assert message in output.strip().splitlines()[-1]
    assert not status
    assert "Traceback" not in output


def wait_for(condition, process, seconds=600.0):
    """Return the first true value of `condition()`; fail when the process ends or the time is up before."""
    end = time.monotonic() + seconds
    while not (value := condition()):
        assert process.poll() is None
        assert time.monotonic() < end
        time.sleep(0.1)
    return value


MANY = ("experiment=walk_straight", "prior=smooth", "inference.n_particles=500", "seed=range(3)", *LONGER)
JOBLIB = ("hydra/launcher=joblib", "hydra.launcher.n_jobs=2")
ORPHANS_S = 5.0
"""Longest life of the workers of a killed sweep."""


def start(overrides, cache, sweep):
    """Start a sweep in a subprocess with a session of its own, whose output goes to output.txt."""
    command = [sys.executable, "-m", "workbench", "run", "-m", *overrides, f"hydra.sweep.dir={sweep}"]
    environment = {**os.environ, "WORKBENCH_CACHE": str(cache)}
    with sweep.with_name("output.txt").open("w") as out:
        return subprocess.Popen(
            command, cwd=sweep.parent, env=environment, stdout=out, stderr=subprocess.STDOUT, start_new_session=True
        )


@pytest.mark.slow
def test_a_killed_worker_of_joblib_ends_the_sweep_which_is_resumed(tmp_path, cache, sweep):
    """joblib ends all its workers when one is killed."""
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    folder = tmp_path / "sweep"
    with start([*JOBLIB, *MANY], cache, folder) as process:
        job, worker = wait_for(lambda: running_job(folder), process)
        os.kill(worker, signal.SIGKILL)
    output = (tmp_path / "output.txt").read_text()
    assert process.returncode == 1, output
    assert "workbench: the launcher was terminated: TerminatedWorkerError" in output
    assert f"{folder / str(job)}: killed" in output
    assert f"sweep.resume={folder}" in output
    before = summaries(folder)
    assert sweep(*MANY, f"sweep.resume={folder}")[0] == 0
    after = summaries(folder)
    repeated = {job for job in before if after[job]["started"] != before[job]["started"]}
    assert repeated == {job for job in before if before[job]["status"] == "running"}
    assert [after[job]["status"] for job in sorted(after)] == ["complete"] * 3


@pytest.mark.slow
def test_no_worker_outlives_a_killed_sweep(tmp_path, cache):
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    folder = tmp_path / "sweep"
    with start([*JOBLIB, *MANY], cache, folder) as process:
        wait_for(lambda: running_job(folder), process)
        workers = psutil.Process(process.pid).children(recursive=True)
        process.kill()
    assert not psutil.wait_procs(workers, ORPHANS_S)[1], (tmp_path / "output.txt").read_text()
    for job, summary in summaries(folder).items():
        assert (folder / str(job) / "run.rrd").is_file() == (summary["status"] == "complete")


@pytest.mark.slow
@pytest.mark.parametrize(("launcher", "whole_group"), [(JOBLIB, False), ((), True)])
def test_a_sweep_is_interrupted_and_its_jobs_are_repeated(tmp_path, cache, run, trusted, launcher, whole_group):
    """SIGTERM is sent to the main process, as by a service manager; SIGINT to its workers, too, as in a terminal."""
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    sweep, n_frames = tmp_path / "sweep", 300
    overrides = ("experiment=walk_straight", "prior=smooth", "inference.n_particles=500")
    overrides += (f"dataset.n_frames={n_frames}", *LONGER[1:], "n_threads=1")
    number = signal.SIGINT if whole_group else signal.SIGTERM
    with start([*launcher, *overrides, "seed=range(4)"], cache, sweep) as process:
        job = wait_for(lambda: next((str(k) for k in range(4) if has_recorded(sweep / str(k))), ""), process)
        workers = [worker_of(sweep, k) for k in range(4) if is_locked(sweep / str(k))]
        (os.killpg if whole_group else os.kill)(process.pid, number)
        sent = time.monotonic()
    output = sweep.with_name("output.txt").read_text()
    assert process.returncode == 128 + number, output
    assert time.monotonic() - sent < 30.0
    assert "Traceback" not in output
    assert not any(is_running(worker) for worker in workers)
    interrupted = summaries(sweep)
    assert interrupted[int(job)]["status"] == "interrupted"
    assert interrupted[int(job)]["error"] == f"Interrupted: {number.name}"
    assert {summary["status"] for summary in interrupted.values()} <= {"interrupted", "complete"}
    assert f"{sweep / job}: interrupted by {number.name}" in output
    assert all(f"{sweep / str(k)}: never begun" in output for k in range(4) if k not in interrupted)
    assert f"sweep.resume={sweep}" in output
    if whole_group:
        return

    resumed = run("resumed", "-m", *overrides, "seed=range(4)", f"sweep.resume={sweep}", f"sweep.job_ids=[{job}]")
    assert resumed.code == 0, resumed.err
    assert not (sweep / job / "run.rrd.part").exists()
    assert read_summary(sweep / job)["status"] == "complete"
    assert read(sweep / job / "run.rrd").poses[0].tolist() == [*range(n_frames)]


def running_job(sweep):
    """Return a job that runs and its process, or None."""
    return next(((job, worker) for job in range(3) if (worker := worker_of(sweep, job)) is not None), None)


def is_running(pid):
    """Return whether a process has not ended."""
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def has_recorded(folder):
    """Return whether a frame of a run is on the disk."""
    try:
        return bool(len(read(folder / "run.rrd.part").poses[0]))
    except InputError:  # does not exist, or is being written
        return False


def worker_of(sweep, job):
    """Return the process that runs a job, or None."""
    if (read_summary(sweep / str(job)) or {}).get("status") != "running" or not is_locked(sweep / str(job)):
        return None
    return int(re.search(r"process (\d+)", (sweep / str(job) / ".lock").read_text())[1])
