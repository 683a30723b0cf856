"""Cached kernels and models are renewed if and only if a source file that they depend on changes."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core.caching import FunctionCache

import workbench
from workbench.motion.models import walking, windows
from workbench.utils.kernel_cache import kernel
from workbench.utils.signals import Interrupted, interruptible
from workbench.utils.source_hash import code_digest, digest_of

HELPER = """
from workbench.utils.kernel_cache import kernel

OFFSET = 0.0

@kernel()
def twice(x):
    return 2.0 * x
"""
KERNEL = """
from workbench.a_helper import OFFSET, twice
from workbench.utils.kernel_cache import kernel

@kernel()
def offset_twice(x):
    return OFFSET + twice(x)

if __name__ == "workbench.a_kernel":
    print(offset_twice(10.0), sum(offset_twice.stats.cache_hits.values()))
"""


@pytest.fixture
def package(tmp_path):
    """Return an editable copy of the package."""
    copy = tmp_path / "workbench"
    shutil.copytree(Path(workbench.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__", "conf"))
    return copy


def python(package, *arguments):
    environment = {**os.environ, "PYTHONPATH": str(package.parent)}
    command = [sys.executable, *arguments]
    done = subprocess.run(command, cwd=package.parent, env=environment, check=True, capture_output=True, text=True)
    return done.stdout, done.stderr


def run(package):
    """Return the kernel's value in a subprocess and its number of cache hits."""
    value, hits = python(package, "-c", "import workbench.a_kernel")[0].split()
    return float(value), int(hits)


def edit(path, old, new):
    """Replace a text in a file and lengthen the file, because Python detects old byte code by size and second."""
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new) + "\n")


@pytest.mark.slow
def test_a_changed_helper_in_another_file_is_recompiled(package):
    (package / "a_helper.py").write_text(HELPER)
    (package / "a_kernel.py").write_text(KERNEL)
    assert run(package) == (20.0, 0)
    assert run(package) == (20.0, 1)
    edit(package / "a_helper.py", "2.0 * x", "3.0 * x")
    assert run(package) == (30.0, 0)
    edit(package / "a_helper.py", "OFFSET = 0.0", "OFFSET = 1.0")
    assert run(package) == (31.0, 0)
    assert run(package) == (31.0, 1)
    edit(package / "cli" / "run.py", "\n", "\n")  # no kernel depends on it
    assert run(package) == (31.0, 1)
    cached = list((package / "__pycache__" / "kernels").rglob("*offset_twice*.nbc"))
    assert len(cached) == 1  # no obsolete file remains


def test_an_interruption_waits_until_a_cached_kernel_is_loaded(monkeypatch):
    """Otherwise numba's tables of types would stay incomplete, and every later compilation would fail."""

    def load(*_):
        signal.raise_signal(signal.SIGTERM)
        sum(i for i in range(3))  # Python handles signals between such steps
        loaded.append("completely")

    @kernel()
    def doubled(x):
        return 2.0 * x

    loaded = []
    monkeypatch.setattr(FunctionCache, "load_overload", load)
    with pytest.raises(Interrupted), interruptible():
        doubled(1.0)
    assert loaded == ["completely"]


@pytest.mark.slow
def test_a_kernel_that_cannot_be_cached_still_runs(package):
    (package / "a_helper.py").write_text(HELPER)
    (package / "a_kernel.py").write_text(KERNEL)
    (package / "__pycache__").mkdir()
    (package / "__pycache__" / "kernels").write_text("not a folder")
    output, warnings = python(package, "-c", "import workbench.a_kernel")
    assert output == "20.0 0\n"
    assert warnings.count("compiled kernels cannot be cached") >= 1


EVALUATED = """
import hashlib
import sys

import numpy as np

sys.path[:0] = sys.argv[1:]
import test_likelihood_contract as contract
from workbench.priors.implicit_search import kd_tree, nearest_entries, search
from workbench.priors.implicit_tree import draw, sign_tree


def report(name, *values):
    print(name, hashlib.sha256(b"".join(np.ascontiguousarray(value).tobytes() for value in values)).hexdigest())


rng = np.random.default_rng(0)
frames = contract.frames(rng, contract.LEFT, contract.RIGHT, n=3)
likelihood = contract.BUILDERS["image_motion"]().prepare(None, frames[0]).update(np.zeros(25))
report("motion", likelihood.prepare(*frames[:2]).evaluate(contract.poses(500), contract.poses(500, 2)).log_prob)
rows, probes = rng.normal(size=(3000, 8)).astype(np.float32), rng.normal(size=(300, 8))
result = search(kd_tree(rows), probes, np.ones(300, dtype=np.int64), 0.5, rng.random(300))
report("search", result.entries, result.log_mass, nearest_entries(kd_tree(rows), probes, 0.5))
report("tree", draw(sign_tree(rows), probes, 0.5, rng.random((300, 9))))
"""


@pytest.mark.slow
def test_compiled_and_cached_kernels_are_bitwise_identical(package):
    """For kernels with each kind of arithmetic, and kernels that call others."""
    tests = Path(__file__).parents[2]
    (package / "conf").symlink_to(tests.parent / "conf")
    command = ["-c", EVALUATED, str(tests / "scenes"), str(tests / "contract")]
    compiled, cached = (python(package, *command)[0] for _ in range(2))
    assert list((package / "__pycache__" / "kernels").rglob("*_run*.nbc"))
    assert compiled.splitlines() == cached.splitlines()
    assert len(compiled.splitlines()) == 3


SOURCES = {
    "workbench.a": b"from workbench.b import (\n    one,\n    two,\n)\n",
    "workbench.b": b"def late():\n    from workbench.package import c\n",
    "workbench.package": b"",
    "workbench.package.c": b"import numpy",
    "workbench.unrelated": b"import workbench.a",
}


@pytest.mark.parametrize(("edited", "changes"), [("a", True), ("b", True), ("package.c", True), ("unrelated", False)])
def test_the_digest_covers_all_imports_of_a_module(edited, changes):
    sources = SOURCES | {f"workbench.{edited}": SOURCES[f"workbench.{edited}"] + b"# edited"}
    assert (digest_of(sources, ["workbench.a"]) != digest_of(SOURCES, ["workbench.a"])) == changes


def test_digests_of_modules_differ():
    assert len({code_digest(), code_digest(walking), code_digest(windows), code_digest(walking, windows)}) == 4
    assert code_digest(walking) == code_digest(walking)
