"""One job of a sweep: what an earlier attempt left, what ends it early, and what becomes of the sweep."""

import json
import math
import os
import shutil
from types import SimpleNamespace

import pytest
from omegaconf import OmegaConf

from workbench.experiment import resume, run
from workbench.sweep.early_stop import parse_stop_condition
from workbench.sweep.job import ASIDE, FAILED, reuse_run, run_job
from workbench.utils.errors import InputError
from workbench.utils.run_files import EARLIER
from workbench.utils.run_lock import is_locked, locked
from workbench.utils.signals import Interrupted

BASIC = "hydra._internal.core_plugins.basic_launcher.BasicLauncher"
JOBLIB = "hydra_plugins.hydra_joblib_launcher.joblib_launcher.JoblibLauncher"
SUBMITIT = "hydra_plugins.hydra_submitit_launcher.submitit_launcher.SlurmLauncher"


@pytest.fixture
def runs(monkeypatch):
    """What the runs do instead of tracking, one after another; `runs.found` are the attempts that they could resume."""
    runs = SimpleNamespace(acts=[], found=[])

    def run_checked(config, summary, *_):
        runs.acts.pop(0)(summary)

    def find_resumable(config, attempts):
        runs.found.append(sorted(each.read_text() for each in attempts))

    monkeypatch.setattr(run, "run_checked", run_checked)
    monkeypatch.setattr(resume, "find_resumable", find_resumable)
    return runs


def act(sweep, number=0, launcher=BASIC, **keys):
    """Run a job in its folder, as Hydra's launcher does."""
    (folder := sweep / str(number)).mkdir(exist_ok=True)
    said = {
        "job_ids": None,
        "resume": None,
        "reuse": None,
        "objective": None,
        "fail_fast": False,
        "stop_if": None,
        **keys,
    }
    settings = {
        "runtime": {"output_dir": str(folder), "choices": {"prior": "smooth"}}, "job": {"num": number},
        "overrides": {"task": ["seed=3"]}, "launcher": {"_target_": launcher}, "sweeper": {"direction": "minimize"},
    }  # fmt: skip
    return run_job(OmegaConf.create({"seed": 3}), OmegaConf.create(said), "walk", OmegaConf.create(settings))


def status(sweep, number=0):
    summary = json.loads((sweep / str(number) / "summary.json").read_text())
    return summary["status"], summary["error"]


def completes(summary):
    summary.recording.write_text("whole")
    summary.per_frame["mpjpe_abs_mm"] = [12.0]


def fails(summary):
    summary.recording.with_name("run.rrd.part").write_text("a part")
    raise InputError("nonsense")


def is_interrupted(summary):
    summary.recording.with_name("run.rrd.part").write_text("ten frames")
    raise Interrupted(15)


def test_a_job_that_fails_is_the_worst_and_the_next_one_runs(tmp_path, runs):
    runs.acts = [fails, completes]
    with locked(tmp_path):
        assert act(tmp_path, 0) == math.inf
        assert act(tmp_path, 1) == 12.0
    assert status(tmp_path, 0) == ("failed", "InputError: nonsense")
    assert status(tmp_path, 1) == ("complete", None)
    assert not is_locked(tmp_path / "0")


def test_no_job_begins_after_one_has_failed_where_that_is_asked_for(tmp_path, runs):
    runs.acts = [fails]
    with locked(tmp_path):
        act(tmp_path, 0, fail_fast=True)
        assert act(tmp_path, 1, fail_fast=True) == math.inf
    assert (tmp_path / FAILED).read_text() == "0"
    assert not (tmp_path / "1" / "summary.json").exists()


def test_no_job_begins_once_the_sweep_has_ended_unless_it_is_a_cluster_s(tmp_path, runs):
    assert act(tmp_path) == math.inf
    runs.acts = [completes]
    assert act(tmp_path, launcher=SUBMITIT) == 12.0


def test_an_interruption_ends_the_sweep_only_in_its_own_process(tmp_path, runs):
    runs.acts = [is_interrupted, is_interrupted]
    with locked(tmp_path):
        with pytest.raises(Interrupted):
            act(tmp_path)
        assert act(tmp_path, launcher=JOBLIB) == math.inf
    assert status(tmp_path) == ("interrupted", "Interrupted: SIGTERM")


def test_the_next_attempt_finds_what_all_recorded_until_one_is_complete(tmp_path, runs):
    """Also without sweep.resume, as when Slurm runs a job again."""
    runs.acts = [is_interrupted, fails, completes]
    with locked(tmp_path):
        for _ in range(3):
            act(tmp_path, launcher=JOBLIB)
    assert runs.found == [[], ["ten frames"], ["a part", "ten frames"]]
    assert not (tmp_path / "0" / EARLIER).exists()


def test_a_run_that_may_be_stopped_early_starts_from_scratch(tmp_path, runs):
    runs.acts = [is_interrupted, completes]
    with locked(tmp_path):
        for _ in range(2):
            act(tmp_path, launcher=JOBLIB, stop_if="n_track_losses>0")
    assert runs.found == []


@pytest.fixture
def aside(tmp_path):
    """A sweep's folder with a complete run that was set aside, and the folders of two jobs."""
    (aside := tmp_path / ASIDE / "same").mkdir(parents=True)
    (aside / "run.rrd").write_text("recorded")
    (aside / "summary.json").write_text(json.dumps({"status": "complete", "identity": "same"}))
    for name in ("0", "1"):
        (tmp_path / name).mkdir()
    return tmp_path


@pytest.mark.parametrize("links", [True, False])
def test_a_run_removed_meanwhile_is_not_taken_over(aside, monkeypatch, links):
    def removed(*_):
        shutil.rmtree(aside / ASIDE / "same")
        raise FileNotFoundError(2, "No such file or directory") if links else OSError(95, "Operation not supported")

    monkeypatch.setattr(os, "link", removed)
    assert not reuse_run("same", aside / "0", [aside])
    assert os.listdir(aside / "0") == []


def test_a_run_that_another_sweep_takes_over_too_is_taken_over(aside, monkeypatch):
    whole = shutil.rmtree

    def other(folder, **options):
        monkeypatch.undo()
        whole(folder)
        shutil.rmtree(folder, **options)

    monkeypatch.setattr(shutil, "rmtree", other)
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
def test_it_compares_a_number_of_the_run(text, metrics, holds):
    assert parse_stop_condition(text)(metrics) is holds


@pytest.mark.parametrize(
    "text",
    ["n_track_losses", "n_track_losses>", ">0", "a>b", "__import__('os')>0", "a>0 or b>0", "", "a>nan", "a<1e999"],
)
def test_anything_else_is_a_sentence(text):
    with pytest.raises(InputError, match=r"sweep\.stop_if"):
        parse_stop_condition(text)
