"""A clock that stands still while kernels are compiled."""

from time import perf_counter

import numba

from workbench.clock import compiled_s, measured_compilation, working_s


def test_compiling_takes_no_time_on_this_clock():
    wall, working, compiled = perf_counter(), working_s(), compiled_s()
    with measured_compilation(lambda name: None, lambda: None):
        numba.njit(lambda x: x + 1.0)(2.0)
    wall, working, compiled = perf_counter() - wall, working_s() - working, compiled_s() - compiled
    assert compiled > 0.0
    assert abs(wall - working - compiled) < 0.005
    assert working < wall
