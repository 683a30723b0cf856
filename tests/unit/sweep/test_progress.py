"""What is told of a sweep's jobs while they run and at its end."""

import json

import pytest
from run_folders import leave, summary

from workbench.sweep.plan import Plan
from workbench.sweep.progress import Progress, close


@pytest.fixture
def progress(tmp_path):
    found = Progress(Plan(tmp_path, None, ("seed",), (("seed=0",), ("seed=1",)), (0, 1)))
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
    assert progress.cut() == []
    assert progress.not_complete() == {1: "interrupted"}

    leave_again(job, 2, status="running")
    progress._watch()
    assert progress.cut() == [1]

    leave_again(job, 2)
    progress._watch()
    assert close(progress, []) == 0
    told = [line.split()[:2] for line in capsys.readouterr().out.splitlines()]
    assert told == [["0", "complete"], ["1", "interrupted"], ["1", "complete"]]
