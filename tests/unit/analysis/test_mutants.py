"""The mutants of a module: every change is one fault in its code, and none is in messages."""

import ast

from analysis import mutants

SOURCE = b'''
def clipped(x, limit=1):
    """Return -x + 1."""
    if not x <= limit and x > 0:
        raise ValueError(f"{x + 1}")
    return -x * 2.0
'''


def mutated(mutant):
    return SOURCE[: mutant.start] + mutant.new + SOURCE[mutant.end :]


def test_each_mutant_changes_one_place_of_the_code():
    found = list(mutants._Module("a.py", SOURCE).mutants())
    changed = {(SOURCE[each.start : each.end], each.new) for each in found}
    assert changed == {
        (b"1", b"2"), (b"0", b"1"), (b"<=", b"<"), (b">", b">="), (b"and", b"or"), (b"not x <= limit", b"(x <= limit)"),
        (b"-x", b"(x)"), (b"*", b"/"), (b"-x * 2.0", b"(-x)"),
    }  # fmt: skip
    trees = {ast.dump(ast.parse(mutated(each))) for each in found}
    assert len(trees) == len(found)
    assert ast.dump(ast.parse(SOURCE)) not in trees
    assert {each.function for each in found} == {2}


def test_the_nearest_tests_come_first():
    near = mutants.CalledTest("tests/test_a.py::near", 1.0, ["a.py:2"])
    far = mutants.CalledTest("tests/test_b.py::far", 1.0, ["a.py:9"])
    other = mutants.CalledTest("tests/test_c.py::other", 1.0, ["b.py:2"])
    (mutant, *_) = mutants._Module("a.py", SOURCE).mutants()
    assert mutants._chosen_tests(mutant, [other, far, near]) == [[near], [far]]
