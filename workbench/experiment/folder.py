"""The folder of a run: one run at a time works in it, and a run that it holds already is not lost."""

import fcntl
import logging
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

from workbench.errors import InputError
from workbench.signals import deferred

log = logging.getLogger(__name__)

LOCK = ".taken"
BEFORE = ".before"
"""Where in the folder earlier runs are kept, numbered; readers of recordings look into no hidden folder."""
RUN = ("run.rrd", "summary.json")
"""What is kept of one: what tells of it last."""


def earlier_runs(folder: Path) -> list[Path]:
    """The complete runs that a folder held before its own, the oldest first."""
    numbers = sorted((name for name in kept_before(folder) if name.isdecimal()), key=int)
    found = (folder / BEFORE / name for name in numbers)
    return [each for each in found if (each / RUN[0]).is_file()]


def kept_before(folder: Path) -> list[str]:
    """The names of what a folder keeps of earlier runs and attempts; none where it is gone."""
    try:
        return os.listdir(folder / BEFORE)
    except (FileNotFoundError, NotADirectoryError):
        return []


@contextmanager
def taken(folder: Path) -> Iterator[None]:
    """Keep the folder, made where there is none, for this process until the block ends; tell what it held.

    The operating system gives it free when the process ends, however that comes. Raises InputError, which says who
    works in it, or why it cannot be used.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = (folder / LOCK).open("a+")
    except OSError as error:
        raise InputError(f"{folder}: cannot be the folder of a run: {error.strerror}") from None
    with file:
        _lock(file.fileno(), fcntl.LOCK_EX, folder)
        file.truncate(0)
        file.write(f"process {os.getpid()} on {platform.node()}")
        file.flush()
        _set_aside(folder)
        yield


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Keep runs from beginning in the folder of a run that has ended, until the block ends.

    One that cannot be written to is as it is, as no run can begin there. Raises InputError where a run or another
    command is at work in it, FileNotFoundError where it is gone.
    """
    folder.stat()
    if not os.access(folder, os.W_OK):
        yield
        return
    with (folder / LOCK).open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(f"{folder}: expected a run that has ended, found it or another command at work") from None
        yield


def refuse_if_taken(folder: Path) -> None:
    """Raise InputError, which says who, where a run works in the folder."""
    if (folder / LOCK).is_file():
        with (folder / LOCK).open() as file:
            _lock(file.fileno(), fcntl.LOCK_SH, folder)


def _lock(file: int, how: int, folder: Path) -> None:
    try:
        fcntl.flock(file, how | fcntl.LOCK_NB)
    except BlockingIOError:
        who = (folder / LOCK).read_text() or "another one"
        raise InputError(f"{folder}: a run is at work there, {who}; choose another by hydra.run.dir=FOLDER") from None


def _set_aside(folder: Path) -> None:
    """Move a run that ended well out of the way, its summary first, which alone would say what is not there."""
    if (folder / RUN[0]).is_file():
        aside = next(place for k in count(1) if not (place := folder / BEFORE / str(k)).exists())
        aside.mkdir(parents=True)
        with deferred():
            for name in reversed(RUN):
                if (folder / name).is_file():
                    os.replace(folder / name, aside / name)
        log.warning("%s: held a complete run, which is now in %s", folder, aside)
