"""What a run needs to be continued, in its recording: particles, weights and random streams of some frames.

The likelihood's memory is not stored, as it follows from the frames and the poses expected in them.
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

SHARE = 0.1
"""Of the file that checkpoints take at most. The particles of every frame would be several times the rest; so those of
some frames are stored, and a run that continues from another frame repeats the frames since the last of these."""
MEMORY, EXPECTED, TOLD, RANKS = (f"checkpoint/{name}" for name in ("memory", "expected", "told", "ranks"))
ARCHETYPE = "Checkpoint"
_PAUSE = 5
"""Frames until the next attempt after a checkpoint did not fit, as packing takes time."""


class Checkpoints:
    """Stores the memory of a step whenever that leaves the checkpoints within SHARE of the file.

    It is written one step later, when it is known which particles have offspring: the states of the others are left
    out, since a run that continues from a checkpoint repeats the frame after it as it was.

    decode: gives the poses (N, P) of states (N, D); poses that equal its result bitwise are not stored.
    """

    def __init__(self, decode: Callable[[FloatArray], FloatArray]) -> None:
        self._decode, self._spent, self._pause = decode, 0, 0
        self._before: Step | None = None
        self._owed = False

    def before(self, told: FloatArray, expected: FloatArray) -> Rows:
        """Yield, for a frame before the run's first, its recorded pose and the pose given to its likelihood, (P,) each.

        The first step's memory is then stored wholly, whatever room there is: nothing before it is in this file.
        """
        self._owed = True
        yield from curves({TOLD: told, EXPECTED: expected})

    def take_over(self, n_bytes: int) -> None:
        """Count checkpoints that are in the file already."""
        self._spent += n_bytes

    def per_frame(self, step: Step, ranks: FloatArray) -> Rows:
        """Yield the ranks (k,) of the true pose's numbers, and the pose given to the likelihood, where it is not the
        one that is recorded."""
        self._spent += ranks.nbytes
        yield from curves({RANKS: ranks})
        if step.filter_state is not None and not np.array_equal(step.filter_state.filtered_pose, step.expected_pose):
            self._spent += step.filter_state.filtered_pose.nbytes
            yield from curves({EXPECTED: step.filter_state.filtered_pose})

    def log(self, stream: rr.RecordingStream, step: Step, n_bytes: int) -> None:
        """Store the memory of the step before in a file that has so many bytes by now, if there is room for it."""
        before, self._before = self._before, step
        room, self._pause = SHARE * n_bytes - self._spent, max(0, self._pause - 1)
        if before is None or before.filter_state is None or step.filter_state is None:
            return
        if not self._owed and (room <= 0 or self._pause):
            return
        packed = self._packed(before.filter_state, None if self._owed else step.filter_state.parents)
        if len(packed) > room and not self._owed:
            self._pause = _PAUSE
            return
        self._spent, self._owed = self._spent + len(packed), False
        fields = {
            "npz": pa.array([packed], pa.binary()),
            "streams": pa.array([json.dumps(before.filter_state.rng_states)]),
        }
        index = time_index([before.frame.index], [nanoseconds(before.frame.time_s)])
        stream.send_columns(MEMORY, index, rr.DynamicArchetype.columns(archetype=ARCHETYPE, components=fields))

    def _packed(self, filter_state: FilterState, offspring_of: IntArray | None) -> bytes:
        arrays = dict(filter_state.arrays)
        if "poses" in arrays and np.array_equal(arrays["poses"], self._decode(arrays["state"])):
            del arrays["poses"]
        if offspring_of is not None:  # zeros take no room
            for name in {"state", "poses"} & arrays.keys():
                rows = np.zeros_like(arrays[name])
                rows[offspring_of] = arrays[name][offspring_of]
                arrays[name] = rows
        file = io.BytesIO()
        np.savez_compressed(file, allow_pickle=False, **arrays)
        return file.getvalue()
