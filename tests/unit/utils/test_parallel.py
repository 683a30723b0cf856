"""Parallel work covers every item once and passes on errors; working time excludes the compilation of kernels."""

import ast
import logging
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures import thread as pools
from threading import Barrier, Event, Thread, Timer, current_thread, main_thread
from threading import enumerate as all_threads
from time import perf_counter

import numba
import numpy as np
import pytest

from workbench.utils import parallel
from workbench.utils.parallel import Helpers, ahead, parallel_for
from workbench.utils.signals import Interrupted, interruptible
from workbench.utils.timing import compiled_s, compiling, on_one_stack, working_s

two_threads = pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="numba has one thread only")


@pytest.fixture(autouse=True)
def _two_threads():
    before = numba.get_num_threads()
    numba.set_num_threads(min(2, numba.config.NUMBA_NUM_THREADS))
    yield
    numba.set_num_threads(before)


@pytest.mark.parametrize(("n", "step"), [(0, 1), (1, 1), (7, 1), (100, 16), (33, 32), (5000, 3)])
def test_every_item_is_covered_once_by_parts_that_start_at_multiples_of_the_step(n, step):
    counts = np.zeros(n, dtype=int)

    def work(first, last):
        assert first % step == 0
        counts[first:last] += 1

    parallel_for(work, n, step)
    assert (counts == 1).all()


@two_threads
def test_an_error_is_raised_after_all_parts_have_ended():
    running = set()

    def work(first, last):
        running.add(first)
        try:
            if first == 3:
                raise ValueError("part 3")
        finally:
            running.discard(first)

    with pytest.raises(ValueError, match="part 3"):
        parallel_for(work, 8, 1)
    assert not running


def test_a_caller_does_not_wait_for_busy_helpers():
    """Callers do all of their work if no helper is free; parts may be nested."""
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


@two_threads
def test_an_interruption_during_thread_start_leaves_no_unlisted_thread(monkeypatch):
    """At its end, Python would wait forever for a thread that the pool started but did not list."""

    def start_and_interrupt(thread, start=Thread.start):
        start(thread)
        signal.raise_signal(signal.SIGTERM)

    parallel._helpers.cache_clear()
    monkeypatch.setattr(Thread, "start", start_and_interrupt)
    before = set(all_threads())
    with pytest.raises(Interrupted), interruptible():
        parallel_for(lambda first, last: None, 100, 1)
    assert all(thread in pools._threads_queues for thread in set(all_threads()) - before)
    monkeypatch.undo()
    parallel_for(lambda first, last: None, 100, 1)


def test_working_time_excludes_compilation():
    wall, working, compiled = perf_counter(), working_s(), compiled_s()
    with compiling(quiet=True):
        numba.njit(lambda x: x + 1.0)(2.0)
    wall, working, compiled = perf_counter() - wall, working_s() - working, compiled_s() - compiled
    assert compiled > 0.0
    assert abs(wall - working - compiled) < 0.005
    assert working < wall


@pytest.mark.parametrize("quiet", [False, True])
def test_a_kernel_and_its_helpers_are_counted_as_one_and_once(caplog, quiet):
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


def test_no_blas_library_uses_several_threads():
    """SciPy loads a library of its own, in a process that has only loaded NumPy's."""
    code = (
        "import numpy, threadpoolctl; from workbench.utils.parallel import single_blas_thread\n"
        "with single_blas_thread():\n"
        "    import scipy.linalg\n"
        "    print([each['num_threads'] for each in threadpoolctl.threadpool_info() if each['user_api'] == 'blas'])"
    )
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert set(ast.literal_eval(output)) == {1}


def test_items_are_computed_one_ahead_in_order():
    computed = []

    def items():
        for k in range(5):
            computed.append(k)
            yield k

    every = ahead(items())
    assert next(every) == 0
    every.close()  # waits for the thread
    assert computed == [0, 1]
    assert list(ahead(items())) == [0, 1, 2, 3, 4]
    assert list(ahead([])) == []


def test_an_error_of_an_item_computed_ahead_is_raised_at_its_place():
    def items():
        yield 1
        raise OSError("disk")

    every = ahead(items())
    assert next(every) == 1
    with pytest.raises(OSError, match="disk"):
        next(every)


@pytest.mark.parametrize("n_threads", [1, pytest.param(2, marks=two_threads)])
def test_begun_work_is_done_once_by_a_helper_or_by_the_caller(n_threads):
    numba.set_num_threads(n_threads)
    done, wait_for = [], Event()

    def work(number):
        done.append((number, current_thread() is main_thread()))
        if number == 0 and current_thread() is not main_thread():
            wait_for.wait(60.0)
        return 10 * number

    with Helpers(3) as helpers:
        results = [helpers.begin(work, number) for number in range(4)]
        last = [result() for result in results[:0:-1]]  # the only helper waits
        wait_for.set()
        assert [results[0](), *last[::-1]] == [0, 10, 20, 30]
    assert sorted(number for number, _ in done) == [0, 1, 2, 3]
    assert [by_caller for number, by_caller in done if number] == [True] * 3


@two_threads
def test_work_that_no_helper_has_begun_is_dropped_at_the_end():
    done, at_work, may_end = [], Event(), Event()

    def work(number):
        at_work.set()
        may_end.wait(60.0)
        done.append(number)

    with Helpers(1) as helpers:
        for number in range(3):
            helpers.begin(work, number)
        at_work.wait(60.0)
        Timer(0.1, may_end.set).start()
    assert done == [0]


def test_work_on_one_stack_returns_its_result_or_error_at_any_depth():
    def nested(depth):
        return 1 if depth == 0 else 1 + nested(depth - 1)

    assert on_one_stack(lambda: nested(500)) == 501
    with pytest.raises(ZeroDivisionError):
        on_one_stack(lambda: 1 // 0)
