"""A clock that stands still while kernels are compiled."""

import logging
from time import perf_counter

import numba
import pytest

from workbench.utils.timing import compiled_s, compiling, working_s


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
