"""Signals that interrupt a process."""

import os
import signal
import weakref

import pytest

from workbench.utils.signals import Interrupted, check_interrupted, deferred, interruptible


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_interrupts_once_and_handlers_are_restored(number):
    before = signal.getsignal(number)
    closed = []

    def work():
        try:
            os.kill(os.getpid(), number)
        finally:  # cleanup is not interrupted
            os.kill(os.getpid(), signal.SIGTERM)
            closed.append(number)

    with pytest.raises(Interrupted, match=number.name) as error, interruptible():
        work()
    assert (error.value.number, closed) == (number, [number])
    assert isinstance(error.value, KeyboardInterrupt)
    assert signal.getsignal(number) is before


def test_an_interruption_is_deferred_to_the_end_of_the_outermost_block():
    reached = []

    def work():
        with deferred():
            with deferred():
                os.kill(os.getpid(), signal.SIGTERM)
            reached.append("inner block ended")
        reached.append("never")

    with pytest.raises(Interrupted, match="SIGTERM"), interruptible():
        work()
    assert reached == ["inner block ended"]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_interruption_lost_in_a_callback_is_raised_at_the_next_check():
    """Python prints and drops what a weak reference's callback raises."""

    class Thing:
        pass

    thing = Thing()
    _reference = weakref.ref(thing, lambda _: os.kill(os.getpid(), signal.SIGTERM))
    reached = []

    def work():
        nonlocal thing
        thing = None
        reached.append("after the callback")
        check_interrupted()

    with pytest.raises(Interrupted, match="SIGTERM"), interruptible():
        work()
    assert reached == ["after the callback"]
    check_interrupted()  # no interruption is pending outside the block


def test_ignored_signals_and_the_callers_handlers_are_unchanged():
    def own_handler(number, frame):
        received.append(number)

    received = []
    hup, term = signal.signal(signal.SIGHUP, signal.SIG_IGN), signal.signal(signal.SIGTERM, own_handler)
    try:
        with interruptible():
            os.kill(os.getpid(), signal.SIGHUP)
            os.kill(os.getpid(), signal.SIGTERM)
            assert signal.getsignal(signal.SIGTERM) is own_handler
    finally:
        signal.signal(signal.SIGHUP, hup)
        signal.signal(signal.SIGTERM, term)
    assert received == [signal.SIGTERM]
