"""Whatever a parser does in the sandbox, the caller gets arrays or one InputError."""

import resource
import sys
import time

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
def loops(path):
    while True: pass
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
    "crashes": CRASH, "aborts": CRASH, "loops": CRASH, "sleeps": "takes more than", "hoards": "MemoryError",
    "raises": r"expected an x: KeyError: 'two\\nlines'$", "refuses": "(?<=a.x: )expected nothing$",
    "exits": "a sentence$", "returns_objects": NO_ARRAYS, "returns_nothing": "TypeError", "ends_early": NO_ARRAYS,
    "writes_bytes": "not a zip file", "writes_a_bomb": "compressed data",
}  # fmt: skip


@pytest.fixture
def parsers(tmp_path, monkeypatch):
    """Parsers in a module that the child imports, too, with limits that are soon reached."""
    (tmp_path / "a.x").write_text("12345")
    (tmp_path / "nasty_parsers.py").write_text(PARSERS)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.syspath_prepend(tmp_path)
    yield __import__("nasty_parsers")
    del sys.modules["nasty_parsers"]


def test_arrays_come_back_whatever_the_parser_prints(parsers, tmp_path):
    found = parse_limited(parsers.arrays, tmp_path / "a.x", what="an x")
    np.testing.assert_array_equal(found["/a"], np.arange(6.0).reshape(2, 3))
    assert (found["/file"].tolist(), int(found["size"])) == (["é", "b"], 5)


@pytest.mark.parametrize("parser", ENDS)
@pytest.mark.slow
def test_anything_else_is_an_input_error(parser, parsers, tmp_path, monkeypatch):
    if parser == "sleeps":
        monkeypatch.setattr(sandbox, "_WALL", 0.2)
    before = len(list(tmp_path.iterdir()))
    with pytest.raises(InputError, match=rf"/a\.x: .*{ENDS[parser]}"):
        parse_limited(getattr(parsers, parser), tmp_path / "a.x", what="an x")
    assert len([path for path in tmp_path.iterdir() if path.name != "__pycache__"]) <= before  # no core file


def test_the_limits_are_those_of_the_child_alone(parsers, tmp_path):
    limits = [resource.getrlimit(each) for each in (resource.RLIMIT_CPU, resource.RLIMIT_DATA, resource.RLIMIT_FSIZE)]
    began = time.perf_counter()
    parse_limited(parsers.arrays, tmp_path / "a.x", what="an x")
    assert time.perf_counter() - began < 60.0
    after = [resource.getrlimit(each) for each in (resource.RLIMIT_CPU, resource.RLIMIT_DATA, resource.RLIMIT_FSIZE)]
    assert after == limits
    assert 8 * MAX_NUMBERS < sandbox.MEMORY_BYTES
