"""Whoever starts the jobs of a sweep, as the sweep's folder tells those who watch it: there, gone, or done with them.

Nothing else needs it: a sweep runs where it cannot be written.
"""

import json
import os
import platform
from contextlib import suppress
from pathlib import Path
from typing import Literal

from workbench.errors import InputError
from workbench.files import replace_text

FILE = ".starter"
"""In a sweep's folder: the process that starts its jobs."""

State = Literal["there", "gone", "done"]


def begin(folder: Path, needed: bool) -> None:
    """Write that this process starts the jobs of the sweep; needed: they end with it."""
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    _write(folder, os.getpid() if needed else None, done=False)


def leave(folder: Path) -> None:
    """Forget who started the jobs, which go on by themselves."""
    with suppress(OSError):
        (folder / FILE).unlink(missing_ok=True)


def end(folder: Path) -> None:
    """Write that no job is begun or waited for any more; nothing where the jobs were left to themselves."""
    if (folder / FILE).is_file():
        _write(folder, None, done=True)


def state_of(folder: Path) -> State | None:
    """What is known of whoever starts the jobs; None where nothing is, as of jobs that were left to themselves.

    One on another machine is there until it has said something else.
    """
    try:
        said = json.loads((folder / FILE).read_text(encoding="utf-8"))
        done, pid = said["done"], said["pid"]
        if done is True:
            return "done"
        if pid is not None and said["host"] == platform.node():
            os.kill(int(pid), 0)
    except ProcessLookupError:
        return "gone"
    except PermissionError:  # somebody else's process
        return "there"
    except (OSError, ValueError, TypeError, KeyError, OverflowError, RecursionError):
        return None
    return "there"


def _write(folder: Path, pid: int | None, done: bool) -> None:
    with suppress(InputError):
        replace_text(folder / FILE, json.dumps({"host": platform.node(), "pid": pid, "done": done}) + "\n")
