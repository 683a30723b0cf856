"""One job of a sweep: repetition, early stopping, reuse of runs, and consequences for the sweep."""

import json
import math
import os
import shutil
from array import array
from types import SimpleNamespace

import pytest
from omegaconf import OmegaConf

from workbench.experiment import run
from workbench.sweep.early_stop import parse_stop_condition
from workbench.sweep.job import ASIDE, FAILED, reuse_run, run_job
from workbench.utils.errors import InputError
from workbench.utils.run_lock import is_locked, locked
from workbench.utils.signals import Interrupted

BASIC = "hydra._internal.core_plugins.basic_launcher.BasicLauncher"
JOBLIB = "hydra_plugins.hydra_joblib_launcher.joblib_launcher.JoblibLauncher"
SUBMITIT = "hydra_plugins.hydra_submitit_launcher.submitit_launcher.SlurmLauncher"


@pytest.fixture
def runs(monkeypatch):
    """Stubs of successive runs."""
    runs = SimpleNamespace(stubs=[])

    def run_checked(config, summary, *_):
        runs.stubs.pop(0)(summary)

    monkeypatch.setattr(run, "run_checked", run_checked)
    return runs


def launch(sweep, number=0, launcher=BASIC, **keys):
    """Run a job in its folder like Hydra's launcher."""
    (folder := sweep / str(number)).mkdir(exist_ok=True)
    defaults = dict.fromkeys(("job_ids", "resume", "reuse", "objective", "stop_if")) | {"fail_fast": False}
    settings = {
        "runtime": {"output_dir": str(folder), "choices": {"prior": "smooth"}}, "job": {"num": number},
        "overrides": {"task": ["seed=3"]}, "launcher": {"_target_": launcher}, "sweeper": {"direction": "minimize"},
    }  # fmt: skip
    return run_job(OmegaConf.create({"seed": 3}), OmegaConf.create(defaults | keys), "walk", OmegaConf.create(settings))


def status(sweep, number=0):
    summary = json.loads((sweep / str(number) / "summary.json").read_text())
    return summary["status"], summary["error"]


def complete(summary):
    summary.recording.write_text("complete")
    summary.per_frame["mpjpe_abs_mm"] = array("d", [12.0])


def fail(summary):
    summary.recording.with_name("run.rrd.part").write_text("part")
    raise InputError("nonsense")


def interrupt(summary):
    summary.recording.with_name("run.rrd.part").write_text("ten frames")
    raise Interrupted(15)


def test_a_failed_job_has_the_worst_objective_and_the_next_one_runs(tmp_path, runs):
    runs.stubs = [fail, complete]
    with locked(tmp_path):
        assert launch(tmp_path, 0) == math.inf
        assert launch(tmp_path, 1) == 12.0
    assert status(tmp_path, 0) == ("failed", "InputError: nonsense")
    assert status(tmp_path, 1) == ("complete", None)
    assert not is_locked(tmp_path / "0")


def test_with_fail_fast_no_job_starts_after_a_failure(tmp_path, runs):
    runs.stubs = [fail]
    with locked(tmp_path):
        launch(tmp_path, 0, fail_fast=True)
        assert launch(tmp_path, 1, fail_fast=True) == math.inf
    assert (tmp_path / FAILED).read_text() == "0"
    assert not (tmp_path / "1" / "summary.json").exists()


def test_jobs_start_after_the_end_of_the_sweep_only_on_a_cluster(tmp_path, runs):
    assert launch(tmp_path) == math.inf
    runs.stubs = [complete]
    assert launch(tmp_path, launcher=SUBMITIT) == 12.0


def test_an_interruption_ends_the_sweep_only_in_the_launchers_process(tmp_path, runs):
    runs.stubs = [interrupt, interrupt]
    with locked(tmp_path):
        with pytest.raises(Interrupted):
            launch(tmp_path)
        assert launch(tmp_path, launcher=JOBLIB) == math.inf
    assert status(tmp_path) == ("interrupted", "Interrupted: SIGTERM")


def test_an_incomplete_job_is_repeated_until_it_is_complete(tmp_path, runs):
    """Slurm repeats a job without sweep.resume."""
    runs.stubs = [interrupt, fail, complete]
    with locked(tmp_path):
        objectives = [launch(tmp_path, launcher=JOBLIB) for _ in range(3)]
    assert objectives == [math.inf, math.inf, 12.0]
    assert status(tmp_path) == ("complete", None)


@pytest.fixture
def aside(tmp_path):
    """A sweep's folder with a complete earlier run in ASIDE, and the folders of two jobs."""
    (aside := tmp_path / ASIDE / "same").mkdir(parents=True)
    (aside / "run.rrd").write_text("recorded")
    (aside / "summary.json").write_text(json.dumps({"status": "complete", "identity": "same"}))
    for name in ("0", "1"):
        (tmp_path / name).mkdir()
    return tmp_path


@pytest.mark.parametrize("links", [True, False])
def test_a_run_removed_during_reuse_is_not_reused(aside, monkeypatch, links):
    def removed(*_):
        shutil.rmtree(aside / ASIDE / "same")
        raise FileNotFoundError(2, "No such file or directory") if links else OSError(95, "Operation not supported")

    monkeypatch.setattr(os, "link", removed)
    assert not reuse_run("same", aside / "0", [aside])
    assert os.listdir(aside / "0") == []


def test_a_run_that_another_sweep_removes_after_the_links_is_reused(aside, monkeypatch):
    rmtree = shutil.rmtree

    def other_sweep(folder, **options):
        monkeypatch.undo()
        rmtree(folder)
        shutil.rmtree(folder, **options)

    monkeypatch.setattr(shutil, "rmtree", other_sweep)
    assert reuse_run("same", aside / "0", [aside])
    assert (aside / "0" / "run.rrd").read_text() == "recorded"
    assert json.loads((aside / "0" / "summary.json").read_text())["taken_from"] == str(aside / ASIDE / "same")
    assert not reuse_run("same", aside / "1", [aside / "1"])


@pytest.mark.parametrize(
    ("text", "metrics", "holds"),
    [
        ("n_track_losses>0", {"n_track_losses": 1.0}, True),
        ("n_track_losses>0", {"n_track_losses": 0.0}, False),
        ("n_track_losses>0", {}, False),
        ("mpjpe_px >= 4.5", {"mpjpe_px": 4.5}, True),
        ("mpjpe_px<=4", {"mpjpe_px": 4.5}, False),
        ("ess<1e1", {"ess": 9.0}, True),
        ("tracked=0", {"tracked": 0.0}, True),
        ("mpjpe_px>4", {"mpjpe_px": float("nan")}, False),
    ],
)
def test_a_stop_condition_compares_a_metric(text, metrics, holds):
    assert parse_stop_condition(text)(metrics) is holds


@pytest.mark.parametrize(
    "text",
    ["n_track_losses", "n_track_losses>", ">0", "a>b", "__import__('os')>0", "a>0 or b>0", "", "a>nan", "a<1e999"],
)
def test_other_stop_conditions_are_rejected(text):
    with pytest.raises(InputError, match=r"sweep\.stop_if"):
        parse_stop_condition(text)
