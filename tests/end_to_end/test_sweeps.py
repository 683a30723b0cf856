"""Sweeps: jobs apart from each other, named when they fail, taken up where they were left."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections import Counter

import numpy as np
import psutil
import pytest
from hydra import compose, initialize_config_module
from omegaconf import OmegaConf

from workbench.errors import InputError
from workbench.experiment.schema import prepare_hydra
from workbench.recording.read.earlier import earlier
from workbench.recording.read.reader import read
from workbench.sweep import plan
from workbench.sweep.job import alone, read_summary, run_apart

TINY = ("dataset.n_frames=2", "inference.n_particles=20", "dataset.width=80", "dataset.height=60")
TINY += ("dataset.person_px=40", "dataset.focal_px=90")
LONGER = ("dataset.n_frames=30", "dataset.width=160", "dataset.height=120", "dataset.person_px=80")
LONGER += ("dataset.focal_px=175", "paths.data=null")


@pytest.fixture
def sweep(tmp_path, monkeypatch, run):
    """Run the command in this process over a sweep: (exit code, what it told, the status of every job)."""

    def command(*overrides):
        code, told, _ = run("alone", "-m", *overrides)
        return code, told, {job: summary["status"] for job, summary in summaries(tmp_path / "sweep").items()}

    return command


def summaries(folder):
    return {int(each.parent.name): json.loads(each.read_text()) for each in folder.glob("*/summary.json")}


def test_a_failed_job_is_named_and_only_what_is_not_complete_is_run_again(tmp_path, sweep):
    same, folder = ("seed=-1,0,1", *TINY), tmp_path / "sweep"
    code, told, status = sweep(*same, f"hydra.sweep.dir={folder}")
    assert (code, status) == (1, {0: "failed", 1: "complete", 2: "complete"})
    assert f"{folder / '0'}: InputError: seed must be zero or a positive whole number, found -1" in told
    pids = [summary["pid"] for _, summary in sorted(summaries(folder).items())]
    assert pids[1] == pids[2] != pids[0]  # after a job that ended well the process takes the next
    rows = [line.split() for line in told.splitlines() if line.endswith(("seed=-1", "seed=0", "seed=1"))]
    assert [(row[0], row[1], row[4], row[-1]) for row in rows] == [
        ("0", "failed", "2", "seed=-1"),
        ("1", "complete", "1", "seed=0"),
        ("2", "complete", "0", "seed=1"),
    ]
    code, told, _ = sweep(*same, f"hydra.sweep.dir={folder}")
    assert code == 2
    assert "sweep.resume=" in told

    before = summaries(folder)
    (folder / "2" / "summary.json").write_text(json.dumps({**before[2], "identity": "of older code"}))
    code, told, status = sweep(*same, f"sweep.resume={folder}")
    assert (code, status) == (1, {0: "failed", 1: "complete", 2: "complete"})
    after = summaries(folder)
    assert [job for job in after if after[job]["started"] == before[job]["started"]] == [1]
    assert "1  kept" in told
    assert after[2]["metrics"]["error_abs_mm"] == before[2]["metrics"]["error_abs_mm"]


@pytest.mark.slow
def test_no_job_begins_after_one_has_failed_where_that_is_asked_for(tmp_path, sweep):
    same = ("seed=0,-1,1", *TINY, "sweep.fail_fast=true")
    code, told, status = sweep(*same, f"hydra.sweep.dir={tmp_path / 'sweep'}")
    assert (code, status) == (1, {0: "complete", 1: "failed", 2: "failed"})
    assert "not begun, as job 1 failed" in told
    assert not (tmp_path / "sweep" / "2" / "run.rrd").exists()


@pytest.mark.slow
def test_a_run_that_is_lost_ends_early_and_counts_as_ended(tmp_path, sweep):
    lost = ("dataset.n_frames=12", *TINY[1:], "body=height", "body.height_m=1.2", "sweep.stop_when=times_lost>0")
    folder = tmp_path / "sweep"
    code, told, status = sweep(*lost, f"hydra.sweep.dir={folder}")
    assert (code, status) == (0, {0: "stopped"})
    assert summaries(folder)[0]["stopped"] == "times_lost>0 in frame 5"
    recorded = read(folder / "0" / "run.rrd")
    assert (recorded.status, recorded.properties["run"]["stopped"]) == ("stopped", "times_lost>0 in frame 5")
    assert recorded.poses[0].tolist() == [*range(6)]
    code, told, _ = sweep(*lost, f"sweep.resume={folder}")
    assert code == 0
    assert told.count("  kept  ") == 1
    code, _, status = sweep(*lost[:-1], f"sweep.resume={folder}")  # nothing stops it now
    assert (code, status) == (0, {0: "complete"})


@pytest.mark.slow
def test_a_sweep_is_halved_over_frames(tmp_path, sweep):
    tried = ("inference.n_particles=10,20,30", *TINY[2:], "sweep.halving=[2,3]")
    code, told, _ = sweep(*tried, f"hydra.sweep.dir={tmp_path / 'sweep'}")
    assert code == 0, told
    first, second = (summaries(tmp_path / "sweep" / name) for name in ("round_0", "round_1"))
    errors = {job: summary["metrics"]["error_abs_mm"] for job, summary in first.items()}
    assert list(second) == [min(errors, key=errors.get)]
    assert [summary["metrics"]["frames"] for summary in (*first.values(), *second.values())] == [2.0, 2.0, 2.0, 3.0]


def test_a_killed_job_is_tried_again_as_often_as_is_said(tmp_path, monkeypatch):
    ends = iter(["killed by SIGKILL", "killed by SIGTERM", None])
    tried = []

    def run_once(config, experiment, folder, output, lock, stop):
        tried.append(error := next(ends))
        status = "complete" if error is None else "failed"
        (folder / "summary.json").write_text(json.dumps({"status": status, "error": error, "metrics": {}}))

    monkeypatch.setattr(plan, "run_apart", run_once)
    run_a_job(tmp_path, retries=1)
    assert tried == ["killed by SIGKILL", "killed by SIGTERM"]
    run_a_job(tmp_path, retries=1)
    assert tried[2:] == [None]


def test_a_job_that_a_cluster_runs_again_goes_on_with_what_it_recorded(tmp_path, monkeypatch):
    """As Slurm does with one that had to make room for another, or whose node is gone: nobody says sweep.resume."""
    found = []

    def run_once(config, experiment, folder, output, lock, stop):
        found.extend(each.read_text() for each in folder.glob(".before/*.rrd.part"))
        (folder / "run.rrd.part").write_text("ten frames")
        (folder / "summary.json").write_text(json.dumps({"status": "interrupted", "error": None, "metrics": {}}))

    monkeypatch.setattr(plan, "run_apart", run_once)
    run_a_job(tmp_path)
    assert found == []
    run_a_job(tmp_path)
    assert found == ["ten frames"]


def run_a_job(folder, retries=0):
    """Run the first job of a sweep in its folder."""
    job = OmegaConf.create({"runtime": {"output_dir": str(folder)}, "job": {"num": 0, "name": "job"}, "sweeper": {}})
    keys = {"jobs": None, "resume": None, "reuse": None, "metric": None, "fail_fast": False, "retries": retries}
    plan.run_job(OmegaConf.create({}), OmegaConf.create(keys | {"stop_when": None}), "custom", job)


@pytest.mark.slow
def test_a_grown_sweep_runs_only_what_is_new(tmp_path, sweep):
    """Of two keys, so that the jobs' numbers change: (1, 2) × (0, 1) becomes (1, 2) × (0, 1, 2)."""
    folder, other = tmp_path / "sweep", tmp_path / "other"
    few, more = (("inference.n_particles=20,30", f"seed={seeds}", *TINY[:1], *TINY[2:]) for seeds in ("0,1", "0,1,2"))
    assert sweep(*few, f"hydra.sweep.dir={folder}")[0] == 0
    before = {summary["identity"]: summary["started"] for summary in summaries(folder).values()}
    assert sweep(*more, f"sweep.resume={folder}")[0] == 0
    after = summaries(folder)
    grown = {summary["identity"]: summary["started"] for summary in after.values()}
    assert len(grown) == len(after) == 6
    assert {identity: grown[identity] for identity in before} == before  # what was there was not run again
    assert [(after[job]["settings"]["inference"]["n_particles"], after[job]["seed"]) for job in range(6)] == [
        (n, seed) for n in (20, 30) for seed in (0, 1, 2)
    ]
    assert not (folder / ".aside").exists() or not list((folder / ".aside").iterdir())
    for job in range(6):
        assert read(folder / str(job) / "run.rrd").provenance["identity"] == after[job]["identity"]

    code, told, _ = sweep(*few, f"hydra.sweep.dir={other}", f"sweep.reuse={folder}")
    assert code == 0
    assert told.count("  kept  ") == 4
    assert os.stat(other / "3" / "run.rrd").st_ino == os.stat(folder / "4" / "run.rrd").st_ino

    code, told, _ = sweep("inference.n_particles=30", "seed=2", *TINY[:1], *TINY[2:], f"sweep.resume={folder}")
    assert code == 0
    assert read_summary(folder / "0")["taken_from"] == str(folder / "5")
    assert "1 complete runs that were here are none of these jobs" in told


@pytest.mark.slow
def test_a_job_of_a_sweep_is_the_same_run_as_alone(tmp_path, run, sweep):
    """Also where its process has run others before, of other parts."""
    code, _, _ = sweep("prior=smooth,walking", "seed=2,3", *TINY, f"hydra.sweep.dir={tmp_path / 'sweep'}")
    assert code == 0
    assert len({summary["pid"] for summary in summaries(tmp_path / "sweep").values()}) == 1
    code, _, alone_folder = run("alone", "seed=3", *TINY)
    assert code == 0
    recorded = [read(folder / "run.rrd") for folder in (tmp_path / "sweep" / "3", alone_folder)]
    np.testing.assert_array_equal(*(each.poses[1] for each in recorded))
    assert recorded[0].config == recorded[1].config
    assert summaries(tmp_path / "sweep")[3]["identity"] == read_summary(alone_folder)["identity"]


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["hydra.sweep.subdir=${seed}"], "hydra.sweep.subdir"),
        (["sweep.resume=no_such_sweep"], "no_such_sweep"),
        (["sweep.jobs=[2]"], "expected numbers below 2"),
        (["sweep.stop_when=often"], "sweep.stop_when"),
        (["sweep.halving=[5,2]"], "rising"),
        (["sweep.halving=[1]"], "2 frames or more"),
        (["sweep.halving=[2,1500]", "dataset.first_frame=500"], "no job can have 1500 frames: synthetic: motion"),
        (["sweep.halving=[2,3]", "experiment=temperature"], "n_frames"),
        (["sweep.halving=[2,3]", "hydra/sweeper=optuna", "hydra.sweeper.n_trials=2"], "not a tuner"),
        (["inference.n_particle=3"], "n_particle"),
    ],
)
def test_a_sweep_that_cannot_start_says_why_in_one_sentence(tmp_path, sweep, overrides, words):
    code, told, status = sweep("seed=0,1", *overrides)
    assert code == 2
    assert words in told.strip().splitlines()[-1]
    assert not status
    assert "Traceback" not in told


@pytest.fixture
def longer(tmp_path):
    """A configuration whose run takes long enough to be killed."""
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        config = compose("config", overrides=[*LONGER, "inference.n_particles=3000", "dataset.n_frames=200"])
    config.paths.cache = str(tmp_path / "cache")
    return OmegaConf.masked_copy(config, [key for key in config if key != "sweep"])


def test_a_killed_job_is_a_failed_one_and_tells_the_signal(tmp_path, longer):
    folder = tmp_path / "job"
    folder.mkdir()
    with alone(folder) as lock:
        job = threading.Thread(target=run_apart, args=(longer, "custom", folder, folder / "job.log", lock))
        job.start()
        running = wait_for(lambda: (read_summary(folder) or {}).get("pid"), job.is_alive)
        os.kill(running, signal.SIGKILL)
        job.join()
    summary = read_summary(folder)
    assert (summary["status"], summary["error"]) == ("failed", "killed by SIGKILL")
    assert not (folder / "run.rrd").exists()


def test_one_folder_is_worked_in_by_one_process_at_a_time(tmp_path):
    order = []

    def second():
        with alone(tmp_path):
            order.append("second")

    with alone(tmp_path):
        other = threading.Thread(target=second)
        other.start()
        other.join(0.2)
        order.append("first")
    other.join()
    assert order == ["first", "second"]


def wait_for(what, going_on, seconds=600.0):
    """What `what` returns once it is true; fails when the work ends, or the time is up, before."""
    end = time.monotonic() + seconds
    while not (found := what()):
        assert going_on(), "it ended before it could be looked at"
        assert time.monotonic() < end
        time.sleep(0.02)
    return found


MANY = ("experiment=walk_straight", "prior=walking,smooth", "inference.n_particles=2000,3000", "seed=range(2)", *LONGER)
JOBLIB = ("hydra/launcher=joblib", "hydra.launcher.n_jobs=2")
SUBMITIT = ("hydra/launcher=submitit_local", "threads=1", "hydra.sweeper.max_batch_size=2")


LAUNCHERS = [("hydra_plugins.hydra_joblib_launcher", JOBLIB), ("hydra_plugins.hydra_submitit_launcher", SUBMITIT)]


@pytest.mark.slow
@pytest.mark.parametrize(("needed", "launcher"), LAUNCHERS)
def test_six_of_eight_jobs_complete_and_resume_runs_the_other_two(tmp_path, needed, launcher):
    pytest.importorskip(needed)
    command, environment, sweep = many(tmp_path, launcher)
    victims = {3: signal.SIGSEGV, 5: signal.SIGKILL}
    code, told = killing(command, environment, sweep, lambda job, pid: os.kill(pid, victims[job]), list(victims))
    assert code == 1, told
    assert Counter(summary["status"] for summary in summaries(sweep).values()) == {"complete": 6, "failed": 2}
    assert f"{sweep / '3'}: killed by SIGSEGV" in told
    assert f"{sweep / '5'}: killed by SIGKILL" in told

    before = summaries(sweep)
    done = subprocess.run([*command, f"sweep.resume={sweep}"], cwd=tmp_path, env=environment, check=False)
    assert done.returncode == 0
    after = summaries(sweep)
    assert {job for job in after if after[job]["started"] != before[job]["started"]} == {3, 5}
    assert all(summary["status"] == "complete" for summary in after.values())


@pytest.mark.slow
def test_what_a_killed_worker_of_a_launcher_ran_is_run_again(tmp_path):
    """joblib ends all its workers with the one that was killed, and every job that they ran with them."""
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    command, environment, sweep = many(tmp_path, JOBLIB)
    code, told = killing(command, environment, sweep, lambda _, pid: os.kill(parent_of(pid), signal.SIGKILL), [3])
    assert code == 0, told
    assert "workbench: the launcher died: TerminatedWorkerError" in told
    assert [summary["status"] for summary in summaries(sweep).values()] == ["complete"] * 8


def many(folder, launcher):
    """The command of a sweep of eight jobs, its environment and its folder."""
    command = [sys.executable, "-m", "workbench", "-m", *launcher, *MANY]
    return command, {**os.environ, "WORKBENCH_CACHE": str(folder / "cache")}, folder / "sweep"


def killing(command, environment, sweep, kill, jobs):
    """Run a sweep and kill(job, pid) some of its jobs, in the order in which they begin: (exit code, what it told)."""
    told = sweep.with_name("told.txt")
    with told.open("w") as out, subprocess.Popen(
        [*command, f"hydra.sweep.dir={sweep}"], cwd=sweep.parent, env=environment, stdout=out, stderr=subprocess.STDOUT
    ) as process:  # fmt: skip
        while jobs:
            job, pid = wait_for(lambda: first_running(sweep, jobs), lambda: process.poll() is None)
            jobs.remove(job)
            kill(job, pid)
    return process.returncode, told.read_text()


@pytest.mark.slow
def test_a_sweep_that_is_asked_to_end_keeps_what_was_recorded_and_goes_on_with_it(tmp_path):
    """SIGTERM reaches the main process alone, as from a service manager; joblib would kill its workers' jobs."""
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    sweep, told, environment = tmp_path / "sweep", tmp_path / "told.txt", {**os.environ, "PYTHONUNBUFFERED": "1"}
    environment["WORKBENCH_CACHE"] = str(tmp_path / "cache")
    same = ("experiment=walk_straight", "prior=smooth", "inference.n_particles=600", "recorder.checkpoints=true")
    same += ("dataset.n_frames=200", *LONGER[1:], "threads=1")
    command = [sys.executable, "-m", "workbench", "-m", *JOBLIB, *same, "seed=range(4)"]
    with told.open("w") as out, subprocess.Popen(
        [*command, f"hydra.sweep.dir={sweep}"], cwd=tmp_path, env=environment, stdout=out, stderr=subprocess.STDOUT
    ) as process:  # fmt: skip
        job = wait_for(
            lambda: next((str(k) for k in range(4) if goes_on(sweep / str(k))), ""), lambda: process.poll() is None
        )
        process.send_signal(signal.SIGTERM)
        asked = time.monotonic()
    assert process.returncode == 128 + signal.SIGTERM, told.read_text()
    assert time.monotonic() - asked < 30.0
    ended = summaries(sweep)
    assert not any(at_work(summary["pid"]) for summary in ended.values())
    assert (ended[int(job)]["status"], ended[int(job)]["error"]) == ("interrupted", "Interrupted: SIGTERM")
    assert {summary["status"] for summary in ended.values()} <= {"interrupted", "complete"}
    assert f"{sweep / job}: interrupted by SIGTERM" in told.read_text()
    assert all(f"{sweep / str(k)}: never begun" in told.read_text() for k in range(4) if k not in ended)
    assert f"sweep.resume={sweep}" in told.read_text()

    again = subprocess.run(
        [*command, f"sweep.resume={sweep}", f"sweep.jobs=[{job}]"],
        cwd=tmp_path, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert again.returncode == 0, again.stderr
    assert "(went on from frame" in again.stdout
    assert not (sweep / job / ".before").exists()
    whole = [sys.executable, "-m", "workbench", *same, f"seed={job}", f"hydra.run.dir={tmp_path / 'whole'}"]
    assert subprocess.run(whole, cwd=tmp_path, env=environment, check=False).returncode == 0
    runs = [read(folder / "run.rrd") for folder in (tmp_path / "whole", sweep / job)]
    assert [len(run.poses[0]) for run in runs] == [200, 200]
    for name, curve in runs[0].scalars.items():
        np.testing.assert_array_equal(curve.values, runs[1].scalars[name].values, name)
    assert dict(runs[0].result) == dict(runs[1].result)


def at_work(pid):
    """Whether a process is there that is not merely waiting to be counted as gone."""
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def goes_on(folder):
    """Whether enough of a run has reached the disk to go on with it."""
    try:
        return earlier(read(folder / "run.rrd.part")) is not None
    except (InputError, KeyError):  # not there, or not yet
        return False


def first_running(sweep, jobs):
    """The first of some jobs that runs, and its process; None when none does."""
    found = ((job, read_summary(sweep / str(job)) or {}) for job in jobs)
    return next(((job, summary["pid"]) for job, summary in found if summary.get("status") == "running"), None)


def parent_of(pid):
    with open(f"/proc/{pid}/stat") as file:
        return int(file.read().rpartition(")")[2].split()[1])
