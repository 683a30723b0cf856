"""A clock that stands still while kernels are compiled, so that equal runs take equal times on a fresh machine, too."""

from time import perf_counter
from typing import Any

from numba.core import event


class _Compiled(event.Listener):
    """seconds: spent on compiling since this process began, kernels within kernels counted once. What is read from the
    cache is not compiled."""

    def __init__(self) -> None:
        self.seconds, self._depth, self._began = 0.0, 0, 0.0

    def on_start(self, event: Any) -> None:
        self._began = perf_counter() if self._depth == 0 else self._began
        self._depth += 1

    def on_end(self, event: Any) -> None:
        self._depth -= 1
        if self._depth == 0:
            self.seconds += perf_counter() - self._began


_COMPILED = _Compiled()
event.register("numba:compile", _COMPILED)  # type: ignore[no-untyped-call]


def compiled_s() -> float:
    """Tell how long this process has compiled kernels so far, s."""
    return _COMPILED.seconds


def working_s() -> float:
    """Tell the time, s, since some moment in the past, without what went into compiling."""
    return perf_counter() - _COMPILED.seconds
