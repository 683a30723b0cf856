"""The keys of parts as they are kept are those that their classes have, and are kept only as long as these last."""

import json

import pytest

from workbench.experiment import kept_keys as module
from workbench.experiment.build import resolved
from workbench.experiment.kept_keys import kept_keys
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
