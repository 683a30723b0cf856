"""One lock for each folder of a run or sweep, held by the process at work in it.

The operating system releases the lock when the process ends, however that happens, so a folder that is not locked has
no process at work. On a network file system this needs locks that all machines share, as NFS has by default.
"""

import fcntl
import os
import platform
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from io import FileIO
from pathlib import Path
from time import monotonic, sleep

from workbench.utils.errors import InputError
from workbench.utils.run_files import LOCK

_PATIENCE_S = 0.1  # as a process that only tests the lock holds it for a moment


@contextmanager
def locked(folder: Path, wait: bool = False) -> Iterator[None]:
    """Hold the lock of an existing folder until the block ends; wait: while another process holds it.

    Raises InputError, which names the process that holds the lock, or why the folder cannot be locked.
    """
    with ExitStack() as held:
        try:
            file = held.enter_context(FileIO(folder / LOCK, "a+"))  # unbuffered: a full disk leaves nothing to write
            _acquire(file, wait)
        except BlockingIOError:
            holder = (folder / LOCK).read_text() or "another process"
            raise InputError(f"{folder}: {holder} is at work in this folder; wait for it or choose another") from None
        except OSError as error:
            raise InputError(f"{folder}: cannot be locked: {error.strerror}") from None
        with suppress(OSError):
            file.truncate(0)
            file.write(f"process {os.getpid()} on {platform.node()}".encode())
        yield


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


def is_locked(folder: Path) -> bool:
    """Return whether a process, this one included, holds the lock of the folder."""
    try:
        with (folder / LOCK).open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError as error:
        return isinstance(error, BlockingIOError)
    return False


def _acquire(file: FileIO, wait: bool) -> None:
    end = monotonic() + _PATIENCE_S
    while not wait and monotonic() < end:
        with suppress(BlockingIOError):
            return fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        sleep(_PATIENCE_S / 10)
    fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
