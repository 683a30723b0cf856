"""A parser in the sandbox returns arrays or raises one InputError, whatever it does."""

import resource
import sys

import numpy as np
import pytest

from workbench.utils import sandbox
from workbench.utils.errors import InputError
from workbench.utils.input_limits import MAX_NUMBERS
from workbench.utils.sandbox import parse_limited

PARSERS = """
import io, os, sys, time, zipfile
import numpy as np
from workbench.utils.errors import InputError

def arrays(path):
    print("noise")
    os.write(1, b"noise")
    return {"/a": np.arange(6.0).reshape(2, 3), "/file": np.array(["é", "b"]), "size": np.array(path.stat().st_size)}
def crashes(path): os.kill(os.getpid(), 11)
def aborts(path): os.abort()
def sleeps(path): time.sleep(1000)
def hoards(path): return {"a": np.ones(10**9)}
def raises(path): raise KeyError("two\\nlines")
def refuses(path): raise InputError(f"{path}: expected nothing")
def exits(path): sys.exit("a sentence")
def returns_objects(path): return {"a": np.array([None, {}], dtype=object)}
def returns_nothing(path): return None
def ends_early(path): os._exit(0)
def _take_over(content):
    os.write(max(int(n) for n in os.listdir("/proc/self/fd") if os.path.exists(f"/proc/self/fd/{n}")), content)
    os._exit(0)
def writes_bytes(path): _take_over(bytes(1000))
def writes_a_bomb(path):
    packed = io.BytesIO()
    np.savez_compressed(packed, a=np.zeros(10**7))
    _take_over(packed.getvalue())
"""
CRASH, NO_ARRAYS = "damage that crashes the reader", "whose reader returned no arrays"
ENDS = {
    "crashes": CRASH, "aborts": CRASH, "sleeps": "takes more than", "hoards": "MemoryError",
    "raises": r"expected an x: KeyError: 'two\\nlines'$", "refuses": "(?<=a.x: )expected nothing$",
    "exits": "a sentence$", "returns_objects": NO_ARRAYS, "returns_nothing": "TypeError", "ends_early": NO_ARRAYS,
    "writes_bytes": "not a zip file", "writes_a_bomb": "compressed data",
}  # fmt: skip


@pytest.fixture
def parsers(tmp_path, monkeypatch):
    """Yield a module of misbehaving parsers that the subprocess can import."""
    (tmp_path / "a.x").write_text("12345")
    (tmp_path / "hostile_parsers.py").write_text(PARSERS)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.syspath_prepend(tmp_path)
    yield __import__("hostile_parsers")
    del sys.modules["hostile_parsers"]


def test_arrays_are_returned_although_the_parser_prints(parsers, tmp_path):
    arrays = parse_limited(parsers.arrays, tmp_path / "a.x", what="an x")
    np.testing.assert_array_equal(arrays["/a"], np.arange(6.0).reshape(2, 3))
    assert (arrays["/file"].tolist(), int(arrays["size"])) == (["é", "b"], 5)


@pytest.mark.parametrize("parser", ENDS)
@pytest.mark.slow
def test_any_failure_of_a_parser_is_an_input_error(parser, parsers, tmp_path, monkeypatch):
    if parser == "sleeps":
        monkeypatch.setattr(sandbox, "_WALL", 0.2)
    before = len(list(tmp_path.iterdir()))
    with pytest.raises(InputError, match=rf"/a\.x: .*{ENDS[parser]}"):
        parse_limited(getattr(parsers, parser), tmp_path / "a.x", what="an x")
    assert len([path for path in tmp_path.iterdir() if path.name != "__pycache__"]) <= before  # no core file


def test_the_limits_hold_for_the_subprocess_only(parsers, tmp_path):
    kinds = (resource.RLIMIT_CPU, resource.RLIMIT_DATA, resource.RLIMIT_FSIZE)
    limits = [resource.getrlimit(kind) for kind in kinds]
    parse_limited(parsers.arrays, tmp_path / "a.x", what="an x")
    assert [resource.getrlimit(kind) for kind in kinds] == limits
    assert 8 * MAX_NUMBERS < sandbox.MEMORY_BYTES
