"""Interrupt a run by SIGINT, SIGTERM or, where the system has it, SIGHUP: they raise `Interrupted` in the main thread.

Frames since the last flush of the recording may be lost. Blocks that must be completed, such as publishing a recording,
defer the exception to their end.
"""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Sent by the user, by a cluster or service manager, and by a closing terminal."""


class Interrupted(KeyboardInterrupt):
    """A signal interrupts the process. number: of the signal."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


class _Request:
    """received: the last signal. pending: the same until all `depth` deferred blocks have ended."""

    received: int | None = None
    pending: int | None = None
    depth = 0


@contextmanager
def interruptible(first: Callable[[], None] | None = None) -> Iterator[None]:
    """Raise Interrupted when one of _SIGNALS arrives in the block; `first` is called before that.

    Later signals are ignored, except that a further SIGINT raises KeyboardInterrupt at once. Ignored signals
    (SIGHUP under nohup) and signals with a handler of the caller keep it. Outside the main thread nothing changes.
    """
    usual, before = (signal.SIG_DFL, signal.default_int_handler), {}
    if threading.current_thread() is threading.main_thread():
        before = {number: handler for number in _SIGNALS if (handler := signal.getsignal(number)) in usual}

    def handle(number: int, _: FrameType | None) -> None:
        for other in before:
            signal.signal(other, signal.default_int_handler if other == signal.SIGINT else _ignored)
        if first is not None:
            first()
        _Request.received = number
        if _Request.depth:
            _Request.pending = number
        else:
            raise Interrupted(number)

    for number in before:
        signal.signal(number, handle)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if before:
            _Request.received = _Request.pending = None


@contextmanager
def ending_at_once() -> Iterator[None]:
    """End the process by SIGINT in the block, quietly, while modules are imported and nothing is to be saved.

    Python would print tracebacks of half-imported modules. A handler of the caller is kept.
    """
    in_main = threading.current_thread() is threading.main_thread()
    usual = in_main and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if usual:
        signal.signal(signal.SIGINT, lambda number, _: os._exit(128 + number))
    try:
        yield
    finally:
        if usual:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def _ignored(*_: object) -> None:
    """Do nothing. With SIG_IGN Python would print a traceback for a signal that has already arrived."""


@contextmanager
def deferred() -> Iterator[None]:
    """Defer an interruption to the end of the outermost such block; a second SIGINT is not deferred."""
    in_main = threading.current_thread() is threading.main_thread()
    _Request.depth += in_main
    try:
        yield
    finally:
        _Request.depth -= in_main
        if in_main and not _Request.depth and (number := _Request.pending) is not None:
            _Request.pending = None
            raise Interrupted(number)


def check_interrupted() -> None:
    """Raise a lost interruption again, as Python drops exceptions in callbacks from C and in finalizers."""
    if _Request.received is not None and threading.current_thread() is threading.main_thread():
        raise Interrupted(_Request.received)
