"""OpenBLAS takes one code path on every processor that has it, unless somebody says otherwise."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from workbench.blas import use_one_code_path

INFO = "processor : 0\nmodel name : some\nflags : fpu sse2 {}\nprocessor : 1\nflags : fpu\n"


@pytest.mark.parametrize(
    ("flags", "given", "expected"),
    [
        ("avx2 fma avx512f", {}, {"OPENBLAS_CORETYPE": "Haswell"}),
        ("avx2", {}, {}),
        ("avx2 fma", {"OPENBLAS_CORETYPE": "Zen"}, {"OPENBLAS_CORETYPE": "Zen"}),
    ],
)
def test_it_is_chosen_where_the_processor_has_it_and_nobody_else_chose(tmp_path, flags, given, expected):
    (info := tmp_path / "cpuinfo").write_text(INFO.format(flags))
    environment = dict(given)
    use_one_code_path(environment, info)
    assert environment == expected


def test_other_systems_keep_their_way(tmp_path):
    environment = {}
    use_one_code_path(environment, tmp_path / "none")
    assert environment == {}


def test_numpy_and_scipy_load_it():
    info = Path("/proc/cpuinfo")
    if not info.exists() or not {"avx2", "fma"} <= set(info.read_text().split()):
        pytest.skip("a processor without AVX2, or no Linux")
    code = "import workbench, numpy, scipy.linalg, threadpoolctl; print(threadpoolctl.threadpool_info())"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    found = [each["architecture"] for each in ast.literal_eval(told.stdout) if each["internal_api"] == "openblas"]
    assert found
    assert set(found) == {"Haswell"}
