"""Lock on the folder of a run or sweep, held by the process that uses it.

The operating system releases the lock when the process ends in any way, so no process uses an unlocked folder. Network
file systems must share locks between machines, as NFS does by default.
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

_RETRY_S = 0.1  # a process that tests the lock holds it briefly


@contextmanager
def locked(folder: Path, wait: bool = False) -> Iterator[None]:
    """Hold the lock of an existing folder during the block; wait: until other processes release it.

    Raises InputError, with the process that holds the lock, or if the folder cannot be locked.
    """
    with ExitStack() as stack:
        try:
            file = stack.enter_context(FileIO(folder / LOCK, "a+"))  # unbuffered: no write is pending on a full disk
            _acquire(file, wait)
        except BlockingIOError:
            holder = (folder / LOCK).read_text() or "another process"
            raise InputError(f"{folder}: {holder} uses this folder; wait for it or choose another folder") from None
        except OSError as error:
            raise InputError(f"{folder}: cannot be locked: {error.strerror}") from None
        with suppress(OSError):
            file.truncate(0)
            file.write(f"process {os.getpid()} on {platform.node()}".encode())
        yield


@contextmanager
def run_folder(folder: Path) -> Iterator[None]:
    """Create the folder if needed, and hold its lock during the block.

    Raises InputError if another process uses it, or if it cannot be created.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: the folder cannot be created: {error.strerror}") from None
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
    end = monotonic() + _RETRY_S
    while not wait and monotonic() < end:
        with suppress(BlockingIOError):
            return fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        sleep(_RETRY_S / 10)
    fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
