"""Reading back what a run needs to be continued."""

import io
import json
import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np

from workbench.core.filter_state import Memory, Past
from workbench.recording.read.chunks import cells, curves, read_chunks
from workbench.recording.read.reader import Run
from workbench.recording.write.checkpoints import ARCHETYPE, EXPECTED, MEMORY, TOLD
from workbench.utils.arrays import AnyArray, FloatArray, IntArray
from workbench.utils.errors import InputError

MOST_BYTES = 2_000_000_000
"""Of a checkpoint's arrays; a recording may come from a stranger."""


def checkpoint_frames(run: Run) -> list[int]:
    """List the frames whose particles a recording holds, in order."""
    return sorted(_memories(run, "npz"))


def told(run: Run) -> tuple[IntArray, FloatArray]:
    """Read the poses (F, P) that were told of a run's frames (F,) and, where it goes on from a frame of another run and
    has checkpoints, of those before it."""
    frames, poses = run.poses
    before = curves(read_chunks(run.path, [f"/{TOLD}"])).get(TOLD)
    if before is None:
        return frames, poses
    if before.values.shape[1:] != poses.shape[1:]:
        raise InputError(f"{run.path}: expected poses of {poses.shape[1]} numbers in {TOLD}, found others")
    return np.concatenate([before.frames, frames]), np.concatenate([before.values, poses])


def past_before(run: Run, frame: int) -> Past | None:
    """Read the last checkpoint of a frame before this one; None where there is none. Raises InputError for one that is
    damaged."""
    packed, streams = _memories(run, "npz"), _memories(run, "streams")
    if not (frames := [each for each in packed if each < frame and each in streams]):
        return None
    last = max(frames)
    place = f"{run.path}: checkpoint of frame {last}"
    poses = _expected(run, last)
    if not len(poses):
        raise InputError(f"{place}: expected the poses of the frames before it, found none")
    arrays = _unpacked(packed[last].as_py()[0], place)
    return Past(poses, Memory(arrays, poses[-1], _parsed(streams[last].as_py()[0], place)))


def _memories(run: Run, component: str) -> Mapping[int, Any]:
    """Collect what was stored, by frame."""
    return cells(run.path, [f"/{MEMORY}"]).get(MEMORY, {}).get(f"{ARCHETYPE}:{component}", {})


def _expected(run: Run, last: int) -> FloatArray:
    """Read the poses (F, P) that the likelihood was told in the frames up to one."""
    frames, poses = told(run)
    found = dict(zip(frames.tolist(), poses, strict=True))
    if (own := curves(read_chunks(run.path, [f"/{EXPECTED}"])).get(EXPECTED)) is not None:
        found |= dict(zip(own.frames.tolist(), own.values, strict=True))
    return np.array([found[each] for each in sorted(found) if each <= last])


def _unpacked(packed: bytes, place: str) -> dict[str, AnyArray]:
    try:
        with zipfile.ZipFile(io.BytesIO(packed)) as file:
            size = sum(each.file_size for each in file.infolist())
        if size > MOST_BYTES:
            raise InputError(f"{place}: expected at most {MOST_BYTES} bytes of arrays, found {size}")
        with np.load(io.BytesIO(packed), allow_pickle=False) as arrays:
            return dict(arrays)
    except (OSError, ValueError, EOFError, KeyError, TypeError, zipfile.BadZipFile) as error:
        raise InputError(f"{place}: expected arrays, found {error}") from None


def _parsed(text: str, place: str) -> dict[str, dict[str, Any]]:
    try:
        found = json.loads(text)
    except (ValueError, TypeError, RecursionError):
        found = None
    if not isinstance(found, dict) or not all(isinstance(state, dict) for state in found.values()):
        raise InputError(f"{place}: expected the states of random streams, found something else")
    return found
