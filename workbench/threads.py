"""Work on numbered items by kernels that release the interpreter's lock, on several threads."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from threading import Barrier

import numba

from workbench.signals import deferred

_PARTS = 4  # a thread, so that one that is held up does not hold up the others


def over_threads(work: Callable[[int, int], object], n: int, step: int) -> None:
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
    parts = iter(range(0, n, size))  # each is taken once, by whoever is free

    def take() -> None:
        for first in parts:
            work(first, min(first + size, n))

    helpers = [_others().submit(take) for _ in range(threads - 1)]
    try:
        take()
    finally:
        for helper in helpers:
            if not helper.cancel():  # one that has not begun is not needed any more
                helper.result()


@cache
def _others() -> ThreadPoolExecutor:
    """The threads beside the caller's, kept from call to call: starting them takes as long as a part of the work.

    All are begun here, while nothing is raised: one that is begun but not yet noted would be waited for in the end.
    """
    most: int = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    others, begun = ThreadPoolExecutor(most, "over_threads"), Barrier(most + 1)
    with deferred():
        try:
            for _ in range(most):
                others.submit(begun.wait)
        except RuntimeError:  # no more threads are to be had
            begun.abort()
            raise
        begun.wait()
    return others


os.register_at_fork(after_in_child=_others.cache_clear)  # a child has none of its parent's threads
