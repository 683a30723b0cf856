"""Timing things side by side."""

import time
from collections.abc import Callable, Sequence

import numpy as np
from tqdm import tqdm

REPEATS = 12


def fastest_s(
    timed: Sequence[Callable[[], object]], repeats: int = REPEATS, clock: Callable[[], float] = time.perf_counter
) -> list[float]:
    """Seconds of each function's fastest run, by a clock.

    They take turns, so that other load hits all alike, after one round that compiles and fills caches.
    """
    times = np.empty((repeats + 1, len(timed)))
    for repeat in tqdm(times, disable=None, leave=False):
        for column, function in enumerate(timed):
            start = clock()
            function()
            repeat[column] = clock() - start
    return [float(seconds) for seconds in times[1:].min(axis=0)]
