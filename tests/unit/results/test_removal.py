"""Removing runs touches the runs that were named and nothing else."""

import os
import shutil

import pytest
from run_folders import write_run, write_sweep

from workbench.experiment.summary import set_aside
from workbench.results.removal import check_removable, consequence, remove, size_of
from workbench.results.table import read_runs
from workbench.utils.errors import InputError
from workbench.utils.run_files import EARLIER
from workbench.utils.run_lock import locked

STARTED = "2026-11-02T15:00:00"


@pytest.fixture
def root(tmp_path):
    write_sweep(tmp_path / "home" / "sweep", priors=["smooth"], ns=[100], seeds=[0, 1])
    return tmp_path / "home"


@pytest.fixture
def folder(root):
    """The newer run of the two."""
    return root / "sweep" / "1"


def test_a_removed_run_is_gone_and_the_others_are_there(root, folder):
    remove(folder, STARTED)
    remove(folder, STARTED)  # another command has removed it
    assert list(read_runs(root)["path"]) == [str(root / "sweep" / "0")]
    assert os.listdir(root / "sweep") == ["0"]


def test_a_run_that_was_there_before_takes_the_place_of_one_that_is_removed(root, folder):
    for k in range(3):  # each in the place of the one before
        (folder / "summary.json").unlink()
        write_run(root / f"new{k}", seed=10 + k, status="complete" if k < 2 else "failed", day=2)
        os.replace(root / f"new{k}" / "summary.json", folder / "summary.json")
        (root / f"new{k}").rmdir()
        if k < 2:
            (folder / "run.rrd").write_text(f"run {k}")
            set_aside(folder)
            (folder / "summary.json").write_text("{}")
    (folder / "run.log").write_text("of the last")
    for seed, left in ((12, "run 1"), (11, "run 0")):
        runs = read_runs(folder)
        assert list(runs["seed"]) == [seed]
        check_removable(runs, [root])
        assert consequence(folder).startswith("the earlier run ")
        remove(folder, STARTED)
        assert (folder / "run.rrd").read_text() == left
        assert not (folder / "run.log").exists()
    assert consequence(folder) == ""
    remove(folder, STARTED)
    assert os.listdir(root / "sweep") == ["0"]


def test_what_an_attempt_recorded_is_removed_with_its_run(folder):
    (folder / EARLIER).mkdir()
    assert consequence(folder) == ""
    (folder / EARLIER / "1.rrd.part").write_bytes(b"0" * 1000)
    assert "an earlier attempt" in consequence(folder)
    assert size_of(folder) > 1000
    remove(folder, STARTED)
    assert not folder.exists()


def baseline(root):
    write_run(root / "baselines" / "a")


def run_at_work(root):
    write_run(root / "busy", status="running")


def outside(root):
    write_run(root.parent / "outside" / "a")
    (root / "link").symlink_to(root.parent / "outside" / "a")


def run_in_a_run(root):
    write_run(root / "outer")
    write_run(root / "outer" / "deep" / "inner")


@pytest.mark.parametrize(
    ("made", "place", "words"),
    [
        (baseline, ".", "is a baseline"),
        (run_at_work, ".", "found a running one"),
        (outside, "../outside", "inside the folders"),
        (outside, "link", "inside the folders"),
        (run_in_a_run, "outer", "contains another run"),
    ],
)
def test_what_must_not_be_removed_is_refused(root, made, place, words):
    made(root)
    with locked(root / "busy") if made is run_at_work else locked(root), pytest.raises(InputError, match=words):
        check_removable(read_runs(root / place), [root])


def test_a_folder_where_a_run_is_at_work_or_has_begun_since_is_not_touched(folder):
    with locked(folder), pytest.raises(InputError, match="uses this folder"):
        remove(folder, STARTED)
    with pytest.raises(InputError, match=r"sweep/1: another run has replaced the listed one"):
        remove(folder, "2026-11-01T15:00:00")
    assert (folder / "summary.json").is_file()


def test_a_run_may_begin_where_one_is_being_deleted_and_nothing_is_left(root, folder, monkeypatch):
    (folder.parent / ".removed-0").mkdir()  # by a command that was killed
    whole = shutil.rmtree

    def begun(removed, **options):
        assert not folder.exists()
        assert list(read_runs(root)["path"]) == [str(root / "sweep" / "0")]
        write_run(folder, seed=7)
        monkeypatch.undo()
        whole(removed, **options)

    monkeypatch.setattr(shutil, "rmtree", begun)
    remove(folder, STARTED)
    assert sorted(os.listdir(root / "sweep")) == ["0", "1"]
    assert list(read_runs(folder)["seed"]) == [7]
