"""Deletion of runs inside the folders that a command names."""

import os
import shutil
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from uuid import uuid4

import pandas as pd

from workbench.experiment.summary import earlier_runs
from workbench.results.table import read_run, runs_in
from workbench.utils.errors import InputError
from workbench.utils.run_files import EARLIER, LOCK, RECORDING, SUMMARY
from workbench.utils.run_lock import locked
from workbench.utils.signals import deferred

_REMOVED = ".removed-"
"""Prefix of a folder that is being deleted; readers of runs ignore it."""


def check_removable(runs: pd.DataFrame, places: Sequence[Path]) -> None:
    """Raise InputError for a baseline, a running run, a run outside `places`, and one that contains others."""
    for path, status in zip(map(Path, runs["path"]), runs["status"], strict=True):
        if status == "running":
            raise InputError(f"{path}: expected a run that has ended, found a running one")
        if "baselines" in path.resolve().parts:
            raise InputError(f"{path}: is a baseline, which this command does not delete")
        if path.is_symlink() or not any(_within(path.resolve(), place.resolve()) for place in places):
            raise InputError(f"{path}: expected a path inside the folders of the command")
        inner = [run for run in runs_in(path) if str(path) not in (run, os.path.dirname(run))]
        if path.is_dir() and inner:
            raise InputError(f"{path}: contains another run: {inner[0]}")


def size_of(path: Path) -> int:
    """Return a run's size on the disk, bytes, without the earlier runs in its folder."""
    earlier = {str(each) for each in earlier_runs(path)}
    below = [Path(folder, name) for folder, _, files in os.walk(path) if folder not in earlier for name in files]
    return sum(file.lstat().st_size for file in (below or [path]) if file.is_symlink() or file.is_file())


def remove(path: Path, started: str) -> None:
    """Delete a run's folder, or its recording where it has no folder, after `check_removable`.

    The last complete earlier run in the folder is restored. The folder is renamed first, so that no reader sees it
    incomplete and a new run can begin.

    Parameters
    ----------
    path : of the run.
    started : start of the listed run.

    Raises
    ------
    InputError : the run cannot be removed, is running, or has another start.
    """
    aside = path.with_name(f"{_REMOVED}{uuid4().hex}")
    try:
        with locked(path) if path.is_dir() else nullcontext():
            if path.is_dir() and (now := read_run(path)) is not None and now["started"] != started:
                raise InputError(f"{path}: another run has replaced the listed one")
            _move_aside(path, aside)
        aside.unlink() if aside.is_file() else shutil.rmtree(aside)
        for left in path.parent.glob(f"{_REMOVED}*"):  # of a killed command
            shutil.rmtree(left, ignore_errors=True)
    except FileNotFoundError:  # another command has removed it
        return
    except OSError as error:
        raise InputError(f"{path}: cannot be removed: {error.strerror}") from None


def _move_aside(path: Path, aside: Path) -> None:
    """Rename a run's folder or recording; with earlier runs in it, move the run's files and restore the last one."""
    if not (earlier := earlier_runs(path)):
        os.rename(path, aside)
        return
    aside.mkdir()
    with deferred():
        for each in os.listdir(path):
            if each not in (EARLIER, LOCK):
                os.rename(path / each, aside / each)
        for name in (RECORDING, SUMMARY):
            if (earlier[-1] / name).is_file():
                os.rename(earlier[-1] / name, path / name)
    shutil.rmtree(earlier[-1])


def _within(path: Path, place: Path) -> bool:
    return path != place and path.is_relative_to(place) if place.is_dir() else path == place
