"""A clock that stands still while kernels compile, so that equal runs take equal times on a fresh machine, too."""

import gc
import logging
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from time import perf_counter
from typing import Any

from numba.core import event
from tqdm import tqdm

from workbench.utils.signals import deferred

log = logging.getLogger(__name__)


class _Compilation(event.Listener):
    """Measures compilation; a kernel's helpers are compiled within it and count as part of it.

    Numba compiles in one thread at a time. Interruptions wait until a kernel is compiled: LLVM calls back into Python,
    where an exception would be lost. The garbage collector waits, too: it would take an eighth of the time.
    """

    total_s = 0.0  # of all since the process began

    def __init__(self, bar: Any) -> None:
        self._bar, self._depth, self._began, self._waiting, self.n = bar, 0, 0.0, ExitStack(), 0

    def on_start(self, event: Any) -> None:
        self._depth += 1
        if self._depth == 1:
            self._waiting.enter_context(deferred())
            if gc.isenabled():
                gc.disable()
                self._waiting.callback(gc.enable)
            self._began = perf_counter()
            self._bar.set_postfix_str(event.data["dispatcher"].py_func.__qualname__)

    def on_end(self, _event: Any) -> None:
        self._depth = max(0, self._depth - 1)  # one that began before this listener was there ends, too
        if self._depth == 0 and self._began:
            _Compilation.total_s += perf_counter() - self._began
            self._began, self.n = 0.0, self.n + 1
            self._bar.update()
            self._waiting.close()


@contextmanager
def compiling(quiet: bool = False) -> Iterator[None]:
    """Leave compilation in the block out of `working_s`; unless `quiet`, show it on a terminal and log it at the end.

    Kernels read from the cache are not compiled.
    """
    text, before_s = "compiling, for later runs as well", compiled_s()
    with (
        tqdm(desc=text, unit="kernel", disable=True if quiet else None, leave=False, delay=0.5) as bar,
        event.install_listener("numba:compile", _Compilation(bar)) as listener,
    ):
        yield
    if listener.n and not quiet:
        log.info("compiled %d kernels in %.1f s; later runs find them", listener.n, compiled_s() - before_s)


def compiled_s() -> float:
    """Return the time spent compiling kernels so far, s."""
    return _Compilation.total_s


def working_s() -> float:
    """Return the time since some moment in the past without compilation, s."""
    return perf_counter() - _Compilation.total_s
