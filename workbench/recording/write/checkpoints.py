"""Checkpoints in a recording, from which a run continues: particles, weights and random streams of some frames.

The likelihood's memory is not stored, since it follows from the frames and their expected poses.
"""

import io
import json
from collections.abc import Callable

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import rerun as rr

from workbench.core.filter_state import FilterState
from workbench.core.step import Step
from workbench.recording.write.columns import Rows, curves, nanoseconds, time_index
from workbench.utils.arrays import FloatArray, IntArray

MAX_FRACTION = 0.1
"""Largest fraction of the file that checkpoints take. The particles of every frame would take several times the rest.
A run that continues from a frame without a checkpoint repeats the frames since the last checkpoint."""
MEMORY, EXPECTED, REPORTED, RANKS = (f"checkpoint/{name}" for name in ("memory", "expected", "reported", "ranks"))
ARCHETYPE = "Checkpoint"
_PAUSE = 5
"""Frames until the next attempt after a checkpoint did not fit, since packing takes time."""


class Checkpoints:
    """Stores the memory of a step whenever checkpoints stay within MAX_FRACTION of the file.

    A step's memory is written one step later, when the particles with offspring are known. The states of the others are
    omitted, since a run that continues from a checkpoint repeats the next frame unchanged.

    decode: returns the poses (N, P) of states (N, D); poses that equal its result bitwise are not stored.
    """

    def __init__(self, decode: Callable[[FloatArray], FloatArray]) -> None:
        self._decode, self._n_bytes, self._pause = decode, 0, 0
        self._previous: Step | None = None
        self._required = False

    def before(self, reported: FloatArray, expected: FloatArray) -> Rows:
        """Yield the reported pose and the pose that the likelihood received, (P,) each, of a frame before the first.

        The first step's memory is then stored completely and independent of its size, since the file has no earlier
        one.
        """
        self._required = True
        yield from curves({REPORTED: reported, EXPECTED: expected})

    def take_over(self, n_bytes: int) -> None:
        """Count the bytes of checkpoints that are already in the file."""
        self._n_bytes += n_bytes

    def per_frame(self, step: Step, ranks: FloatArray) -> Rows:
        """Yield the ranks (k,) of the true pose's parameters, and the pose that the likelihood received, if another
        one."""
        self._n_bytes += ranks.nbytes
        yield from curves({RANKS: ranks})
        if step.filter_state is not None and not np.array_equal(step.filter_state.filtered_pose, step.expected_pose):
            self._n_bytes += step.filter_state.filtered_pose.nbytes
            yield from curves({EXPECTED: step.filter_state.filtered_pose})

    def log(self, stream: rr.RecordingStream, step: Step, n_bytes: int) -> None:
        """Store the previous step's memory in a file of n_bytes, if MAX_FRACTION allows it."""
        previous, self._previous = self._previous, step
        available, self._pause = MAX_FRACTION * n_bytes - self._n_bytes, max(0, self._pause - 1)
        if previous is None or previous.filter_state is None or step.filter_state is None:
            return
        if not self._required and (available <= 0 or self._pause):
            return
        packed = self._packed(previous.filter_state, None if self._required else step.filter_state.parents)
        if len(packed) > available and not self._required:
            self._pause = _PAUSE
            return
        self._n_bytes, self._required = self._n_bytes + len(packed), False
        fields = {
            "npz": pa.array([packed], pa.binary()),
            "streams": pa.array([json.dumps(previous.filter_state.rng_states)]),
        }
        index = time_index([previous.frame.index], [nanoseconds(previous.frame.time_s)])
        stream.send_columns(MEMORY, index, rr.DynamicArchetype.columns(archetype=ARCHETYPE, components=fields))

    def _packed(self, filter_state: FilterState, offspring_of: IntArray | None) -> bytes:
        arrays = dict(filter_state.arrays)
        if "poses" in arrays and np.array_equal(arrays["poses"], self._decode(arrays["state"])):
            del arrays["poses"]
        if offspring_of is not None:  # compressed zeros take no space
            for name in {"state", "poses"} & arrays.keys():
                rows = np.zeros_like(arrays[name])
                rows[offspring_of] = arrays[name][offspring_of]
                arrays[name] = rows
        file = io.BytesIO()
        np.savez_compressed(file, allow_pickle=False, **arrays)
        return file.getvalue()
