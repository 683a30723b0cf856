"""The folder of a run: one run at a time works in it, and a complete run that it holds is not lost."""

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

from workbench.utils.errors import InputError
from workbench.utils.run_files import EARLIER, RECORDING, SUMMARY
from workbench.utils.run_lock import locked
from workbench.utils.signals import deferred

log = logging.getLogger(__name__)


@contextmanager
def run_folder(folder: Path) -> Iterator[None]:
    """Make the folder where there is none, and hold its lock until the block ends.

    Raises InputError where another process is at work in it, or where it cannot be the folder of a run.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be the folder of a run: {error.strerror}") from None
    with locked(folder):
        yield


def earlier_runs(folder: Path) -> list[Path]:
    """Return the folders of complete runs that a folder held before its own, the oldest first."""
    numbers = sorted((name for name in earlier_names(folder) if name.isdecimal()), key=int)
    return [each for name in numbers if ((each := folder / EARLIER / name) / RECORDING).is_file()]


def earlier_names(folder: Path) -> list[str]:
    """Return the names of the earlier runs and attempts in a folder; none where it does not exist."""
    return [each.name for each in (folder / EARLIER).glob("*")]


def set_aside(folder: Path) -> None:
    """Move a complete run to EARLIER, its summary first, which alone would describe what is not there."""
    if not (folder / RECORDING).is_file():
        return
    aside = next(place for k in count(1) if not (place := folder / EARLIER / str(k)).exists())
    aside.mkdir(parents=True)
    with deferred():
        for name in (SUMMARY, RECORDING):
            if (folder / name).is_file():
                os.replace(folder / name, aside / name)
    log.warning("%s: held a complete run, which is now in %s", folder, aside)
