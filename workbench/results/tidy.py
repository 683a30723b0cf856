"""Delete runs, none of them outside the folders that were named."""

import os
import shutil
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from uuid import uuid4

from workbench.experiment.summary import earlier_names, earlier_runs
from workbench.results.entry import Entry, entry_of_folder
from workbench.results.index import runs_in
from workbench.utils.errors import InputError
from workbench.utils.run_files import EARLIER, LOCK, RECORDING, SUMMARY
from workbench.utils.run_lock import locked
from workbench.utils.signals import deferred

BASELINES = "baselines"
_REMOVED = ".removed-"
"""How a folder is called, where no reader looks, while what is in it is deleted."""


def check_movable(entries: Iterable[Entry], places: Sequence[Path]) -> None:
    """Raise InputError for a run that must not be touched: a baseline, one at work, one that lies elsewhere.

    places: the folders that were named. A run that is reached by a link, or that other runs lie in, is refused, too.
    """
    for entry in entries:
        path = Path(entry.path)
        if entry.status == "running":
            raise InputError(f"{path}: expected a run that has ended, found one at work")
        if BASELINES in path.resolve().parts:
            raise InputError(f"{path}: is a baseline, which is never changed here")
        if path.is_symlink() or not any(_within(path, place) for place in places):
            raise InputError(f"{path}: leads out of the folders that were named")
        if path.is_dir() and (inner := _runs_inside(path)):
            raise InputError(f"{path}: another run lies in it: {inner[0]}")


def bytes_of(entry: Entry) -> int:
    """What a run takes on the disk, without earlier ones in its folder and what another command removes meanwhile."""
    stay = {str(each) for each in earlier_runs(Path(entry.path))}
    below = [
        os.path.join(folder, name) for folder, _, files in os.walk(entry.path) if folder not in stay for name in files
    ]
    sizes = list[int]()
    for file in below if os.path.isdir(entry.path) else [entry.path]:
        with suppress(FileNotFoundError):
            sizes.append(os.lstat(file).st_size)
    return sum(sizes)


def goes_with(entry: Entry) -> str:
    """Tell what else lies in a run's folder that nobody listed, and what becomes of it when the run is removed."""
    if earlier := earlier_runs(Path(entry.path)):
        return f"the run that was there before, {earlier[-1]}, takes its place"
    if any(name.endswith(".part") for name in earlier_names(Path(entry.path))):
        return "with what an earlier attempt recorded, from which sweep.resume would go on"
    return ""


def remove(entry: Entry) -> None:
    """Delete a run's folder, or its recording where that lies by itself; see `check_movable`, to be asked first.

    A complete run that the folder held before takes its place. What an attempt at the same run recorded goes with it.
    A folder is renamed first, so that nobody sees half of one, or begins a run in it. Raises InputError for one that
    cannot be removed, or that has begun to run again since it was listed.
    """
    path = Path(entry.path)
    apart = path.with_name(f"{_REMOVED}{uuid4().hex}")
    try:
        with _unchanged(entry):
            _set_apart(path, apart) if path.is_dir() else path.unlink()
    except FileNotFoundError:  # another command has removed it
        return
    except OSError as error:
        raise InputError(f"{path}: cannot be removed: {error.strerror}") from None
    _delete(apart)
    for left in path.parent.glob(f"{_REMOVED}*"):  # by a command that was killed
        shutil.rmtree(left, ignore_errors=True)


def _set_apart(path: Path, apart: Path) -> None:
    """Rename a run's folder, or what in it is the run's own where earlier runs are to stay; no run may begin in it."""
    if not (earlier := earlier_runs(path)):
        os.rename(path, apart)
        return
    apart.mkdir()
    with deferred():
        for each in os.listdir(path):
            if each not in (EARLIER, LOCK):
                os.rename(path / each, apart / each)
        for name in (RECORDING, SUMMARY):
            if (earlier[-1] / name).is_file():
                os.rename(earlier[-1] / name, path / name)
    shutil.rmtree(earlier[-1])


def _delete(folder: Path) -> None:
    while folder.exists():
        try:
            shutil.rmtree(folder)
        except FileNotFoundError:  # another command deletes it, too
            continue
        except OSError as error:
            raise InputError(f"{folder}: cannot be removed: {error.strerror}") from None


@contextmanager
def _unchanged(entry: Entry) -> Iterator[None]:
    """Keep other runs out of a run's folder until the block ends.

    Raises InputError where one is at work there or has been since the run was listed, FileNotFoundError where it is
    gone.
    """
    path = Path(entry.path)
    path.stat()
    if not path.is_dir():
        yield
        return
    with locked(path):
        now = entry_of_folder(path)
        if (now.started, now.origin.get("identity")) != (entry.started, entry.origin.get("identity")):
            raise InputError(f"{path}: another run came there since it was listed")
        yield


def _within(path: Path, place: Path) -> bool:
    real, root = path.resolve(), place.resolve()
    return real != root and real.is_relative_to(root) if root.is_dir() else real == root


def _runs_inside(folder: Path) -> list[str]:
    """Find the runs below a run's own folder, which should be none."""
    return [run for run in runs_in(folder) if str(folder) not in (run, os.path.dirname(run))]
