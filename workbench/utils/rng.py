"""Random streams: a generator of its own for every purpose, so that no two of a run are equal, whatever their seeds."""

import zlib

import numpy as np

from workbench.utils.errors import InputError

STREAMS = ("start", "resampling", "prior", "study")
"""Names of the run's random streams."""


def stream(seed: int, purpose: str, *indices: int) -> np.random.Generator:
    """Return the generator of this seed for this purpose, and of a frame or part where indices number them.

    purpose: names what is drawn, such as "clothes"; streams of two purposes are independent at equal seeds.
    """
    key = zlib.crc32(purpose.encode())
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(key, *indices)))


def rng_streams(seed: int) -> dict[str, np.random.Generator]:
    """The run's named random streams; raises InputError for a negative seed."""
    if seed < 0:
        raise InputError(f"seed must be zero or a positive whole number, found {seed}")
    return {name: stream(seed, f"run: {name}") for name in STREAMS}
