"""Compiled kernels are thrown away when anything that went into them is edited, in whatever file."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import workbench
from workbench.kernel_cache import source_key

HELPER = """
import numba

OFFSET = 0.0

@numba.njit(cache=True)
def twice(x):
    return 2.0 * x
"""
KERNEL = """
import numba

from workbench.a_helper import OFFSET, twice

@numba.njit(cache=True)
def kernel(x):
    return OFFSET + twice(x)

if __name__ == "workbench.a_kernel":
    print(kernel(10.0), sum(kernel.stats.cache_hits.values()))
"""


@pytest.fixture
def package(tmp_path):
    """A copy of the package that can be edited."""
    copy = tmp_path / "workbench"
    shutil.copytree(Path(workbench.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__", "conf"))
    return copy


def run(package):
    """What the kernel says in a process of its own, and whether it came from the cache."""
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    environment["PYTHONPATH"] = str(package.parent)
    command = [sys.executable, "-c", "import workbench.a_kernel"]
    done = subprocess.run(command, cwd=package.parent, env=environment, check=True, capture_output=True, text=True)
    value, hits = done.stdout.split()
    return float(value), int(hits)


def edit(path, old, new):
    """Replace a text in a file, which gets longer: by its size and the second Python tells whether byte code is old."""
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new) + "\n")


@pytest.mark.slow
def test_an_edited_helper_in_another_file_is_compiled_again(package):
    (package / "a_helper.py").write_text(HELPER)
    (package / "a_kernel.py").write_text(KERNEL)
    assert run(package) == (20.0, 0)
    assert run(package) == (20.0, 1)
    edit(package / "a_helper.py", "2.0 * x", "3.0 * x")
    assert run(package) == (30.0, 0)
    edit(package / "a_helper.py", "OFFSET = 0.0", "OFFSET = 1.0")
    assert run(package) == (31.0, 0)
    assert run(package) == (31.0, 1)
    assert len(list((package / "__pycache__").glob("kernels-*"))) == 1  # nothing outdated is left


@pytest.mark.parametrize(
    ("edited", "matters"),
    [
        ("likelihoods/image_motion/patches.py", True),
        ("body/lanes.py", True),
        ("body/skeleton.py", True),  # without a kernel of its own, but imported beside some
        ("cli/run.py", False),
        ("experiment/running.py", False),  # which sets numba's threads, but has no kernel
    ],
)
def test_the_key_is_of_all_that_gets_into_kernels(package, edited, matters):
    before = source_key(package)
    assert before == source_key(package)
    (package / edited).write_text((package / edited).read_text() + "\n# edited\n")
    assert (source_key(package) != before) == matters


EVALUATED = """
import hashlib
import sys

import numpy as np

sys.path[:0] = sys.argv[1:]
import test_likelihood_contract as contract
from workbench.priors.implicit_search import kd_tree, nearest_entries, search
from workbench.priors.implicit_tree import draw, sign_tree


def tell(name, *values):
    print(name, hashlib.sha256(b"".join(np.ascontiguousarray(each).tobytes() for each in values)).hexdigest())


rng = np.random.default_rng(0)
frames = contract.frames(rng, contract.LEFT, contract.RIGHT, n=3)
for name, build in contract.BUILDERS.items():
    likelihood = build().look(None, frames[0]).remember(np.zeros(25))
    tell(name, likelihood.look(*frames[:2]).evaluate(contract.poses(500), contract.poses(500, 2)).log_prob)
rows, probes = rng.normal(size=(3000, 8)).astype(np.float32), rng.normal(size=(300, 8))
found = search(kd_tree(rows), probes, np.ones(300, dtype=np.int64), 0.5, rng.random(300))
tell("search", found.entries, found.log_mass, nearest_entries(kd_tree(rows), probes, 0.5))
tell("tree", draw(sign_tree(rows), probes, 0.5, rng.random((300, 9))))
"""


@pytest.mark.parametrize(("given", "level"), [({}, 2), ({"NUMBA_OPT": "3"}, 3)])
def test_kernels_are_compiled_at_the_second_level_unless_another_is_given(given, level):
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_OPT"} | given
    told = [sys.executable, "-c", "import workbench, numba; print(int(numba.config.OPT))"]
    assert int(subprocess.run(told, env=environment, check=True, capture_output=True, text=True).stdout) == level


@pytest.mark.slow
def test_kernels_just_compiled_and_kernels_kept_give_the_same_bits(tmp_path):
    """Of every likelihood, and of the searches of the implicit prior."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    tests = Path(__file__).parents[1]
    command = [sys.executable, "-c", EVALUATED, str(tests / "scenes"), str(tests / "contract")]
    compiled, kept = (
        subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout for _ in range(2)
    )
    assert list(tmp_path.rglob("*_run*.nbc"))
    assert compiled.splitlines() == kept.splitlines()
    assert len(compiled.splitlines()) > 12
