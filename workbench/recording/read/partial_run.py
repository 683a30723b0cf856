"""The frames of a run that was cut off that can be taken over by one that goes on with it."""

from dataclasses import dataclass

import numpy as np
import pyarrow.compute as pc  # type: ignore[import-untyped]
from rerun.chunk import Chunk

from workbench.recording.read.checkpoints import checkpoint_frames
from workbench.recording.read.chunks import cells, read_chunks
from workbench.recording.read.reader import Run
from workbench.recording.write.checkpoints import RANKS
from workbench.utils.arrays import FloatArray

_NOT_KEPT = ("/__properties/", "/posterior/marginals")
"""What whoever goes on writes anew."""


@dataclass(frozen=True)
class Earlier:
    """The frames of a run before `until`, which follows on one with a checkpoint; all that it recorded of them is
    there."""

    run: Run
    until: int

    @property
    def frames(self) -> list[int]:
        """List their numbers."""
        return [frame for frame in self.run.poses[0].tolist() if frame < self.until]

    @property
    def poses(self) -> FloatArray:
        """Return the poses (F, P) that were told."""
        return self.run.poses[1][: len(self.frames)]

    @property
    def per_frame(self) -> dict[str, list[float]]:
        """List the values of every metric in the frames after the first."""
        first = self.run.poses[0][0]
        kept = {name: (curve.frames > first) & (curve.frames < self.until) for name, curve in self.run.metrics.items()}
        return {name: curve.values[kept[name], 0].tolist() for name, curve in self.run.metrics.items()}

    @property
    def ranks(self) -> list[FloatArray]:
        """List the ranks (k,) of the true pose's numbers in the frames after the first that have any."""
        found = cells(self.run.path, [f"/{RANKS}"]).get(RANKS, {}).get("Scalars:scalars", {})
        return [np.array(ranks.as_py()) for frame, ranks in sorted(found.items()) if frame < self.until and len(ranks)]

    @property
    def picture(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the ends (K,) of the bins of the marginals, and the log mass (K, B, F) in them."""
        marginals = self.run.marginals
        assert marginals is not None  # as `earlier` asks for it
        return marginals.low, marginals.high, marginals.log_mass[:, :, marginals.frames < self.until]

    def chunks(self) -> list[Chunk]:
        """Read all else that was recorded of them, and what is static."""
        found: list[Chunk] = []
        for chunk in read_chunks(self.run.path, ["/**"]):
            if chunk.is_static and not chunk.entity_path.startswith(_NOT_KEPT):
                found.append(chunk)
            elif not chunk.is_static:
                batch = chunk.to_record_batch()
                kept = batch.filter(pc.less(batch.column("frame"), self.until))
                found += Chunk.from_record_batch(kept) if len(kept) else []
        return found


def earlier(run: Run) -> Earlier | None:
    """Find the most frames of a run that can be taken over: up to one with a checkpoint, of which all is on the disk.

    None where there are none. Raises InputError where the recording cannot be read.
    """
    frames = run.poses[0]
    if run.marginals is None or not len(frames):
        return None
    last = min(frames[-1], run.marginals.frames[-1])
    stored = [frame for frame in checkpoint_frames(run) if frame <= last and frame < frames[-1]]
    return Earlier(run, int(frames[frames > stored[-1]][0])) if stored else None
