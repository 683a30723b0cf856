"""What is kept of parts is what their classes say, and is kept only as long as these last."""

import json

import pytest

from workbench.core.traits import Traits, offering
from workbench.experiment import kept_keys as module
from workbench.experiment.build import resolved
from workbench.experiment.kept_keys import kept_keys, kept_traits
from workbench.experiment.parts import targets
from workbench.experiment.schema import _described, schema_of

TOLD = {"name": "workbench.x.X", "keys": {"a": ["int", 1]}}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    return tmp_path / "keys"


def never():
    raise AssertionError("asked again")


@pytest.mark.parametrize("target", sorted(targets()))
def test_every_part_of_ours_is_the_same_when_its_keys_were_kept(target):
    told = kept_keys(target, lambda: _described(resolved(target)))
    assert told == _described(resolved(target))
    assert kept_keys(target, never) == told
    assert schema_of(target).__dataclass_fields__.keys() == {"_target_", *told["keys"]}


def test_nothing_is_kept_of_other_packages(folder):
    assert kept_keys("my_parts.mine.Still", lambda: TOLD) == TOLD
    assert not folder.exists()


@pytest.mark.parametrize("damaged", ["", "{", "[]", '{"code": "other", "told": {}}', '{"told": {}}', "\x00"])
def test_what_is_damaged_or_of_other_code_is_asked_anew(folder, damaged):
    folder.mkdir()
    path = folder / "workbench.x.X.json"
    path.write_text(damaged)
    assert kept_keys("workbench.x.X", lambda: TOLD) == TOLD
    assert json.loads(path.read_text())["told"] == TOLD


def test_what_is_not_the_same_after_writing_is_not_kept(folder):
    assert kept_keys("workbench.x.X", lambda: {"keys": {1: 2}}) == {"keys": {1: 2}}
    assert not folder.exists()


def test_a_folder_that_cannot_be_written_is_done_without(folder):
    folder.write_text("a file")
    assert kept_keys("workbench.x.X", lambda: TOLD) == TOLD


def test_keys_are_kept_for_the_code_as_it_is(monkeypatch):
    kept_keys("workbench.x.X", lambda: TOLD)
    monkeypatch.setattr(module, "_code", lambda: "changed")
    with pytest.raises(AssertionError, match="asked again"):
        kept_keys("workbench.x.X", never)


NESTED = Traits(frozenset({"images"}), {"prior": frozenset({"b", "a"}), "given": frozenset()}, "it lacks something")


@pytest.mark.parametrize("traits", [None, Traits(), NESTED])
def test_traits_are_kept_by_what_they_depend_on(traits):
    def declare(keys):
        return (keys["part"], keys.get("absent"), traits)[-1]

    def asked(*_):
        raise AssertionError("asked again")

    keys = {"part": NESTED, "n": 3, "numbers": [1, 2.5], "named": {"a": "b"}}
    assert kept_traits("workbench.x.X", keys, declare) == traits
    assert kept_traits("workbench.x.X", {**keys, "n": 4}, asked) == traits  # at which nobody looked
    for others in ({**keys, "part": Traits()}, {**keys, "absent": 1}, {"n": 3}):
        with pytest.raises(AssertionError, match="asked again"):
            kept_traits("workbench.x.X", others, asked)
    assert kept_traits("workbench.x.X", {**keys, "part": Traits()}, declare) == traits
    assert kept_traits("workbench.x.X", keys, asked) == traits


def test_who_looks_at_all_keys_depends_on_all():
    keys = {"terms": {"a": Traits(), "b": NESTED}}
    for look in (dict, len, list):
        kept_traits(f"workbench.x.{look.__name__}", keys, lambda found, look=look: look(found) and None)
        with pytest.raises(ZeroDivisionError):
            kept_traits(f"workbench.x.{look.__name__}", {"terms": {"a": Traits()}}, lambda _: 1 / 0)


def test_traits_of_other_packages_and_of_what_has_no_words_are_not_kept(folder):
    for target, value in (("my_parts.mine.Still", 1), ("workbench.x.X", object())):
        for _ in range(2):
            assert kept_traits(target, {"a": value}, lambda keys: NESTED if keys["a"] else None) == NESTED
    assert not folder.exists()


def test_only_the_latest_traits_are_kept(folder):
    for n in range(module._MOST_KEPT + 5):
        kept_traits("workbench.x.X", {"n": n}, lambda keys: offering(str(keys["n"])))
    (path,) = folder.iterdir()
    entries = json.loads(path.read_text())["told"]
    assert [looked_at["n"] for looked_at, _ in entries] == list(range(5, module._MOST_KEPT + 5))


@pytest.mark.parametrize("told", ['{"a": 1}', "[1]", "[[1, 2]]", '[[{}, {"offers": 1}]]', "null", '[[{"n": 1}, {}]]'])
def test_traits_that_are_damaged_are_asked_anew(folder, told):
    kept_traits("workbench.x.X", {"n": 1}, lambda keys: offering(str(keys["n"])))
    (path,) = folder.iterdir()
    path.write_text(json.dumps({**json.loads(path.read_text()), "told": json.loads(told)}))
    assert kept_traits("workbench.x.X", {"n": 1}, lambda keys: NESTED) == NESTED
