"""Making room touches the runs that were named and nothing else."""

import os
import shutil
import tarfile
from pathlib import Path

import pytest
from run_folders import leave, leave_sweep

from workbench.catalog import tidy
from workbench.catalog.index import entries
from workbench.errors import InputError


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

    def other(path):
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


def test_a_baseline_is_never_touched(root):
    leave(root / "baselines" / "a", day=20)
    with pytest.raises(InputError, match="is a baseline"):
        tidy.check_movable(entries(root), [root])


def test_a_run_at_work_is_not_touched(root):
    leave(root / "busy", status="running")
    with pytest.raises(InputError, match="found one at work"):
        tidy.check_movable(entries(root), [root])


def test_a_run_that_has_begun_again_since_is_not_touched(root):
    found = entries(root)
    leave(root / "again", status="running")
    os.replace(root / "again" / "summary.json", root / "sweep" / "1" / "summary.json")
    with pytest.raises(InputError, match="found one at work"):
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


def test_an_archive_holds_the_runs_by_their_names(root, tmp_path):
    file = tmp_path / "runs.tar.gz"
    tidy.archive(entries(root), file)
    with tarfile.open(file) as tar:
        assert {"0/summary.json", "1/summary.json"} <= set(tar.getnames())
    assert len(entries(root)) == 2
    with pytest.raises(InputError, match="is there already"):
        tidy.archive(entries(root), file)
