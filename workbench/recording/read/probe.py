"""Decode recordings made elsewhere in the sandbox first: some damage crashes Rerun's decoder."""

import json
import platform
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from workbench.arrays import AnyArray
from workbench.errors import InputError
from workbench.recording.read.chunks import EVERYTHING, read_chunks
from workbench.recording.read.reader import Run, Unreadable, find_recordings, read, read_each
from workbench.run_files import SUMMARY
from workbench.sandbox import parse_limited

_BATCH = 20  # recordings that one child process decodes


def open_sound_runs(*places: str | Path) -> tuple[list[Run], list[Unreadable]]:
    """Read recordings as `open_runs` does, those whose decoding crashes as unreadable."""
    paths = find_recordings(*places)
    crashing = fatal(paths)
    runs, problems = read_each(path for path in paths if path not in crashing)
    problems += [Unreadable(path, damage(path)) for path in crashing]
    return runs, sorted(problems, key=lambda problem: problem.path)


def read_sound_run(path: Path) -> Run:
    """Read a recording; raises InputError also for one whose decoding crashes."""
    if path.is_file():
        refuse_fatal([path])
    return read(path)


def refuse_fatal(paths: Sequence[Path]) -> None:
    """Raise InputError where decoding one of the recordings crashes."""
    if crashing := fatal(paths):
        raise InputError(damage(min(crashing)))


def damage(path: Path) -> str:
    """Return the message for a recording whose decoding crashes."""
    return f"{path}: expected a whole recording, found damage that crashes its decoder"


def fatal(paths: Sequence[Path]) -> set[Path]:
    """Return the recordings whose decoding crashes, takes too much time or memory, or raises an unknown error.

    Those of runs of this machine, by the summary in their folder, are not tried. One child decodes several of them;
    where it ends early, the next begins with the recording that this one was decoding.
    """
    pending, found = [path for path in paths if path.is_file() and not is_own(path)], set[Path]()
    with TemporaryDirectory() as folder:
        while pending:
            (decoded := Path(folder, "decoded")).write_bytes(b"")
            try:
                parse_limited(decode, *pending[:_BATCH], decoded, what="a whole recording")
                pending = pending[_BATCH:]
            except InputError:
                if (n := decoded.stat().st_size) == 0:
                    found.add(pending[0])
                pending = pending[max(n, 1) :]
    return found


def is_own(path: Path) -> bool:
    """Return whether a run of this machine left the recording, by its summary.json."""
    try:
        summary = json.loads(path.with_name(SUMMARY).read_text(encoding="utf-8"))
        return bool(summary["host"] == platform.node())
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return False


def decode(*paths: Path) -> dict[str, AnyArray]:
    """Decode all that is in recordings, and append a byte to the last of the files after each.

    Recordings that raise InputError are no danger: reading them raises it again.
    """
    for path in paths[:-1]:
        with suppress(InputError):
            run = read(path)
            if not run.is_study:
                _ = run.poses
            _ = run.settings, run.joints, run.true_joints, run.scalars, run.marginals, run.figures, run.note
        with suppress(InputError):
            for chunk in read_chunks(path, EVERYTHING):
                chunk.to_record_batch()
        with paths[-1].open("ab") as decoded:
            decoded.write(b".")
    return {}
