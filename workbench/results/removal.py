"""Delete runs, none of them outside the folders that were named."""

import os
import shutil
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from uuid import uuid4

import pandas as pd

from workbench.experiment.summary import earlier_names, earlier_runs
from workbench.results.table import read_run, runs_in
from workbench.utils.errors import InputError
from workbench.utils.run_files import EARLIER, LOCK, RECORDING, SUMMARY
from workbench.utils.run_lock import locked
from workbench.utils.signals import deferred

_REMOVED = ".removed-"
"""Prefix of a folder that is being deleted, which no reader of runs enters."""


def check_removable(runs: pd.DataFrame, places: Sequence[Path]) -> None:
    """Raise InputError for a baseline, a run at work, one outside `places`, and one that holds others."""
    for path, status in zip(map(Path, runs["path"]), runs["status"], strict=True):
        if status == "running":
            raise InputError(f"{path}: expected a run that has ended, found one at work")
        if "baselines" in path.resolve().parts:
            raise InputError(f"{path}: is a baseline, which is never changed here")
        if path.is_symlink() or not any(_within(path.resolve(), place.resolve()) for place in places):
            raise InputError(f"{path}: leads out of the folders that were named")
        inner = [run for run in runs_in(path) if str(path) not in (run, os.path.dirname(run))]
        if path.is_dir() and inner:
            raise InputError(f"{path}: another run lies in it: {inner[0]}")


def size_of(path: Path) -> int:
    """Return the bytes that a run takes on the disk, without the earlier runs in its folder."""
    stay = {str(each) for each in earlier_runs(path)}
    below = [Path(folder, name) for folder, _, files in os.walk(path) if folder not in stay for name in files]
    return sum(file.lstat().st_size for file in (below or [path]) if file.is_symlink() or file.is_file())


def consequence(path: Path) -> str:
    """Return what else happens to a folder when its run is removed; empty where nothing does."""
    if earlier := earlier_runs(path):
        return f"the run that was there before, {earlier[-1]}, takes its place"
    if any(name.endswith(".part") for name in earlier_names(path)):
        return "with what an earlier attempt recorded, from which sweep.resume would go on"
    return ""


def remove(path: Path, started: str) -> None:
    """Delete a run's folder, or its recording where it has no folder; `check_removable` comes first.

    The complete run that the folder held before takes its place. The folder is renamed first, so that no reader sees
    half of it and a new run can begin. Raises InputError for a run that cannot be removed, that is at work, or that
    did not start at `started`, when the one that was listed did.
    """
    aside = path.with_name(f"{_REMOVED}{uuid4().hex}")
    try:
        with locked(path) if path.is_dir() else nullcontext():
            if path.is_dir() and (now := read_run(path)) is not None and now["started"] != started:
                raise InputError(f"{path}: another run came there since it was listed")
            _move_aside(path, aside)
        aside.unlink() if aside.is_file() else shutil.rmtree(aside)
        for left in path.parent.glob(f"{_REMOVED}*"):  # by a command that was killed
            shutil.rmtree(left, ignore_errors=True)
    except FileNotFoundError:  # another command has removed it
        return
    except OSError as error:
        raise InputError(f"{path}: cannot be removed: {error.strerror}") from None


def _move_aside(path: Path, aside: Path) -> None:
    """Rename a run's folder or recording; where earlier runs stay, move only the run's own files, and restore one."""
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
