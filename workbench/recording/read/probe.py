"""Find the recordings whose bytes are damaged so that Rerun's decoder does not survive reading them."""

import os
import resource
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from workbench.errors import InputError
from workbench.recording.read.reader import Run, Unreadable, find_recordings, read, read_each

_MOST_BYTES = 4_000_000_000
_LONGEST_S, _SLOWEST_BYTES_S = 20, 5_000_000  # to read a file, and for each second more


def open_sound_runs(*places: str | Path) -> tuple[list[Run], list[Unreadable]]:
    """Read recordings as `open_runs` does, but those that end whoever reads them count as unreadable."""
    paths = find_recordings(*places)
    damaged = fatal(paths)
    runs, problems = read_each(path for path in paths if path not in damaged)
    problems += [Unreadable(path, _damage(path)) for path in damaged]
    return runs, sorted(problems, key=lambda problem: problem.path)


def read_sound_run(path: Path) -> Run:
    """Read a recording; raises InputError also for one that ends whoever reads it."""
    if path.is_file() and fatal([path]):
        raise InputError(_damage(path))
    return read(path)


def _damage(path: Path) -> str:
    return f"{path}: expected a whole recording, found damage that crashes whoever reads it"


def fatal(paths: Sequence[Path]) -> set[Path]:
    """Find those of the recordings that end whoever reads them, by an error that is no InputError or without any.

    A flipped bit can make the decoder ask for more memory than there is, on which it aborts without raising, or never
    come back; so another process goes first, which may take so much memory and time, and a new one goes on behind
    every file that one does not survive.
    """
    found: set[Path] = set()
    left = list(paths)
    while left:
        command, names = [sys.executable, "-P", "-m", __name__], b"\0".join(map(os.fsencode, left))
        told = subprocess.run(command, input=names, capture_output=True, check=False).stdout.split()
        found |= {path for path, word in zip(left, told, strict=False) if word == b"damaged"}
        found |= set(left[len(told) : len(told) + 1])
        left = left[len(told) + 1 :]
    return found


def read_all(path: Path) -> Run:
    """Read a recording with everything that `Run` knows of it; raises InputError as that does."""
    run = read(path)
    if not run.is_study:
        _ = run.poses
    _ = run.settings, run.joints, run.true_joints, run.scalars, run.marginals, run.figures, run.note
    return run


def main(paths: Sequence[Path]) -> None:
    """Read the recordings one by one and print after each whether reading it again is safe.

    The operating system ends the process, and so tells the one that began it, when a file takes too much.
    """
    sizes = [path.stat().st_size if path.is_file() else 0 for path in paths]
    most, (_, hard) = _MOST_BYTES + 4 * max(sizes, default=0), resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))
    for path, size in zip(paths, sizes, strict=True):
        signal.alarm(_LONGEST_S + size // _SLOWEST_BYTES_S)
        outcome = "read"
        try:
            read_all(path)
        except InputError:
            pass  # whoever reads it next is told what is wrong with it
        except Exception:  # noqa: BLE001 (damaged values lead anywhere)
            outcome = "damaged"
        print(outcome, flush=True)


if __name__ == "__main__":
    main([Path(os.fsdecode(name)) for name in sys.stdin.buffer.read().split(b"\0")])
