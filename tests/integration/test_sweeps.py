"""Sweeps: jobs that fail or are killed do not stop the others, are named, and are completed by sweep.resume."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from types import SimpleNamespace

import numpy as np
import psutil
import pytest

from workbench.recording.read.partial_run import checkpoint_frames
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
    """Run the command in this process over a sweep: (exit code, what it printed, the status of every job)."""

    def command(*overrides):
        code, told, _ = run("alone", "-m", *overrides)
        return code, told, {job: summary["status"] for job, summary in summaries(tmp_path / "sweep").items()}

    return command


def summaries(folder):
    return {int(each.parent.name): json.loads(each.read_text()) for each in folder.glob("*/summary.json")}


@pytest.mark.slow
def test_a_failed_job_is_named_and_only_what_is_not_complete_is_run_again(tmp_path, sweep):
    same, folder = ("seed=-1,0,1", *TINY), tmp_path / "sweep"
    code, told, status = sweep(*same, f"hydra.sweep.dir={folder}")
    assert (code, status) == (1, {0: "failed", 1: "complete", 2: "complete"})
    assert f"{folder / '0'}: InputError: seed: expected a non-negative integer, found -1" in told
    assert "InputError: seed: expected" in (folder / "0" / "run.log").read_text()
    rows = [line.split() for line in told.splitlines() if line.endswith(("seed=-1", "seed=0", "seed=1"))]
    assert [(row[0], row[1], row[4], row[-1]) for row in rows] == [
        ("0", "failed", "2", "seed=-1"),
        ("1", "complete", "1", "seed=0"),
        ("2", "complete", "0", "seed=1"),
    ]
    assert told.splitlines()[2:5] == [
        line for line in told.splitlines() if line.endswith(("seed=-1", "seed=0", "seed=1"))
    ]
    assert not is_locked(folder)
    code, told, _ = sweep(*same, f"hydra.sweep.dir={folder}")
    assert code == 2
    assert "sweep.resume=" in told

    before = summaries(folder)
    (folder / "2" / "summary.json").write_text(json.dumps({**before[2], "identity": "of older code"}))
    code, told, status = sweep(*same, f"sweep.resume={folder}")
    assert (code, status) == (1, {0: "failed", 1: "complete", 2: "complete"})
    after = summaries(folder)
    assert [job for job in after if after[job]["started"] == before[job]["started"]] == [1]
    assert "1  reused" in told
    assert after[2]["metrics"]["mpjpe_abs_mm"] == before[2]["metrics"]["mpjpe_abs_mm"]


@pytest.mark.slow
def test_a_run_that_is_lost_ends_early_and_counts_as_ended(tmp_path, sweep):
    lost = ("dataset.n_frames=7", *TINY[1:], "body=height", "body.height_m=1.2", "sweep.stop_if=n_track_losses>0")
    folder = tmp_path / "sweep"
    code, told, status = sweep(*lost, f"hydra.sweep.dir={folder}")
    assert (code, status) == (0, {0: "stopped"})
    assert summaries(folder)[0]["stopped"] == "n_track_losses>0 in frame 5"
    recorded = read(folder / "0" / "run.rrd")
    assert (recorded.status, recorded.properties["run"]["stopped"]) == ("stopped", "n_track_losses>0 in frame 5")
    assert recorded.poses[0].tolist() == [*range(6)]
    code, told, _ = sweep(*lost, f"sweep.resume={folder}")
    assert code == 0
    assert told.count("  reused  ") == 1
    code, _, status = sweep(*lost[:-1], f"sweep.resume={folder}")  # nothing stops it now
    assert (code, status) == (0, {0: "complete"})


@pytest.mark.slow
def test_a_grown_sweep_runs_only_what_is_new(tmp_path, sweep):
    """Of two keys, so that the jobs' numbers change: (20, 30) × (0,) becomes (20, 30) × (0, 1)."""
    folder, other = tmp_path / "sweep", tmp_path / "other"
    few, more = (("inference.n_particles=20,30", f"seed={seeds}", *TINY[:1], *TINY[2:]) for seeds in ("0", "0,1"))
    assert sweep(*few, f"hydra.sweep.dir={folder}")[0] == 0
    before = {summary["identity"]: summary["started"] for summary in summaries(folder).values()}
    assert sweep(*more, f"sweep.resume={folder}")[0] == 0
    after = summaries(folder)
    grown = {summary["identity"]: summary["started"] for summary in after.values()}
    assert len(grown) == len(after) == 4
    assert {identity: grown[identity] for identity in before} == before  # what was there was not run again
    assert [(after[job]["settings"]["inference"]["n_particles"], after[job]["seed"]) for job in range(4)] == [
        (n, seed) for n in (20, 30) for seed in (0, 1)
    ]
    assert not (folder / ".aside").exists() or not list((folder / ".aside").iterdir())
    for job in range(4):
        assert read(folder / str(job) / "run.rrd").provenance["identity"] == after[job]["identity"]

    code, told, _ = sweep(*few, f"hydra.sweep.dir={other}", f"sweep.reuse={folder}")
    assert code == 0
    assert told.count("  reused  ") == 2
    assert os.stat(other / "1" / "run.rrd").st_ino == os.stat(folder / "2" / "run.rrd").st_ino

    code, told, _ = sweep("inference.n_particles=30", "seed=1", *TINY[:1], *TINY[2:], f"sweep.resume={folder}")
    assert code == 0
    assert read_summary(folder / "0")["taken_from"] == str(folder / "3")
    assert "1 complete runs of other configurations were moved" in told


@pytest.mark.slow
def test_a_job_of_a_sweep_is_the_same_run_as_alone(tmp_path, run, sweep):
    """Also where its process has run jobs with other components before."""
    code, _, _ = sweep("prior=smooth,walking", "seed=3", *TINY, f"hydra.sweep.dir={tmp_path / 'sweep'}")
    assert code == 0
    code, _, alone_folder = run("alone", "seed=3", *TINY)
    assert code == 0
    recorded = [read(folder / "run.rrd") for folder in (tmp_path / "sweep" / "1", alone_folder)]
    np.testing.assert_array_equal(*(each.poses[1] for each in recorded))
    assert recorded[0].config == recorded[1].config
    assert summaries(tmp_path / "sweep")[1]["identity"] == read_summary(alone_folder)["identity"]


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["hydra.sweep.subdir=${seed}"], "hydra.sweep.subdir"),
        (["sweep.resume=no_such_sweep"], "no_such_sweep"),
        (["sweep.job_ids=[2]"], "expected numbers below 2"),
        (["sweep.stop_if=often"], "sweep.stop_if"),
        (["inference.n_particle=3"], "n_particle"),
    ],
)
def test_a_sweep_that_cannot_start_says_why_in_one_sentence(tmp_path, sweep, overrides, words):
    code, told, status = sweep("seed=0,1", *overrides)
    assert code == 2
    assert words in told.strip().splitlines()[-1]
    assert not status
    assert "Traceback" not in told


def wait_for(what, going_on, seconds=600.0):
    """What `what` returns once it is true; fails when the work ends, or the time is up, before."""
    end = time.monotonic() + seconds
    while not (found := what()):
        assert going_on(), "it ended before it could be looked at"
        assert time.monotonic() < end
        time.sleep(0.02)
    return found


MANY = ("experiment=walk_straight", "prior=smooth", "inference.n_particles=2000", "seed=range(4)", *LONGER)
JOBLIB = ("hydra/launcher=joblib", "hydra.launcher.n_jobs=2")


def started(overrides, cache, sweep):
    """Start a sweep as a process of its own, in a session of its own, whose output goes to output.txt."""
    command = [sys.executable, "-m", "workbench", "run", "-m", *overrides, f"hydra.sweep.dir={sweep}"]
    environment = {**os.environ, "WORKBENCH_CACHE": str(cache)}
    with sweep.with_name("output.txt").open("w") as out:
        return subprocess.Popen(
            command, cwd=sweep.parent, env=environment, stdout=out, stderr=subprocess.STDOUT, start_new_session=True
        )


@pytest.mark.slow
def test_a_killed_worker_of_joblib_costs_the_jobs_at_work_and_no_others(tmp_path, cache, sweep):
    """joblib ends all its workers with the one that was killed."""
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    folder = tmp_path / "sweep"
    with started([*JOBLIB, *MANY], cache, folder) as process:
        worker = wait_for(lambda: at_work(folder, 2), lambda: process.poll() is None)
        os.kill(worker, signal.SIGKILL)
    told = (tmp_path / "output.txt").read_text()
    assert process.returncode == 1, told
    assert "workbench: the launcher was terminated: TerminatedWorkerError" in told
    assert f"{folder / '2'}: killed" in told
    before = summaries(folder)
    ends = Counter(summary["status"] for summary in before.values())
    assert sum(ends.values()) == 4
    assert 1 <= ends["running"] <= 2
    assert sweep(*MANY, f"sweep.resume={folder}")[0] == 0
    after = summaries(folder)
    again = {job for job in after if after[job]["started"] != before[job]["started"]}
    assert again == {job for job in before if before[job]["status"] == "running"}
    assert all(summary["status"] == "complete" for summary in after.values())


@pytest.mark.slow
@pytest.mark.parametrize(("launcher", "whole_group"), [(JOBLIB, False), ((), True)])
def test_a_sweep_that_is_asked_to_end_keeps_what_was_recorded_and_resumes_it(
    tmp_path, cache, run, trusted, launcher, whole_group
):
    """SIGTERM reaches the main process alone, as from a service manager; SIGINT its workers, too, as in a terminal."""
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    sweep, n_frames = tmp_path / "sweep", 800
    same = ("experiment=walk_straight", "prior=smooth", "inference.n_particles=500", "recorder.checkpoints=true")
    same += (f"dataset.n_frames={n_frames}", *LONGER[1:], "n_threads=1")
    number = signal.SIGINT if whole_group else signal.SIGTERM
    with started([*launcher, *same, "seed=range(4)"], cache, sweep) as process:
        job = wait_for(
            lambda: next((str(k) for k in range(4) if goes_on(sweep / str(k))), ""), lambda: process.poll() is None
        )
        workers = [at_work(sweep, k) for k in range(4) if is_locked(sweep / str(k))]
        (os.killpg if whole_group else os.kill)(process.pid, number)
        asked = time.monotonic()
    told = sweep.with_name("output.txt").read_text()
    assert process.returncode == 128 + number, told
    assert time.monotonic() - asked < 30.0
    assert "Traceback" not in told
    assert not any(is_there(worker) for worker in workers)
    ended = summaries(sweep)
    assert (ended[int(job)]["status"], ended[int(job)]["error"]) == ("interrupted", f"Interrupted: {number.name}")
    assert {summary["status"] for summary in ended.values()} <= {"interrupted", "complete"}
    assert f"{sweep / job}: interrupted by {number.name}" in told
    assert all(f"{sweep / str(k)}: never begun" in told for k in range(4) if k not in ended)
    assert f"sweep.resume={sweep}" in told
    if whole_group:
        return

    again = run("again", "-m", *same, "seed=range(4)", f"sweep.resume={sweep}", f"sweep.job_ids=[{job}]")
    assert again.code == 0, again.err
    assert "(resumed at frame" in again.out
    assert not (sweep / job / ".earlier").exists()
    whole = run("whole", *same, f"seed={job}")
    assert whole.code == 0, whole.err
    recorded = [read(folder / "run.rrd") for folder in (whole.folder, sweep / job)]
    assert [len(each.poses[0]) for each in recorded] == [n_frames, n_frames]
    for name, curve in recorded[0].scalars.items():
        np.testing.assert_array_equal(curve.values, recorded[1].scalars[name].values, name)
    assert dict(recorded[0].result) == dict(recorded[1].result)


def is_there(pid):
    """Whether a process has not ended."""
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def goes_on(folder):
    """Whether a checkpoint of a run has reached the disk."""
    try:
        return bool(checkpoint_frames(SimpleNamespace(path=folder / "run.rrd.part")))
    except InputError:  # not there, or just being written
        return False


def at_work(sweep, job):
    """The process that runs a job; None when none does."""
    if (read_summary(sweep / str(job)) or {}).get("status") != "running" or not is_locked(sweep / str(job)):
        return None
    return int(re.search(r"process (\d+)", (sweep / str(job) / ".lock").read_text())[1])
