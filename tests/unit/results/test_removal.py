"""Removing runs deletes the selected runs only."""

import os
import shutil

import pytest
from run_folders import write_run, write_sweep

from workbench.experiment.summary import set_aside
from workbench.results.removal import check_removable, remove
from workbench.results.table import read_runs
from workbench.utils.errors import InputError
from workbench.utils.run_lock import locked

STARTED = "2026-11-02T15:00:00"


@pytest.fixture
def root(tmp_path):
    write_sweep(tmp_path / "home" / "sweep", priors=["smooth"], ns=[100], seeds=[0, 1])
    return tmp_path / "home"


@pytest.fixture
def folder(root):
    """The newer of the two runs."""
    return root / "sweep" / "1"


def test_a_removed_run_is_deleted_and_the_others_are_not(root, folder):
    remove(folder, STARTED)
    remove(folder, STARTED)  # without effect, as after another command
    assert list(read_runs(root)["path"]) == [str(root / "sweep" / "0")]
    assert os.listdir(root / "sweep") == ["0"]


def test_removal_restores_the_earlier_run_of_a_folder(root, folder):
    for k in range(3):  # run k replaces the earlier one
        (folder / "summary.json").unlink()
        write_run(root / f"new{k}", seed=10 + k, status="complete" if k < 2 else "failed", day=2)
        os.replace(root / f"new{k}" / "summary.json", folder / "summary.json")
        (root / f"new{k}").rmdir()
        if k < 2:
            (folder / "run.rrd").write_text(f"run {k}")
            set_aside(folder)
            (folder / "summary.json").write_text("{}")
    (folder / "run.log").write_text("log of run 2")
    for seed, earlier in ((12, "run 1"), (11, "run 0")):
        runs = read_runs(folder)
        assert list(runs["seed"]) == [seed]
        check_removable(runs, [root])
        remove(folder, STARTED)
        assert (folder / "run.rrd").read_text() == earlier
        assert not (folder / "run.log").exists()
    remove(folder, STARTED)
    assert os.listdir(root / "sweep") == ["0"]


def baseline(root):
    write_run(root / "baselines" / "a")


def running(root):
    write_run(root / "busy", status="running")


def outside(root):
    write_run(root.parent / "outside" / "a")
    (root / "link").symlink_to(root.parent / "outside" / "a")


def nested(root):
    write_run(root / "outer")
    write_run(root / "outer" / "deep" / "inner")


@pytest.mark.parametrize(
    ("make", "path", "text"),
    [
        (baseline, ".", "is a baseline"),
        (running, ".", "found a running one"),
        (outside, "../outside", "inside the folders"),
        (outside, "link", "inside the folders"),
        (nested, "outer", "contains another run"),
    ],
)
def test_removal_of_other_and_running_runs_is_refused(root, make, path, text):
    make(root)
    with locked(root / "busy") if make is running else locked(root), pytest.raises(InputError, match=text):
        check_removable(read_runs(root / path), [root])


def test_a_folder_with_a_running_or_newer_run_is_not_removed(folder):
    with locked(folder), pytest.raises(InputError, match="uses this folder"):
        remove(folder, STARTED)
    with pytest.raises(InputError, match=r"sweep/1: another run has replaced the listed one"):
        remove(folder, "2026-11-01T15:00:00")
    assert (folder / "summary.json").is_file()


def test_a_run_can_start_in_a_folder_while_it_is_removed(root, folder, monkeypatch):
    (folder.parent / ".removed-0").mkdir()  # of a killed command
    rmtree = shutil.rmtree

    def start_run(removed, **options):
        assert not folder.exists()
        assert list(read_runs(root)["path"]) == [str(root / "sweep" / "0")]
        write_run(folder, seed=7)
        monkeypatch.undo()
        rmtree(removed, **options)

    monkeypatch.setattr(shutil, "rmtree", start_run)
    remove(folder, STARTED)
    assert sorted(os.listdir(root / "sweep")) == ["0", "1"]
    assert list(read_runs(folder)["seed"]) == [7]
