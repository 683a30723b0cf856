"""Making room touches the runs that were named and nothing else."""

import os
import shutil
from pathlib import Path

import pytest
from run_folders import leave, leave_sweep

from workbench.experiment.summary import set_aside
from workbench.results import tidy
from workbench.results.index import entries
from workbench.utils.errors import InputError
from workbench.utils.run_files import EARLIER
from workbench.utils.run_lock import locked


@pytest.fixture
def root(tmp_path):
    leave_sweep(tmp_path / "home" / "sweep", priors=["smooth"], ns=[100], seeds=[0, 1])
    return tmp_path / "home"


def test_a_removed_run_is_gone_and_the_others_are_there(root):
    found = entries(root)
    tidy.check_movable(found[:1], [root])
    tidy.remove(found[0])
    assert [entry.path for entry in entries(root)] == [found[1].path]


def test_a_run_that_another_command_removes_too_is_gone(root, monkeypatch):
    whole = shutil.rmtree

    def other(path, **_):
        monkeypatch.undo()
        whole(path)
        raise FileNotFoundError(2, "No such file or directory", str(path))

    found = entries(root)
    monkeypatch.setattr(shutil, "rmtree", other)
    tidy.remove(found[0])
    tidy.remove(found[0])
    assert tidy.bytes_of(found[0]) == 0
    assert [entry.path for entry in entries(root)] == [found[1].path]


@pytest.mark.parametrize("folders_seen", range(3))
def test_the_size_of_a_run_that_is_removed_meanwhile_is_what_was_seen(root, monkeypatch, folders_seen):
    found, calls, scandir = entries(root)[0], [], os.scandir
    for name in ("one", "two"):
        (path := Path(found.path, "images", name)).mkdir(parents=True)
        (path / "image.png").write_bytes(b"0" * 10**6)

    def removed(folder):
        calls.append(folder)
        if len(calls) == folders_seen + 1:
            monkeypatch.undo()
            shutil.rmtree(found.path)
        return scandir(folder)

    monkeypatch.setattr(os, "scandir", removed)
    assert tidy.bytes_of(found) < 10**6
    assert not Path(found.path).exists()


def test_a_run_that_was_there_before_takes_the_place_of_one_that_is_removed(root):
    folder = root / "sweep" / "1"
    for k in range(3):  # each in the place of the one before
        (folder / "summary.json").unlink()
        leave(root / f"new{k}", seed=10 + k, status="complete" if k < 2 else "failed")
        os.replace(root / f"new{k}" / "summary.json", folder / "summary.json")
        (root / f"new{k}").rmdir()
        if k < 2:
            (folder / "run.rrd").write_text(f"run {k}")
            set_aside(folder)
            (folder / "summary.json").write_text("{}")
    (folder / "run.log").write_text("of the last")
    (folder / ".hydra").mkdir()
    for seed, left in ((12, "run 1"), (11, "run 0")):
        entry = entries(folder)[0]
        assert entry.seed == seed
        tidy.check_movable([entry], [root])
        assert tidy.goes_with(entry).startswith("the run that was there before, ")
        tidy.remove(entry)
        assert (folder / "run.rrd").read_text() == left
        assert not (folder / "run.log").exists()
    assert tidy.goes_with(entries(folder)[0]) == ""
    tidy.remove(entries(folder)[0])
    assert os.listdir(root / "sweep") == ["0"]


def test_what_an_attempt_recorded_is_told_before_it_is_removed_with_its_run(root):
    entry = entries(root)[0]
    before = Path(entry.path, EARLIER)
    before.mkdir()
    assert tidy.goes_with(entry) == ""
    (before / "1.rrd.part").write_bytes(b"0" * 1000)
    assert "what an earlier attempt recorded" in tidy.goes_with(entry)
    assert tidy.bytes_of(entry) > 1000
    tidy.remove(entry)
    assert not Path(entry.path).exists()


def test_a_baseline_is_never_touched(root):
    leave(root / "baselines" / "a", day=20)
    with pytest.raises(InputError, match="is a baseline"):
        tidy.check_movable(entries(root), [root])


def test_a_run_at_work_is_not_touched(root):
    with locked(leave(root / "busy", status="running")), pytest.raises(InputError, match="found one at work"):
        tidy.check_movable(entries(root), [root])


def test_a_run_that_was_killed_is_removed(root):
    leave(root / "killed", status="running")
    found = [entry for entry in entries(root) if entry.status == "killed"]
    tidy.check_movable(found, [root])
    tidy.remove(found[0])
    assert not (root / "killed").exists()


def test_a_run_that_has_begun_again_since_is_not_touched(root):
    found = entries(root)
    leave(root / "again", status="running")
    os.replace(root / "again" / "summary.json", root / "sweep" / "1" / "summary.json")
    with locked(root / "sweep" / "1"), pytest.raises(InputError, match="is at work in this folder"):
        tidy.remove(found[0])
    assert (root / "sweep" / "1").is_dir()


def test_what_lies_elsewhere_is_not_touched(root, tmp_path):
    outside = leave(tmp_path / "outside" / "a")
    with pytest.raises(InputError, match="leads out of"):
        tidy.check_movable(entries(outside), [root])
    (root / "link").symlink_to(outside)
    assert len(entries(root)) == 2  # links are not followed
    with pytest.raises(InputError, match="leads out of"):
        tidy.check_movable(entries(root / "link"), [root])


def test_a_run_that_others_lie_in_is_not_touched(root):
    leave(root / "outer")
    leave(root / "outer" / "deep" / "inner")
    with pytest.raises(InputError, match="another run lies in it"):
        tidy.check_movable([entry for entry in entries(root) if entry.path.endswith("outer")], [root])


def test_a_run_that_another_has_taken_the_place_of_is_not_touched(root):
    found = entries(root)
    (root / "sweep" / "1" / "summary.json").unlink()
    leave(root / "again", day=2, identity="another")
    os.replace(root / "again" / "summary.json", root / "sweep" / "1" / "summary.json")
    with pytest.raises(InputError, match=r"sweep/1: another run came there since it was listed"):
        tidy.remove(found[0])
    assert (root / "sweep" / "1" / "summary.json").is_file()


def test_a_folder_that_another_command_works_in_is_not_touched(root):
    found = entries(root)
    with locked(Path(found[0].path)), pytest.raises(InputError, match="is at work in this folder"):
        tidy.remove(found[0])
    tidy.remove(found[0])


def test_a_run_may_begin_where_one_is_being_deleted(root, monkeypatch):
    found, whole = entries(root)[0], shutil.rmtree

    def begun(folder, **options):
        assert not Path(found.path).exists()
        assert [entry.path for entry in entries(root)] == [str(root / "sweep" / "0")]
        leave(Path(found.path), seed=7)
        monkeypatch.undo()
        whole(folder, **options)

    monkeypatch.setattr(shutil, "rmtree", begun)
    tidy.remove(found)
    assert sorted(os.listdir(root / "sweep")) == ["0", "1"]
    assert entries(root / "sweep" / "1")[0].seed == 7


def test_what_a_killed_command_did_not_come_to_delete_is_deleted_by_the_next(root, monkeypatch):
    def killed(_):
        raise KeyboardInterrupt

    found = entries(root)
    monkeypatch.setattr(shutil, "rmtree", killed)
    with pytest.raises(KeyboardInterrupt):
        tidy.remove(found[0])
    monkeypatch.undo()
    tidy.remove(found[1])
    assert os.listdir(root / "sweep") == []
