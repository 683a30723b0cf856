"""Find the recordings whose bytes are damaged so that Rerun's decoder does not survive reading them."""

import os
import resource
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from workbench.errors import InputError
from workbench.recording.read.chunks import EVERYTHING, read_chunks
from workbench.recording.read.reader import Run, Unreadable, find_recordings, read, read_each

_MOST_BYTES = 4_000_000_000
_LONGEST_S, _SLOWEST_BYTES_S = 5, 5_000_000  # of the processor, to read a file, and for each second more
_PATIENCE = 20  # times as long, where the machine has no time for it


def open_sound_runs(*places: str | Path) -> tuple[list[Run], list[Unreadable]]:
    """Read recordings as `open_runs` does, but those that end whoever reads them count as unreadable."""
    paths = find_recordings(*places)
    damaged = fatal(paths)
    runs, problems = read_each(path for path in paths if path not in damaged)
    problems += [Unreadable(path, damage(path)) for path in damaged]
    return runs, sorted(problems, key=lambda problem: problem.path)


def read_sound_run(path: Path, whole: bool = False) -> Run:
    """Read a recording; raises InputError also for one that ends whoever reads it. whole: see `fatal`."""
    if path.is_file():
        refuse_fatal([path], whole)
    return read(path)


def refuse_fatal(paths: Sequence[Path], whole: bool) -> None:
    """Raise InputError where one of the recordings ends whoever reads it. whole: see `fatal`."""
    if damaged := fatal(paths, whole):
        raise InputError(damage(min(damaged)))


def damage(path: Path) -> str:
    """Say what is wrong with a recording that `fatal` finds."""
    return f"{path}: expected a whole recording, found damage that crashes whoever reads it"


def fatal(paths: Sequence[Path], whole: bool = False) -> set[Path]:
    """Find those of the recordings that end whoever reads them, by an error that is no InputError or without any.

    whole: all that is in them is to be read, pictures, checkpoints and what others wrote, too; else what `Run` knows.

    A flipped bit can make the decoder ask for more memory than there is, on which it aborts without raising, or never
    come back; so another process goes first, which may take so much memory and time, and a new one goes on behind
    every file that one does not survive.
    """
    found: set[Path] = set()
    left = list(paths)
    while left:
        command = [sys.executable, "-P", "-m", __name__, *(["whole"] if whole else [])]
        names = b"\0".join(os.fsencode(path) for path in left)
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


def main(paths: Sequence[Path], whole: bool = False) -> None:
    """Read the recordings one by one and print after each whether reading it again is safe.

    The operating system ends the process, and so tells the one that began it, when a file takes too much.
    """
    sizes = [path.stat().st_size if path.is_file() else 0 for path in paths]
    most, (_, hard) = _MOST_BYTES + 4 * max(sizes, default=0), resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))
    for path, size in zip(paths, sizes, strict=True):
        longest_s = _LONGEST_S + size // _SLOWEST_BYTES_S
        signal.setitimer(signal.ITIMER_PROF, longest_s)
        signal.alarm(_PATIENCE * longest_s)
        outcome = "read"
        try:
            read_all(path)
            if whole:
                for chunk in read_chunks(path, EVERYTHING):
                    chunk.to_record_batch()
        except InputError:
            pass  # whoever reads it next is told what is wrong with it
        except Exception:  # noqa: BLE001 (damaged values lead anywhere)
            outcome = "damaged"
        print(outcome, flush=True)


if __name__ == "__main__":
    main([Path(os.fsdecode(name)) for name in sys.stdin.buffer.read().split(b"\0")], whole=sys.argv[1:] == ["whole"])
