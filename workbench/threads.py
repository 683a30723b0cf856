"""Work on numbered items by kernels that release the interpreter's lock, on several threads."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numba

_PARTS = 4  # a thread, so that one that is held up does not hold up the others


def over_threads(work: Callable[[int, int], object], n: int, step: int) -> None:
    """Call `work(first, last)` for parts of 0..n that begin at multiples of `step`, on as many threads as numba is set
    to.

    Instead of `numba.prange`, whose function takes several times longer to compile, and whose threads serve one caller
    at a time. The work must not depend on how it is parted.
    """
    threads: int = numba.get_num_threads()
    if threads == 1 or n <= step:
        work(0, n)
        return
    size = step * max(1, -(-n // (step * threads * _PARTS)))
    with ThreadPoolExecutor(threads) as pool:
        for done in [pool.submit(work, first, min(first + size, n)) for first in range(0, n, size)]:
            done.result()
