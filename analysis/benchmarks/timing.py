"""Timing things side by side."""

import time
from collections.abc import Callable, Sequence

import numpy as np
from tqdm import tqdm

REPEATS = 12


def fastest_s(timed: Sequence[Callable[[], object]], repeats: int = REPEATS) -> list[float]:
    """Seconds of each function's fastest run.

    They take turns, so that other load hits all alike, after one round that compiles and fills caches.
    """
    times = np.empty((repeats + 1, len(timed)))
    for repeat in tqdm(times, disable=None, leave=False):
        for column, function in enumerate(timed):
            start = time.perf_counter()
            function()
            repeat[column] = time.perf_counter() - start
    return [float(seconds) for seconds in times[1:].min(axis=0)]
