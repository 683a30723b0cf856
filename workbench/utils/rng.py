"""Random streams: an independent generator for every purpose of a run, also at equal seeds."""

import zlib

import numpy as np

from workbench.utils.errors import InputError

STREAMS = ("start", "resampling", "prior", "study", "draws")
"""Names of the run's random streams."""


def stream(seed: int, purpose: str, *indices: int) -> np.random.Generator:
    """Return the generator of a seed for a purpose, and optionally for a frame or component by index.

    purpose: name of the sampled quantity, such as "clothes"; streams of different purposes are independent.
    """
    key = zlib.crc32(purpose.encode())
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(key, *indices)))


def rng_streams(seed: int) -> dict[str, np.random.Generator]:
    """Return the named random streams of a run; InputError for a negative seed."""
    if seed < 0:
        raise InputError(f"seed: expected a non-negative integer, found {seed}")
    return {name: stream(seed, f"run: {name}") for name in STREAMS}
