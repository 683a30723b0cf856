"""Compilation of kernels: a clock without it, so that times do not depend on the kernel cache, and a stack for it."""

import gc
import logging
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from time import perf_counter
from typing import Any, TypeVar

from numba.core import event
from tqdm import tqdm

from workbench.utils.signals import deferred

log = logging.getLogger(__name__)
_Result = TypeVar("_Result")


class _Compilation(event.Listener):
    """Measures compilation; the functions that a kernel calls are compiled within it and count as part of it.

    Numba compiles in one thread at a time. Interruptions are deferred until a kernel is compiled, as LLVM calls Python,
    where an exception would be lost. The garbage collector, an eighth of the time, is disabled.
    """

    total_s = 0.0  # since the process began

    def __init__(self, bar: Any) -> None:
        self._bar, self._depth, self._began, self._deferred, self.n = bar, 0, 0.0, ExitStack(), 0

    def on_start(self, event: Any) -> None:
        self._depth += 1
        if self._depth == 1:
            self._deferred.enter_context(deferred())
            if gc.isenabled():
                gc.disable()
                self._deferred.callback(gc.enable)
            self._began = perf_counter()
            self._bar.set_postfix_str(event.data["dispatcher"].py_func.__qualname__)

    def on_end(self, _event: Any) -> None:
        self._depth = max(0, self._depth - 1)  # for a compilation that began before this listener
        if self._depth == 0 and self._began:
            _Compilation.total_s += perf_counter() - self._began
            self._began, self.n = 0.0, self.n + 1
            self._bar.update()
            self._deferred.close()


@contextmanager
def compiling(quiet: bool = False) -> Iterator[None]:
    """Exclude compilation in the block from `working_s`; unless `quiet`, show it on a terminal and log its time.

    Kernels read from the cache are not compiled.
    """
    text, before_s = "compiling kernels (cached for later runs)", compiled_s()
    with (
        tqdm(desc=text, unit="kernel", disable=True if quiet else None, leave=False, delay=0.5) as bar,
        event.install_listener("numba:compile", _Compilation(bar)) as listener,
    ):
        yield
    if listener.n and not quiet:
        log.info("compiled %d kernels in %.1f s, cached for later runs", listener.n, compiled_s() - before_s)


def on_one_stack(work: Callable[[], _Result]) -> _Result:
    """Return work(), which compiles kernels.

    Before the fix of https://github.com/python/cpython/issues/142183, CPython allocates and frees memory at every call
    across the end of a chunk of 16 KiB with frames, and calls at that depth, as of numba's compiler, take three times
    as long. The frame of this function, 512 KiB, begins a chunk that has room for all frames above it.
    """
    return work()


on_one_stack.__code__ = on_one_stack.__code__.replace(co_stacksize=1 << 16)  # of 8 bytes each


def compiled_s() -> float:
    """Return the time spent compiling kernels so far, s."""
    return _Compilation.total_s


def working_s() -> float:
    """Return a monotonic time without compilation, s."""
    return perf_counter() - _Compilation.total_s
