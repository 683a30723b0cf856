"""Checkpoints of recorded runs, and the frames of incomplete runs that a resumed run reuses."""

import io
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow.compute as pc  # type: ignore[import-untyped]
from rerun.chunk import Chunk

from workbench.core.filter_state import FilterState, ResumePoint
from workbench.recording.read.chunks import cells, curves, read_chunks
from workbench.recording.read.reader import Run
from workbench.recording.write.checkpoints import ARCHETYPE, EXPECTED, MEMORY, RANKS, REPORTED
from workbench.utils.arrays import AnyArray, FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import parse_json

_MAX_BYTES = 2_000_000_000  # of a checkpoint's arrays; a recording may be untrusted
_REWRITTEN = ("/__properties/", "/posterior/marginals")  # by a resumed run


def checkpoint_frames(run: Run) -> list[int]:
    """Return the frames whose particles a recording holds, in order."""
    return sorted(_memories(run, "npz"))


def recorded_poses(run: Run) -> tuple[IntArray, FloatArray]:
    """Return frames (F,) and poses (F, P) of a run, and of frames before its first where it continues another run."""
    frames, poses = run.poses
    before = curves(read_chunks(run.path, [f"/{REPORTED}"])).get(REPORTED)
    if before is None:
        return frames, poses
    if before.values.shape[1:] != poses.shape[1:]:
        raise InputError(f"{run.path}: expected poses of {poses.shape[1]} numbers in {REPORTED}, found others")
    return np.concatenate([before.frames, frames]), np.concatenate([before.values, poses])


def past_before(run: Run, frame: int) -> ResumePoint | None:
    """Return the last checkpoint of a frame before this one, or None; raises InputError for one that is damaged."""
    packed, streams = _memories(run, "npz"), _memories(run, "streams")
    if not (frames := [each for each in packed if each < frame and each in streams]):
        return None
    last = max(frames)
    place = f"{run.path}: checkpoint of frame {last}"
    expected = dict(zip(*(each.tolist() for each in recorded_poses(run)), strict=True))
    if (stored := curves(read_chunks(run.path, [f"/{EXPECTED}"])).get(EXPECTED)) is not None:
        expected |= dict(zip(stored.frames.tolist(), stored.values.tolist(), strict=True))
    poses = np.array([expected[each] for each in sorted(expected) if each <= last])
    if not len(poses):
        raise InputError(f"{place}: expected the poses of the frames before it, found none")
    arrays = _unpacked(packed[last].as_py()[0], place)
    return ResumePoint(poses, FilterState(arrays, poses[-1], _parsed(streams[last].as_py()[0], place)))


def _memories(run: Run, component: str) -> Mapping[int, Any]:
    return cells(run.path, [f"/{MEMORY}"]).get(MEMORY, {}).get(f"{ARCHETYPE}:{component}", {})


def _unpacked(packed: bytes, place: str) -> dict[str, AnyArray]:
    try:
        with zipfile.ZipFile(io.BytesIO(packed)) as file:
            size = sum(each.file_size for each in file.infolist())
        if size > _MAX_BYTES:
            raise InputError(f"{place}: expected at most {_MAX_BYTES} bytes of arrays, found {size}")
        with np.load(io.BytesIO(packed), allow_pickle=False) as arrays:
            return dict(arrays)
    except (OSError, ValueError, EOFError, KeyError, TypeError, zipfile.BadZipFile) as error:
        raise InputError(f"{place}: expected arrays, found {error}") from None


def _parsed(text: str, place: str) -> dict[str, dict[str, Any]]:
    states = parse_json(place, text)
    if not isinstance(states, dict) or not all(isinstance(state, dict) for state in states.values()):
        raise InputError(f"{place}: expected the states of random streams, found something else")
    return states


@dataclass(frozen=True)
class Earlier:
    """The frames of a run before `until`, the frame after one with a checkpoint. All of their values are recorded."""

    run: Run
    until: int

    @property
    def frames(self) -> list[int]:
        """Their numbers."""
        return [frame for frame in self.run.poses[0].tolist() if frame < self.until]

    @property
    def poses(self) -> FloatArray:
        """The recorded poses (F, P)."""
        return self.run.poses[1][: len(self.frames)]

    @property
    def per_frame(self) -> dict[str, list[float]]:
        """The values of every metric in the frames after the first."""
        first, metrics = self.run.poses[0][0], self.run.metrics
        chosen = {name: (first < curve.frames) & (curve.frames < self.until) for name, curve in metrics.items()}
        return {name: curve.values[chosen[name], 0].tolist() for name, curve in metrics.items()}

    @property
    def ranks(self) -> list[FloatArray]:
        """The ranks (k,) of the true pose's numbers in the frames after the first that have any."""
        values = cells(self.run.path, [f"/{RANKS}"]).get(RANKS, {}).get("Scalars:scalars", {})
        return [np.array(ranks.as_py()) for frame, ranks in sorted(values.items()) if frame < self.until and len(ranks)]

    @property
    def picture(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The ends (K,) of the bins of the marginals, and the log mass (K, B, F) in them."""
        marginals = self.run.marginals
        assert marginals is not None  # as `earlier` asks for it
        return marginals.low, marginals.high, marginals.log_mass[:, :, marginals.frames < self.until]

    def chunks(self) -> list[Chunk]:
        """Return the other chunks of these frames, and the static ones."""
        chunks: list[Chunk] = []
        for chunk in read_chunks(self.run.path, ["/**"]):
            if not chunk.is_static:
                batch = chunk.to_record_batch()
                rows = batch.filter(pc.less(batch.column("frame"), self.until))
                chunks += Chunk.from_record_batch(rows) if len(rows) else []
            elif not chunk.entity_path.startswith(_REWRITTEN):
                chunks.append(chunk)
        return chunks


def earlier(run: Run) -> Earlier | None:
    """Return the frames of a run that a resumed run can reuse, up to the last complete checkpoint; None without one.

    Raises InputError where the recording cannot be read.
    """
    frames = run.poses[0]
    if run.marginals is None or not len(frames):
        return None
    last = min(frames[-1], run.marginals.frames[-1])
    stored = [frame for frame in checkpoint_frames(run) if frame <= last and frame < frames[-1]]
    return Earlier(run, int(frames[frames > stored[-1]][0])) if stored else None
