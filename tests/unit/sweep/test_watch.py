"""A sweep started elsewhere, watched until it is done."""

import json
import os
import platform
import shutil

import pytest
from run_folders import leave, summary

from workbench.errors import InputError
from workbench.sweep import starter
from workbench.sweep import watch as module
from workbench.sweep.watch import watch, watched

PID_NEVER = 2**22 + 1  # above what Linux gives
PLAN = """
hydra: {sweeper: {params: {prior: "smooth,walking"}}, overrides: {task: ["seed=range(2)", "dataset.n_frames=5"]}}
sweep: {jobs: null}
"""


@pytest.fixture
def sweep(tmp_path):
    (tmp_path / "multirun.yaml").write_text(PLAN)
    os.utime(tmp_path / "multirun.yaml", (1e9, 1e9))
    leave(tmp_path / "0", seed=0)
    return tmp_path


def test_the_jobs_are_those_of_all_combinations(sweep):
    found = watched(sweep)
    assert found.jobs == (0, 1, 2, 3)
    assert found.keys == {"prior", "seed"}
    (sweep / "multirun.yaml").write_text(PLAN.replace("null", "[1, 3]"))
    assert watched(sweep).jobs == (1, 3)


def test_parameters_may_be_told_by_what_the_configuration_refers_to(sweep):
    lists = "clips: {strangers: {walk: {a: 0, b: 3}, run: {c: 1}}}"
    (sweep / "multirun.yaml").write_text(
        PLAN.replace('"smooth,walking"', "'${each:${clips_of:${clips.strangers}}}'") + lists
    )
    assert watched(sweep).jobs == (0, 1, 2, 3, 4, 5)


def test_the_trials_of_a_tuner_are_told_by_its_jobs(tmp_path):
    job = tmp_path / "0" / ".hydra"
    job.mkdir(parents=True)
    (job / "hydra.yaml").write_text("hydra: {sweeper: {n_trials: 7, params: {}}, overrides: {task: [seed=1]}}")
    assert watched(tmp_path).jobs == tuple(range(7))


def test_every_change_is_a_line_until_all_have_ended(sweep, capsys, monkeypatch):
    changes = [(1, "running", 1.0), (1, "complete", 12.345), (2, "failed", 1.0), (3, "complete", 9.0)]

    def go_on(_):
        job, status, error = changes.pop(0)
        (sweep / str(job) / ".hydra").mkdir(parents=True, exist_ok=True)
        (sweep / str(job) / ".hydra" / "overrides.yaml").write_text(f"[seed={job}, dataset.n_frames=5]")
        (sweep / str(job) / "summary.json").write_text(json.dumps(summary(status=status, error=error)))

    monkeypatch.setattr(module, "sleep", go_on)
    code = watch(watched(sweep))
    lines = capsys.readouterr().out.splitlines()
    assert code == 1
    assert lines[0] == f"4 jobs in {sweep}: 1 complete, 3 not begun"
    assert [line.split() for line in lines[1:-1]] == [
        ["1", "running", "-", "3", "left", "seed=1"],
        ["1", "complete", "12.35", "2", "left", "seed=1"],
        ["2", "failed", "-", "1", "left", "seed=2"],
        ["3", "complete", "9", "0", "left", "seed=3"],
    ]
    assert lines[-1] == "3 complete, 1 failed"


def test_what_an_earlier_attempt_left_is_waited_for(sweep):
    leave(sweep / "1", seed=1, status="failed")
    assert set(watched(sweep).entries()) == {0, 1}
    os.utime(sweep / "1" / "summary.json", (1e9 - 1, 1e9 - 1))
    assert set(watched(sweep).entries()) == {0}


def test_a_sweep_whose_launcher_died_ends(sweep, capsys):
    leave(sweep / "1", status="running", host=platform.node(), pid=PID_NEVER)
    assert watch(watched(sweep), period_s=0.001) == 1
    assert capsys.readouterr().out.endswith(
        f"whoever started the jobs is gone; sweep.resume={sweep} goes on with them\n"
    )


def ends(sweep, monkeypatch):
    """Watch without waiting, for a hundred looks at most; what the command returns, None where it would go on."""
    looks = iter(range(100))
    monkeypatch.setattr(module, "sleep", lambda _: next(looks))
    try:
        return watch(watched(sweep))
    except StopIteration:
        return None


def test_a_sweep_that_was_asked_to_end_before_all_jobs_had_begun_ends(sweep, capsys, monkeypatch):
    starter.begin(sweep, needed=True)
    leave(sweep / "1", seed=1, status="interrupted")
    assert ends(sweep, monkeypatch) is None
    starter.end(sweep)
    assert ends(sweep, monkeypatch) == 1
    assert capsys.readouterr().out.endswith(
        "1 complete, 1 interrupted, 2 not begun\n"
        f"whoever started the jobs is gone; sweep.resume={sweep} goes on with them\n"
    )


def test_a_sweep_whose_launcher_was_killed_ends_with_its_last_job(sweep, monkeypatch):
    said = {"host": platform.node(), "pid": PID_NEVER, "done": False}
    (sweep / starter.FILE).write_text(json.dumps(said))
    job = leave(sweep / "1", status="running", host=platform.node(), pid=os.getpid())
    assert ends(sweep, monkeypatch) is None
    shutil.rmtree(job)
    leave(job, status="interrupted")
    assert ends(sweep, monkeypatch) == 1


def test_jobs_that_go_on_by_themselves_are_waited_for(sweep, monkeypatch):
    starter.begin(sweep, needed=False)
    leave(sweep / "1", status="running", host=platform.node(), pid=PID_NEVER)
    assert ends(sweep, monkeypatch) is None  # whoever waits for it may run it again
    starter.leave(sweep)
    starter.end(sweep)
    assert ends(sweep, monkeypatch) == 1


@pytest.mark.parametrize("plan", ["", "{", "hydra: 3", "hydra: {overrides: {task: ['a=[']}}", "- 1"])
def test_what_is_no_sweep_is_a_sentence(tmp_path, plan):
    with pytest.raises(InputError, match="expected the folder of a sweep"):
        watched(tmp_path)
    (tmp_path / "multirun.yaml").write_text(plan)
    with pytest.raises(InputError, match="expected what Hydra leaves"):
        watched(tmp_path)


def test_a_sweep_that_is_removed_ends(sweep, monkeypatch):
    found = watched(sweep)
    monkeypatch.setattr(module, "sleep", lambda _: shutil.rmtree(sweep))
    with pytest.raises(InputError, match="was removed meanwhile"):
        watch(found)
