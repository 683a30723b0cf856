"""The table of a sweep's jobs while they run and at its end."""

import json

import pytest
from run_folders import leave, summary

from workbench.sweep.plan import Plan
from workbench.sweep.progress import Progress, close, rest_of
from workbench.utils.run_lock import locked


@pytest.fixture
def progress(tmp_path):
    found = Progress(Plan(tmp_path, None, ("seed",), (0, 1)), "JoblibLauncher")
    yield found
    found.stop()


def leave_again(folder, day, **said):
    (folder / "summary.json").unlink()
    (folder / "summary.json").write_text(json.dumps(summary(day=day, **said)))


def test_a_job_that_runs_again_after_it_was_interrupted_is_not_interrupted(tmp_path, progress, capsys):
    """As one does that Slurm has put back into its queue, since its time was up or another needed the node."""
    leave(tmp_path / "0", day=1)
    job = leave(tmp_path / "1", day=1, status="interrupted")
    progress.stop()
    assert progress.not_ended() == []
    assert progress.not_complete() == {1: "interrupted by a signal"}

    leave_again(job, 2, status="running")
    progress._watch()
    assert progress.not_ended() == [1]

    leave_again(job, 2)
    progress._watch()
    assert close(progress, []) == 0
    rows = [line.split()[:2] for line in capsys.readouterr().out.splitlines()]
    assert rows == [["0", "complete"], ["1", "interrupted"], ["1", "complete"]]


def test_jobs_that_have_not_ended_are_told_apart(tmp_path, progress):
    leave(tmp_path / "0", status="running")
    progress.stop()
    assert progress.not_complete() == {0: "killed", 1: "never begun"}
    with locked(tmp_path / "0"):
        assert progress.not_complete()[0] == "still running"
    assert rest_of(progress) == [f"sweep.resume='{tmp_path}'", "sweep.jobs=[1]"]


def test_what_an_earlier_sweep_left_has_not_begun_until_it_is_kept_or_run(tmp_path, capsys):
    leave(tmp_path / "0")
    leave(tmp_path / "1", status="failed")
    progress = Progress(Plan(tmp_path, None, ("seed",), (0, 1)))
    assert progress.not_begun() == [0, 1]
    (tmp_path / "0" / "summary.json").touch()
    assert close(progress, ["-m", "seed=0,1", "hydra.sweep.dir=there"]) == 1
    out, err = capsys.readouterr()
    assert out.splitlines()[-1].split()[:2] == ["0", "kept"]
    assert err.splitlines()[1:] == [
        f"  {tmp_path / '1'}: never begun",
        f"run them again: workbench run -m seed=0,1 sweep.resume={tmp_path}",
    ]
