"""Signals that ask a process to end: its status is told, its recording kept, its children end.

Python raises what a signal asks for wherever the main thread is. While LLVM compiles a kernel that can be a callback
from C, where it is lost and leaves the compiler without what the callback was to bring; and what is raised in an import
leaves half a module, which whoever tells the end may need. So it waits until LLVM, or the import, is done.
"""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

ASKING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""What whoever ends a process sends first: a person, a cluster or a service manager, a terminal that is closed."""

_NOT_IN = ("/llvmlite/", "/weakref.py", "<frozen importlib")
"""Parts of the names of files in whose functions, or those that they call, what is raised may be lost."""
_LATER_S = 0.05


class Asked(KeyboardInterrupt):
    """A signal has asked the process to end."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


@contextmanager
def ending_as_interrupted(*more: signal.Signals, first: Callable[[], None] | None = None) -> Iterator[None]:
    """Raise Asked in the main thread when one of ASKING, or of `more`, arrives; `first` is called before that.

    The next ones do nothing, but for SIGINT, which interrupts again. What is ignored, as SIGHUP is under nohup, stays
    so. What `held_back` kept waiting arrives now. Only in the main thread, as Python has it.
    """
    before = {number: signal.getsignal(number) for number in (*ASKING, *more)}
    before = {number: handler for number, handler in before.items() if handler is not signal.SIG_IGN}

    def ask(number: int, frame: FrameType | None) -> None:
        for each in before:
            signal.signal(each, signal.default_int_handler if each == signal.SIGINT else signal.SIG_IGN)
        raise_soon(number, frame)

    def raise_soon(number: int, frame: FrameType | None) -> None:
        if not _is_safe(frame):
            signal.signal(signal.SIGALRM, lambda _, later: raise_soon(number, later))
            signal.setitimer(signal.ITIMER_REAL, _LATER_S)
            return
        if first is not None:
            first()
        raise Asked(number)

    for number in before:
        signal.signal(number, ask)
    try:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, before)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _is_safe(frame: FrameType | None) -> bool:
    while frame is not None:
        if any(part in frame.f_code.co_filename for part in _NOT_IN):
            return False
        frame = frame.f_back
    return True


@contextmanager
def held_back(*more: signal.Signals) -> Iterator[Callable[[], None]]:
    """Let ASKING and `more` wait until the block ends, or what it gives is called.

    A process that is started meanwhile lets them wait, too, until it enters `ending_as_interrupted`.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (*ASKING, *more))

    def release() -> None:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)

    try:
        yield release
    finally:
        release()


@contextmanager
def finishing() -> Iterator[None]:
    """Let whatever would raise in the main thread wait until the block ends, which publishes files that must agree.

    `held_back` does not do: a signal that one thread lets wait reaches another one, and is raised in the main thread
    all the same.
    """
    if threading.current_thread() is not threading.main_thread():  # where nothing is raised
        yield
        return
    handlers: dict[int, Callable[[int, FrameType | None], object]] = {}
    came: list[int] = []
    try:
        for each in signal.valid_signals():
            if callable(handler := signal.getsignal(each)):
                handlers[each] = handler
                signal.signal(each, lambda number, _: came.append(number))
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for number in came[:1]:
            signal.raise_signal(number)
