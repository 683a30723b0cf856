"""The state from which an inference resumes after a frame."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from workbench.core.frame import Frame
from workbench.core.likelihood import Likelihood
from workbench.utils.arrays import AnyArray, FloatArray, IntArray
from workbench.utils.errors import InputError


@dataclass(frozen=True, eq=False)
class FilterState:
    """The state of an inference after a frame, except for the likelihood, which `replay_likelihood` reconstructs.

    arrays: by name; none is modified later. filtered_pose: (P,), the pose that the likelihood was updated with; the
    step's expected pose differs from it where later frames are used. rng_states: the state of every random generator
    by name, as `BitGenerator.state`; empty: other generators are used. parents: indices of the previous frame's
    particles that this frame depends on; None: all.
    """

    arrays: Mapping[str, AnyArray]
    filtered_pose: FloatArray
    rng_states: Mapping[str, Mapping[str, Any]]
    parents: IntArray | None = None

    def with_arrays(self, **arrays: AnyArray) -> "FilterState":
        """Return the state with more arrays."""
        return replace(self, arrays={**self.arrays, **arrays})

    def array(self, name: str, *shape: int | None) -> AnyArray:
        """Return an array of this shape, None for any length; raises InputError if it is missing or has another one."""
        array = self.arrays.get(name)
        if array is None or len(array.shape) != len(shape):
            raise InputError(f"checkpoint: expected an array {name} with {len(shape)} axes, found none")
        if any(n not in (None, length) for n, length in zip(shape, array.shape, strict=True)):
            raise InputError(f"checkpoint: expected {name} of shape {shape}, found {array.shape}")
        return array

    def restore(self, rng_streams: Mapping[str, np.random.Generator]) -> None:
        """Restore the states of the random generators; raises InputError for an invalid state."""
        for name, state in self.rng_states.items():
            try:
                rng_streams[name].bit_generator.state = dict(state)
            except (KeyError, TypeError, ValueError, OverflowError):
                raise InputError(f"checkpoint: expected the state of a random stream {name}, found none") from None


@dataclass(frozen=True, eq=False)
class ResumePoint:
    """The first F frames of a run, after which it resumes.

    filtered_poses: (F, P), `FilterState.filtered_pose` of each frame. filter_state: of the last of them.
    """

    filtered_poses: FloatArray
    filter_state: FilterState


def capture_rng_states(rng_streams: Mapping[str, np.random.Generator]) -> dict[str, Mapping[str, Any]]:
    """Return the current state of every random generator."""
    return {name: rng.bit_generator.state for name, rng in rng_streams.items()}


def replay_likelihood(
    likelihood: Likelihood, frames: Iterable[Frame], filtered_poses: FloatArray
) -> tuple[Likelihood, Frame]:
    """Return the likelihood after the first F ≥ 1 frames, and the last of these frames.

    Nothing is evaluated: the likelihood's state follows from the frames and the poses that it was updated with.

    Parameters
    ----------
    likelihood : before the first frame.
    frames : F of them are consumed.
    filtered_poses : (F, P), the poses that the likelihood was updated with.

    Raises
    ------
    InputError : there is no frame.
    """
    previous: Frame | None = None
    for pose, frame in zip(filtered_poses, frames, strict=False):  # in this order, so that no further frame is consumed
        likelihood, previous = likelihood.prepare(previous, frame).update(pose), frame
    if previous is None:
        raise InputError("checkpoint: expected at least one frame before the frame to resume at, found none")
    return likelihood, previous
