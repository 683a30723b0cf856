"""SIGINT, SIGTERM and SIGHUP end a run as interrupted: they raise `Interrupted` in the main thread.

What may be lost is what was computed since the recording was last flushed. Blocks that must not be left half done,
such as publishing a recording, defer the exception to their end.
"""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Sent by a person, by a cluster or a service manager, and by a terminal that closes."""


class Interrupted(KeyboardInterrupt):
    """A signal asked the process to end. number: of the signal."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


class _Request:
    """received: the last signal; pending: the same until the deferred blocks, `depth` of them, have ended."""

    received: int | None = None
    pending: int | None = None
    depth = 0


@contextmanager
def interruptible(first: Callable[[], None] | None = None) -> Iterator[None]:
    """Raise Interrupted when one of _SIGNALS arrives in the block; `first` is called before that.

    Later signals are ignored, except that a further SIGINT raises KeyboardInterrupt at once. Signals that are ignored
    (SIGHUP under nohup) or have a handler of the caller's own keep it, and nothing changes outside the main thread.
    """
    usual, before = (signal.SIG_DFL, signal.default_int_handler), {}
    if threading.current_thread() is threading.main_thread():
        before = {number: handler for number in _SIGNALS if (handler := signal.getsignal(number)) in usual}

    def handle(number: int, _: FrameType | None) -> None:
        for each in before:
            signal.signal(each, signal.default_int_handler if each == signal.SIGINT else _ignored)
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


def _ignored(*_: object) -> None:
    """Do nothing; with SIG_IGN instead, Python prints a traceback for a signal that has arrived already."""


@contextmanager
def deferred() -> Iterator[None]:
    """Let an interruption wait until the outermost of such blocks ends; a second SIGINT does not wait."""
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
    """Raise an interruption again that was lost: Python drops exceptions in callbacks from C and in finalizers."""
    if _Request.received is not None and threading.current_thread() is threading.main_thread():
        raise Interrupted(_Request.received)
