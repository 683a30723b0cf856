"""The table of a sweep's jobs while they run and at its end."""

import json
import os
import shutil

import pytest
from run_folders import summary, write_run

from workbench.sweep import table as module
from workbench.sweep.plan import Plan, read_plan
from workbench.sweep.table import Progress, close, watch
from workbench.utils.errors import InputError
from workbench.utils.run_lock import locked


@pytest.fixture
def progress(tmp_path):
    progress = Progress(Plan(tmp_path, None, ("seed",), (0, 1)), "JoblibLauncher")
    yield progress
    progress.stop()


def replace_summary(folder, day, **fields):
    (folder / "summary.json").unlink()
    (folder / "summary.json").write_text(json.dumps(summary(day=day, **fields)))


def test_a_requeued_job_has_the_status_of_its_last_run(tmp_path, progress, capsys):
    """Slurm requeues a job after its time limit or a preemption."""
    write_run(tmp_path / "0", day=1)
    job = write_run(tmp_path / "1", day=1, status="interrupted")
    progress.stop()
    assert progress.not_ended() == []
    assert progress.not_complete() == {1: "interrupted by a signal"}

    replace_summary(job, 2, status="running")
    progress._watch()
    assert progress.not_ended() == [1]

    replace_summary(job, 2)
    progress._watch()
    assert close(progress, []) == 0
    rows = [line.split()[:2] for line in capsys.readouterr().out.splitlines()]
    assert rows == [["0", "complete"], ["1", "interrupted"], ["1", "complete"]]


def test_incomplete_jobs_are_killed_never_begun_or_running(tmp_path, progress):
    write_run(tmp_path / "0", status="running")
    progress.stop()
    assert progress.not_complete() == {0: "killed", 1: "never begun"}
    with locked(tmp_path / "0"):
        assert progress.not_complete()[0] == "still running"


def test_jobs_of_an_earlier_sweep_count_once_they_are_reused_or_repeated(tmp_path, capsys):
    write_run(tmp_path / "0")
    write_run(tmp_path / "1", status="failed")
    progress = Progress(Plan(tmp_path, None, ("seed",), (0, 1)))
    assert progress.not_ended() == [0, 1]
    (tmp_path / "0" / "summary.json").touch()
    assert close(progress, ["-m", "seed=0,1", "hydra.sweep.dir=folder"]) == 1
    out, err = capsys.readouterr()
    assert out.splitlines()[-1].split()[:2] == ["0", "reused"]
    assert err.splitlines()[1:] == [
        f"  {tmp_path / '1'}: never begun",
        f"repeat them: workbench run -m seed=0,1 sweep.resume={tmp_path}",
    ]


PLAN = """
hydra: {sweeper: {params: {prior: "smooth,walking"}}, overrides: {task: ["seed=range(2)", "dataset.n_frames=5"]}}
sweep: {job_ids: null}
"""


@pytest.fixture
def sweep(tmp_path):
    (tmp_path / "multirun.yaml").write_text(PLAN)
    os.utime(tmp_path / "multirun.yaml", (1e9, 1e9))
    write_run(tmp_path / "0", seed=0)
    return tmp_path


def test_the_jobs_of_a_plan_are_all_combinations(sweep):
    plan = read_plan(sweep)
    assert plan.jobs == (0, 1, 2, 3)
    (sweep / "0" / ".hydra").mkdir()
    (sweep / "0" / ".hydra" / "overrides.yaml").write_text("[dataset.n_frames=5, prior=smooth, seed=0]")
    assert plan.overrides_of(0) == "prior=smooth seed=0"
    (sweep / "multirun.yaml").write_text(PLAN.replace("null", "[1, 3]"))
    assert read_plan(sweep).jobs == (1, 3)


def test_the_number_of_trials_is_read_from_a_job(tmp_path):
    job = tmp_path / "0" / ".hydra"
    job.mkdir(parents=True)
    (job / "hydra.yaml").write_text("hydra: {sweeper: {n_trials: 7, params: {}}, overrides: {task: [seed=1]}}")
    assert read_plan(tmp_path).jobs == tuple(range(7))


def watch_briefly(sweep, monkeypatch):
    """Return the exit code of `watch`, None if it continues after three polls."""
    polls = iter(range(3))
    monkeypatch.setattr(module, "sleep", lambda _: next(polls))
    try:
        return watch(sweep)
    except StopIteration:
        return None


@pytest.mark.parametrize("running", ["", "1"], ids=["launcher", "job"])
def test_a_sweep_is_watched_while_its_launcher_or_a_job_runs(sweep, capsys, monkeypatch, running):
    write_run(sweep / "1", status="running")
    with locked(sweep / running):
        assert watch_briefly(sweep, monkeypatch) is None
    assert watch_briefly(sweep, monkeypatch) == 1
    assert capsys.readouterr().out.splitlines()[-4:] == [
        f"{sweep / '1'}: killed",
        f"{sweep / '2'}: never begun",
        f"{sweep / '3'}: never begun",
        f"no process runs the sweep; sweep.resume={sweep} resumes it",
    ]


@pytest.mark.parametrize("plan", ["", "{", "hydra: 3", "hydra: {overrides: {task: ['a=[']}}", "- 1"])
def test_a_folder_without_a_sweep_is_rejected(tmp_path, plan):
    with pytest.raises(InputError, match="expected the folder of a sweep"):
        watch(tmp_path)
    (tmp_path / "multirun.yaml").write_text(plan)
    with pytest.raises(InputError, match="expected the configuration of a sweep"):
        watch(tmp_path)


def test_watching_ends_when_the_sweep_is_removed(sweep, monkeypatch):
    monkeypatch.setattr(module, "sleep", lambda _: shutil.rmtree(sweep))
    with pytest.raises(InputError, match="was removed"):
        watch(sweep)
