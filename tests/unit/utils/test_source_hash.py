"""A cache is stale when a module or anything that it imports was edited, and only then."""

import pytest

from workbench.motion.models import walking, windows
from workbench.utils.source_hash import code_digest, digest_of

SOURCES = {
    "workbench.a": b"from workbench.b import (\n    one,\n    two,\n)\n",
    "workbench.b": b"def late():\n    from workbench.rooms import c\n",
    "workbench.rooms": b"",
    "workbench.rooms.c": b"import numpy",
    "workbench.aside": b"import workbench.a",
}


@pytest.mark.parametrize(("edited", "matters"), [("a", True), ("b", True), ("rooms.c", True), ("aside", False)])
def test_it_is_of_all_that_a_module_imports(edited, matters):
    changed = SOURCES | {f"workbench.{edited}": SOURCES[f"workbench.{edited}"] + b"# edited"}
    assert (digest_of(changed, ["workbench.a"]) != digest_of(SOURCES, ["workbench.a"])) == matters


def test_it_is_the_modules_own():
    assert len({code_digest(), code_digest(walking), code_digest(windows), code_digest(walking, windows)}) == 4
    assert code_digest(walking) == code_digest(walking)
