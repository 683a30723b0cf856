"""The environment that decides the last bits of results, and how two of them differ."""

import os
import subprocess
import sys

import pytest

from workbench.utils.environment import differing, environment

PRINT = "from workbench.utils.environment import environment; print(environment()[{!r}])"


def test_it_names_all_that_decides_bits():
    names = {"system", "numpy_cpu", "opencv_cpu", "numba_cpu", "blas", "python", "numpy", "scipy", "numba"}
    assert names <= environment().keys()
    assert all(isinstance(value, str) and value for name, value in environment().items() if not name.endswith("_cpu"))


@pytest.mark.parametrize(
    ("variable", "value", "name"),
    [("OPENBLAS_CORETYPE", "Prescott", "blas"), ("NUMBA_CPU_NAME", "generic", "numba_cpu")],
)
def test_it_is_what_is_in_use(variable, value, name):
    command = [sys.executable, "-c", PRINT.format(name)]
    done = subprocess.run(command, env={**os.environ, variable: value}, capture_output=True, text=True, check=True)
    assert value in done.stdout


def test_only_what_differs_is_named():
    was = {"numpy": "2.0.0", "numba_cpu": "znver4 +avx +avx2 +avx512f", "blas": "openblas 0.3.30 Zen"}
    now = {"numpy": "2.4.6", "numba_cpu": "znver4 +avx +avx2", "blas": "openblas 0.3.30 Zen", "python": "3.12.1"}
    assert differing(was, now) == {
        "numpy": ("2.0.0", "2.4.6"), "numba_cpu": ("+avx512f", "less"), "python": ("unknown", "3.12.1"),
    }  # fmt: skip
    assert differing(was, was) == {}
