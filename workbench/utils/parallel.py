"""Work on numbered items by kernels that release the interpreter's lock, on several threads."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numba

from workbench.utils.signals import deferred

_PARTS = 4  # a thread, so that one that is held up does not hold up the others


def parallel_for(work: Callable[[int, int], object], n: int, step: int) -> None:
    """Call `work(first, last)` for parts of 0..n that begin at multiples of `step`, on as many threads as numba is set
    to, the caller's among them.

    Instead of `numba.prange`, whose function takes several times longer to compile, and whose threads serve one caller
    at a time. The work must not depend on how it is parted.
    """
    threads: int = numba.get_num_threads()
    if threads == 1 or n <= step:
        work(0, n)
        return
    size = step * max(1, -(-n // (step * threads * _PARTS)))
    parts = iter(range(0, n, size))  # each is taken once, by the next free thread

    def take() -> None:
        for first in parts:
            work(first, min(first + size, n))

    with deferred():  # Python would wait at its end for a thread that has started but is not listed in its pool
        helpers = [_helpers(os.getpid()).submit(take) for _ in range(threads - 1)]
    try:
        take()
    finally:
        for helper in helpers:
            if not helper.cancel():  # one that has not begun is not needed any more
                helper.result()


@cache
def _helpers(_process: int) -> ThreadPoolExecutor:
    """Return the threads that help the caller's, one pool for each process: a forked child has none of its parent's."""
    return ThreadPoolExecutor(int(numba.config.NUMBA_NUM_THREADS), "over_threads")  # type: ignore[attr-defined]
