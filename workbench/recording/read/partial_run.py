"""What a run needs to be continued, and the frames of a run that was cut off that its continuation can take over."""

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
from workbench.recording.write.checkpoints import ARCHETYPE, EXPECTED, MEMORY, RANKS, TOLD
from workbench.utils.arrays import AnyArray, FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import parse_json

_MOST_BYTES = 2_000_000_000  # of a checkpoint's arrays; a recording may be untrusted
_REWRITTEN = ("/__properties/", "/posterior/marginals")  # by a continuation


def checkpoint_frames(run: Run) -> list[int]:
    """Return the frames whose particles a recording holds, in order."""
    return sorted(_memories(run, "npz"))


def recorded_poses(run: Run) -> tuple[IntArray, FloatArray]:
    """Return frames (F,) and poses (F, P) of a run and, where it continues another and has checkpoints, of those before
    its first."""
    frames, poses = run.poses
    before = curves(read_chunks(run.path, [f"/{TOLD}"])).get(TOLD)
    if before is None:
        return frames, poses
    if before.values.shape[1:] != poses.shape[1:]:
        raise InputError(f"{run.path}: expected poses of {poses.shape[1]} numbers in {TOLD}, found others")
    return np.concatenate([before.frames, frames]), np.concatenate([before.values, poses])


def past_before(run: Run, frame: int) -> ResumePoint | None:
    """Return the last checkpoint of a frame before this one, or None; raises InputError for one that is damaged."""
    packed, streams = _memories(run, "npz"), _memories(run, "streams")
    if not (frames := [each for each in packed if each < frame and each in streams]):
        return None
    last = max(frames)
    place = f"{run.path}: checkpoint of frame {last}"
    expected = dict(zip(*(each.tolist() for each in recorded_poses(run)), strict=True))
    if (own := curves(read_chunks(run.path, [f"/{EXPECTED}"])).get(EXPECTED)) is not None:
        expected |= dict(zip(own.frames.tolist(), own.values.tolist(), strict=True))
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
        if size > _MOST_BYTES:
            raise InputError(f"{place}: expected at most {_MOST_BYTES} bytes of arrays, found {size}")
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
    """The frames of a run before `until`, the one after a frame with a checkpoint; all of their values are recorded."""

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
        kept = {name: (first < curve.frames) & (curve.frames < self.until) for name, curve in metrics.items()}
        return {name: curve.values[kept[name], 0].tolist() for name, curve in metrics.items()}

    @property
    def ranks(self) -> list[FloatArray]:
        """The ranks (k,) of the true pose's numbers in the frames after the first that have any."""
        found = cells(self.run.path, [f"/{RANKS}"]).get(RANKS, {}).get("Scalars:scalars", {})
        return [np.array(ranks.as_py()) for frame, ranks in sorted(found.items()) if frame < self.until and len(ranks)]

    @property
    def picture(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The ends (K,) of the bins of the marginals, and the log mass (K, B, F) in them."""
        marginals = self.run.marginals
        assert marginals is not None  # as `earlier` asks for it
        return marginals.low, marginals.high, marginals.log_mass[:, :, marginals.frames < self.until]

    def chunks(self) -> list[Chunk]:
        """Read all else that was recorded of them, and what is static."""
        kept: list[Chunk] = []
        for chunk in read_chunks(self.run.path, ["/**"]):
            if not chunk.is_static:
                batch = chunk.to_record_batch()
                rows = batch.filter(pc.less(batch.column("frame"), self.until))
                kept += Chunk.from_record_batch(rows) if len(rows) else []
            elif not chunk.entity_path.startswith(_REWRITTEN):
                kept.append(chunk)
        return kept


def earlier(run: Run) -> Earlier | None:
    """Return the most frames of a run that can be taken over, or None: up to one with a checkpoint, all on the disk.

    Raises InputError where the recording cannot be read.
    """
    frames = run.poses[0]
    if run.marginals is None or not len(frames):
        return None
    last = min(frames[-1], run.marginals.frames[-1])
    stored = [frame for frame in checkpoint_frames(run) if frame <= last and frame < frames[-1]]
    return Earlier(run, int(frames[frames > stored[-1]][0])) if stored else None
