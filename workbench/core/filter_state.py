"""What a run needs of the frames so far to go on from there, for inferences that can."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from workbench.core.frame import Frame
from workbench.core.likelihood import Likelihood
from workbench.utils.arrays import AnyArray, FloatArray, IntArray
from workbench.utils.errors import InputError


@dataclass(frozen=True, eq=False)
class Memory:
    """What an inference keeps after a frame, but for the likelihood, which `recalled` brings back.

    arrays: by name, none of them written to later. expected: (P,) the pose that the likelihood was told to remember,
    which is not the one that a step tells where later frames are known. streams: where every random stream stands, by
    name, as `BitGenerator.state` says it; none where others are to be drawn from. parents: of the frame before, the
    particles that this one was made of, where nothing else of their states was looked at; None: all.
    """

    arrays: Mapping[str, AnyArray]
    expected: FloatArray
    streams: Mapping[str, Mapping[str, Any]]
    parents: IntArray | None = None

    def plus(self, **arrays: AnyArray) -> "Memory":
        """Return it with more arrays."""
        return replace(self, arrays={**self.arrays, **arrays})

    def array(self, name: str, *shape: int | None) -> AnyArray:
        """Return an array, whose axes have these lengths, None for any; raises InputError where it is not so."""
        found = self.arrays.get(name)
        if found is None or len(found.shape) != len(shape):
            raise InputError(f"checkpoint: expected an array {name} with {len(shape)} axes, found none")
        if any(n not in (None, length) for n, length in zip(shape, found.shape, strict=True)):
            raise InputError(f"checkpoint: expected {name} of shape {shape}, found {found.shape}")
        return found

    def restore(self, rng_streams: Mapping[str, np.random.Generator]) -> None:
        """Set the generators to where the streams of their names stood; raises InputError for what is no state."""
        for name, state in self.streams.items():
            try:
                rng_streams[name].bit_generator.state = dict(state)
            except (KeyError, TypeError, ValueError, OverflowError):
                raise InputError(f"checkpoint: expected the state of a random stream {name}, found none") from None


@dataclass(frozen=True, eq=False)
class Past:
    """The first F frames of a run, from which it goes on. expected: (F, P), as in `Memory`, of each. memory: of the
    last."""

    expected: FloatArray
    memory: Memory


def streams_now(rng_streams: Mapping[str, np.random.Generator]) -> dict[str, Mapping[str, Any]]:
    """Return where every stream stands."""
    return {name: rng.bit_generator.state for name, rng in rng_streams.items()}


def recalled(likelihood: Likelihood, frames: Iterable[Frame], expected: FloatArray) -> tuple[Likelihood, Frame]:
    """Return the likelihood after the first F ≥ 1 of the frames, which are taken from them, and the last of these.

    Nothing is evaluated: what a likelihood remembers follows from the frames and the poses (F, P) that it was told to
    be expected in them.
    """
    previous: Frame | None = None
    for pose, frame in zip(expected, frames, strict=False):  # in this order: no frame too many is taken
        likelihood, previous = likelihood.prepare(previous, frame).update(pose), frame
    if previous is None:
        raise InputError("checkpoint: expected a frame at least to go on from, found none")
    return likelihood, previous
