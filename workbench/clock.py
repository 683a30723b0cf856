"""A clock that stands still while kernels compile, so that equal runs take equal times on a fresh machine, too."""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import get_ident
from time import perf_counter
from typing import Any

from numba.core import event

from workbench.signals import defer, resume


class _Total:
    """seconds: spent compiling inside `measured_compilation` since the process began."""

    seconds = 0.0


class _Compilation(event.Listener):
    """Measures compilation; a kernel's helpers are compiled within it and count as part of it.

    Interruptions wait until a kernel is compiled: LLVM calls back into Python, where an exception would be lost. The
    garbage collector waits, too: numba makes many objects that stay, and walking them takes an eighth of the time.
    """

    def __init__(self, started: Callable[[str], None], ended: Callable[[], None]) -> None:
        self._started, self._ended = started, ended
        self._depths: dict[int, int] = {}  # by thread
        self._began, self._collects = 0.0, True

    def on_start(self, event: Any) -> None:
        thread = get_ident()
        depth = self._depths[thread] = self._depths.get(thread, 0) + 1
        if depth == 1:
            defer()
            self._collects = gc.isenabled()
            gc.disable()
            self._began = perf_counter()
            self._started(event.data["dispatcher"].py_func.__qualname__)

    def on_end(self, _event: Any) -> None:
        thread = get_ident()
        if not self._depths.get(thread):  # it began before this listener was there
            return
        self._depths[thread] -= 1
        if self._depths[thread] == 0:
            _Total.seconds += perf_counter() - self._began
            if self._collects:
                gc.enable()
            self._ended()
            resume()


@contextmanager
def measured_compilation(started: Callable[[str], None], ended: Callable[[], None]) -> Iterator[None]:
    """Count the time of compilation in the block, which `working_s` leaves out.

    Parameters
    ----------
    started
        Called with a kernel's name when its compilation begins. Kernels read from the cache are not compiled.
    ended
        Called when it ends.
    """
    with event.install_listener("numba:compile", _Compilation(started, ended)):
        yield


def compiled_s() -> float:
    """Return the time spent compiling kernels so far, s."""
    return _Total.seconds


def working_s() -> float:
    """Return the time since some moment in the past without compilation, s."""
    return perf_counter() - _Total.seconds
