"""Lock on the folder of a run or sweep, held by the process that uses it.

The operating system releases the lock when the process ends in any way, so no process uses an unlocked folder. Network
file systems must share locks between machines, as NFS does by default.
"""

import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from workbench.utils.errors import InputError
from workbench.utils.run_files import LOCK

_RETRY_S = 0.1  # a process that tests the lock holds it briefly


@contextmanager
def locked(folder: Path, wait: bool = False) -> Iterator[None]:
    """Hold the lock of an existing folder during the block; wait: until other processes release it.

    Raises InputError, with the process that holds the lock, or if the folder cannot be locked.
    """
    lock = FileLock(folder / LOCK, timeout=-1.0 if wait else _RETRY_S, poll_interval=0.1 * _RETRY_S)
    try:
        lock.acquire()
    except Timeout:
        raise InputError(f"{folder}: {_holder(folder)} uses this folder; wait for it or choose another one") from None
    except OSError as error:
        raise InputError(f"{folder}: cannot be locked: {error.strerror}") from None
    try:
        with suppress(OSError):  # a full disk
            (folder / LOCK).write_text(f"process {os.getpid()} on {platform.node()}", encoding="utf-8")
        yield
    finally:
        lock.release()


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
    if not (folder / LOCK).is_file():  # it would be created
        return False
    try:
        with FileLock(folder / LOCK, timeout=0.0):
            return False
    except Timeout:
        return True
    except OSError:
        return False


def _holder(folder: Path) -> str:
    """Return the process that holds the lock of a folder; on Windows only the holder can read its file."""
    try:
        return (folder / LOCK).read_text(encoding="utf-8") or "another process"
    except OSError:
        return "another process"
