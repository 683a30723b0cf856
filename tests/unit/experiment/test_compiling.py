"""A run says what it compiles, and only that."""

import logging

import numba
import pytest

from workbench.experiment.compiling import compiling


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
