"""Subprocesses and their time limits, and the environment that determines results bitwise."""

import os
import subprocess
import sys
import time

import pytest

from workbench.utils.environment import differing, environment
from workbench.utils.processes import CAPTURED, end, module, run, start

ENDLESS = [sys.executable, "-c", "import time; time.sleep(600)"]


def test_a_command_returns_its_output_and_exit_code(tmp_path):
    code = "import os, sys; print(os.getcwd(), os.environ['WORD']); sys.exit(3)"
    variables = {**os.environ, "WORD": "value"}
    command = [sys.executable, "-c", code]
    completed = run(command, stdout=CAPTURED, stderr=CAPTURED, cwd=tmp_path, env=variables)
    assert (completed.stdout.decode().split(), completed.returncode) == ([str(tmp_path), "value"], 3)


def test_a_command_is_killed_at_its_time_limit():
    began = time.monotonic()
    with pytest.raises(TimeoutError, match=r"time limit of 0\.5 s"):
        run(ENDLESS, timeout_s=0.5)
    assert time.monotonic() - began < 30.0


def test_a_module_is_not_imported_from_the_current_folder(tmp_path):
    (tmp_path / "platform.py").write_text("print('of the current folder')")
    assert b"current folder" not in run(module("platform"), stdout=CAPTURED, stderr=CAPTURED, cwd=tmp_path).stdout


def test_a_background_command_ends_with_its_input():
    process = start([sys.executable, "-c", "import sys; sys.exit(7 + len(sys.stdin.read()))"])
    assert end(process, 60.0) == 7


def test_a_background_command_that_does_not_end_is_killed():
    assert end(start(ENDLESS), 0.2) < 0


PRINT = "from workbench.utils.environment import environment; print(environment()[{!r}])"


def test_the_environment_lists_what_determines_results():
    names = {"system", "numpy_cpu", "opencv_cpu", "numba_cpu", "blas", "python", "numpy", "scipy", "numba"}
    assert names <= environment().keys()
    assert all(isinstance(value, str) and value for name, value in environment().items() if not name.endswith("_cpu"))


@pytest.mark.parametrize(
    ("variable", "value", "name"),
    [("OPENBLAS_CORETYPE", "Prescott", "blas"), ("NUMBA_CPU_NAME", "generic", "numba_cpu")],
)
def test_the_environment_lists_the_settings_in_use(variable, value, name):
    command = [sys.executable, "-c", PRINT.format(name)]
    done = subprocess.run(command, env={**os.environ, variable: value}, capture_output=True, text=True, check=True)
    assert value in done.stdout


def test_only_differences_are_listed():
    earlier = {"numpy": "2.0.0", "numba_cpu": "znver4 +avx +avx2 +avx512f", "blas": "openblas 0.3.30 Zen"}
    current = {"numpy": "2.4.6", "numba_cpu": "znver4 +avx +avx2", "blas": "openblas 0.3.30 Zen", "python": "3.12.1"}
    assert differing(earlier, current) == {
        "numpy": ("2.0.0", "2.4.6"), "numba_cpu": ("+avx512f", "fewer"), "python": ("unknown", "3.12.1"),
    }  # fmt: skip
    assert differing(earlier, earlier) == {}
