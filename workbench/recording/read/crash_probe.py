"""Test decoding of untrusted recordings in a sandbox, since some damage crashes Rerun's decoder or fills the memory."""

import platform
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from workbench.recording.read.chunks import EVERYTHING, read_chunks
from workbench.recording.read.reader import Run, Unreadable, find_recordings, read, recording_at
from workbench.utils.arrays import AnyArray
from workbench.utils.errors import InputError
from workbench.utils.process_limits import peak_bytes
from workbench.utils.run_files import read_summary
from workbench.utils.sandbox import parse_limited

_BATCH = 20  # recordings that one child process decodes
_MEMORY_BYTES = 400_000_000  # of decoding a batch, plus ten times the size of its files


def open_sound_runs(*places: str | Path) -> tuple[list[Run], list[Unreadable]]:
    """Return all recordings in these files and below these folders, sorted by path, and the unreadable ones.

    A recording is a file .rrd or, of an incomplete run, .rrd.part. Raises InputError for a place that does not exist.
    """
    paths = find_recordings(*places)
    crashing = crashing_recordings(paths)
    runs, problems = list[Run](), [Unreadable(path, crash_message(path)) for path in crashing]
    for path in paths:
        if path not in crashing:
            try:
                runs.append(read(path))
            except InputError as error:
                problems.append(Unreadable(path, str(error)))
    return runs, sorted(problems, key=lambda problem: problem.path)


def read_sound_run(path: Path) -> Run:
    """Read a recording, see `read`; raises InputError also for one whose decoding crashes."""
    path = recording_at(path)
    if crashing_recordings([path]):
        raise InputError(crash_message(path))
    return read(path)


def crash_message(path: Path) -> str:
    """Return the message for a recording whose decoding crashes."""
    return f"{path}: expected a whole recording, found damage that crashes its decoder or fills the memory"


def crashing_recordings(paths: Sequence[Path]) -> set[Path]:
    """Return the recordings whose decoding crashes, takes too much time or memory, or raises an unexpected error.

    Recordings of runs on this machine, by the summary in their folder, are trusted and not decoded. One child process
    decodes several recordings.
    """
    untrusted = [path for path in paths if path.is_file() and not is_own(path)]
    return {each for k in range(0, len(untrusted), _BATCH) for each in _crashing(untrusted[k : k + _BATCH])}


def _crashing(paths: Sequence[Path]) -> list[Path]:
    """Return the recordings that crash a child process, by bisection."""
    try:
        parse_limited(decode, *paths, what="a whole recording")
        return []
    except InputError:
        half = len(paths) // 2
        return [*_crashing(paths[:half]), *_crashing(paths[half:])] if half else list(paths)


def is_own(path: Path) -> bool:
    """Return whether a run on this machine made the recording, by its summary.json."""
    return (read_summary(path.parent) or {}).get("host") == platform.node()


def decode(*paths: Path) -> dict[str, AnyArray]:
    """Decode recordings completely; an InputError is ignored, since the reader raises it again.

    Raises MemoryError where decoding takes far more memory than the size of the files explains: a flipped bit of a
    length makes the decoder reserve gigabytes before it reports the damage.
    """
    most = peak_bytes() + _MEMORY_BYTES + 10 * sum(path.stat().st_size for path in paths)
    for path in paths:
        with suppress(InputError):
            run = read(path)
            if not run.is_study:
                _ = run.poses
            _ = run.settings, run.joints, run.true_joints, run.scalars, run.marginals, run.figures, run.note
        with suppress(InputError):
            for chunk in read_chunks(path, EVERYTHING):
                chunk.to_record_batch()
    if peak_bytes() > most:
        raise MemoryError("decoding takes far more memory than the file has bytes")
    return {}
