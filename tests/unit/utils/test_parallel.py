"""Work on parts is done once and errors reach the caller; a clock that stands still while kernels are compiled."""

import logging
import signal
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures import thread as pools
from threading import Barrier, Event, Thread, current_thread, main_thread
from threading import enumerate as all_threads
from time import perf_counter

import numba
import numpy as np
import pytest

from workbench.utils import parallel as threads
from workbench.utils.parallel import parallel_for
from workbench.utils.signals import Interrupted, interruptible
from workbench.utils.timing import compiled_s, compiling, working_s


@pytest.fixture(autouse=True)
def _two_threads():
    before = numba.get_num_threads()
    numba.set_num_threads(min(2, numba.config.NUMBA_NUM_THREADS))
    yield
    numba.set_num_threads(before)


@pytest.mark.parametrize(("n", "step"), [(0, 1), (1, 1), (7, 1), (100, 16), (33, 32), (5000, 3)])
def test_every_item_is_worked_on_once_in_parts_that_begin_at_the_step(n, step):
    counts = np.zeros(n, dtype=int)

    def work(first, last):
        assert first % step == 0
        counts[first:last] += 1

    parallel_for(work, n, step)
    assert (counts == 1).all()


def test_what_a_part_raises_reaches_the_caller_once_no_part_is_at_work_any_more():
    at_work = set()

    def work(first, last):
        at_work.add(first)
        try:
            if first == 3:
                raise ValueError("part 3")
        finally:
            at_work.discard(first)

    with pytest.raises(ValueError, match="part 3"):
        parallel_for(work, 8, 1)
    assert not at_work


def test_callers_do_not_wait_for_helpers_that_others_keep_busy():
    """Each does all of its own work where nobody is free to help; within a part, there may be parts again."""
    others_done, counts = Event(), np.zeros(4, dtype=int)

    def inner(first, last):
        counts[first:last] += 1

    def outer(first, last):
        if first == 0:
            parallel_for(inner, 4, 1)
            others_done.set()
        assert others_done.wait(60.0)

    with ThreadPoolExecutor(2) as pool:
        for done in [pool.submit(parallel_for, outer, 3, 1) for _ in range(2)]:
            done.result(60.0)
    assert (counts == 2).all()


def test_an_interruption_while_threads_start_leaves_none_that_python_would_wait_for(monkeypatch):
    """Python waits at its end for a thread that a pool has started; where the pool has not listed it, for ever."""

    def start_and_interrupt(thread, start=Thread.start):
        start(thread)
        signal.raise_signal(signal.SIGTERM)

    threads._helpers.cache_clear()
    monkeypatch.setattr(Thread, "start", start_and_interrupt)
    before = set(all_threads())
    with pytest.raises(Interrupted), interruptible():
        parallel_for(lambda first, last: None, 100, 1)
    assert all(each in pools._threads_queues for each in set(all_threads()) - before)
    monkeypatch.undo()
    parallel_for(lambda first, last: None, 100, 1)


def test_compiling_takes_no_time_on_this_clock():
    wall, working, compiled = perf_counter(), working_s(), compiled_s()
    with compiling(quiet=True):
        numba.njit(lambda x: x + 1.0)(2.0)
    wall, working, compiled = perf_counter() - wall, working_s() - working, compiled_s() - compiled
    assert compiled > 0.0
    assert abs(wall - working - compiled) < 0.005
    assert working < wall


@pytest.mark.parametrize("quiet", [False, True])
def test_kernels_are_counted_with_their_helpers_as_one_and_once(caplog, quiet):
    @numba.njit
    def helper(x):
        return x + 1

    @numba.njit
    def kernel(x):
        return 2 * helper(x)

    with caplog.at_level(logging.INFO), compiling(quiet):
        assert kernel(1) == 4
    assert [message.startswith("compiled 1 kernels in ") for message in caplog.messages] == ([] if quiet else [True])
    caplog.clear()
    with caplog.at_level(logging.INFO), compiling(quiet):
        assert kernel(2) == 6
    assert caplog.messages == []


def test_the_error_of_the_calling_thread_takes_precedence_over_those_of_its_helpers():
    both_at_work = Barrier(2)

    def work(first, last):
        both_at_work.wait(60.0)
        raise KeyboardInterrupt if current_thread() is main_thread() else ValueError("a helper's")

    with pytest.raises(KeyboardInterrupt):
        parallel_for(work, 2, 1)
