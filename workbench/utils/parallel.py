"""Threads: parallel loops over kernels that release the GIL, and BLAS on a single thread."""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import cache, partial
from typing import Any, TypeVar

import numba
from threadpoolctl import threadpool_limits

from workbench.utils.signals import deferred

_Item = TypeVar("_Item")
_CHUNKS = 4  # per thread, to balance the load


def parallel_for(work: Callable[[int, int], object], n: int, step: int) -> None:
    """Call `work(first, last)` for chunks of 0..n that begin at multiples of `step`, on numba's number of threads.

    The calling thread takes part. Functions with `numba.prange` compile several times longer, and its threads serve one
    caller at a time. The result must not depend on the chunks.
    """
    if n <= step or (n_threads := int(numba.get_num_threads())) == 1:
        work(0, n)
        return
    size = step * max(1, -(-n // (step * n_threads * _CHUNKS)))
    chunks = iter(range(0, n, size))  # the next free thread takes the next chunk

    def take() -> None:
        for first in chunks:
            work(first, min(first + size, n))

    with deferred():  # else Python may wait at exit for a thread that is not listed in its pool
        helpers = [_helpers(os.getpid()).submit(take) for _ in range(n_threads - 1)]
    try:
        take()
    finally:
        begun = [helper for helper in helpers if not helper.cancel()]
        wait(begun)
    for helper in begun:
        helper.result()  # raises its error


@cache
def _helpers(_process: int) -> ThreadPoolExecutor:
    """Return the thread pool of a process; a forked child has none of its parent's threads."""
    return ThreadPoolExecutor(int(numba.config.NUMBA_NUM_THREADS), "over_threads")  # type: ignore[attr-defined]


def ahead(items: Iterable[_Item]) -> Iterator[_Item]:
    """Yield items, each computed by a thread while the caller works on the one before it."""
    source, done = iter(items), object()
    with ThreadPoolExecutor(1, "ahead") as thread:

        def begin() -> Future[object]:
            with deferred():  # as in `parallel_for`
                return thread.submit(next, source, done)

        following = begin()
        while (item := following.result()) is not done:
            following = begin()
            yield item  # type: ignore[misc]


class Helpers:
    """Threads, `n` at most and one fewer than numba's, that begin work whose results the caller needs later.

    It is a context manager; work that no thread has begun at its end is dropped.
    """

    def __init__(self, n: int) -> None:
        n = min(n, int(numba.get_num_threads()) - 1)
        self._pool = ThreadPoolExecutor(n, "helper") if n > 0 else None

    def __enter__(self) -> "Helpers":
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)

    def begin(self, work: Callable[..., _Item], *arguments: Any) -> Callable[[], _Item]:
        """Return a function that returns `work(*arguments)`, and does this work itself if no thread has begun it."""
        if self._pool is None:
            return partial(work, *arguments)
        with deferred():  # as in `parallel_for`
            begun = self._pool.submit(work, *arguments)
        return lambda: work(*arguments) if begun.cancel() else begun.result()


@contextmanager
def single_blas_thread() -> Iterator[None]:
    """Limit NumPy's and SciPy's BLAS to one thread in the block, as their number changes the last bits of results."""
    import scipy.linalg  # noqa: F401 (loads SciPy's BLAS: only loaded libraries are limited)

    with threadpool_limits(limits=1, user_api="blas"):
        yield
