"""A file appears whole or not at all."""

import errno
import os

import pytest

from workbench.utils.atomic_write import NotWrittenError, optional_cache, replace_text, whole_file
from workbench.utils.errors import InputError


def write_half(path):
    with whole_file(path) as part:
        part.write_text("half")
        raise KeyboardInterrupt


def test_what_ends_well_takes_the_name(tmp_path):
    with whole_file(tmp_path / "deep" / "a.txt", parents=True) as part:
        part.write_text("whole")
        assert not (tmp_path / "deep" / "a.txt").exists()
    assert (tmp_path / "deep" / "a.txt").read_text() == "whole"
    assert os.listdir(tmp_path / "deep") == ["a.txt"]


def test_what_breaks_off_leaves_the_old_file(tmp_path):
    (tmp_path / "a.txt").write_text("old")
    with pytest.raises(KeyboardInterrupt):
        write_half(tmp_path / "a.txt")
    assert (tmp_path / "a.txt").read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_a_folder_that_is_none_is_said(tmp_path):
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(InputError, match=r"a\.txt: cannot be written"),
        whole_file(tmp_path / "file" / "a.txt", parents=True),
    ):
        pass


@pytest.fixture
def full(monkeypatch):
    """A disk on which no file can be made."""

    def refuse(*paths):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", refuse)


def test_on_a_full_disk_a_text_is_replaced_within_its_room(tmp_path, full):
    path = tmp_path / "a.json"
    path.write_text("{}".ljust(20))
    replace_text(path, "[1, 2]")
    assert path.read_text() == "[1, 2]".ljust(20)
    replace_text(path, "[" + "1, " * 20 + "1]", shorter="[3]")
    assert path.read_text() == "[3]".ljust(20)
    with pytest.raises(InputError, match=r"a\.json: cannot be written: No space left on device"):
        replace_text(path, "x" * 30, shorter="y" * 21)
    with pytest.raises(InputError, match="No space left"):
        replace_text(tmp_path / "new.json", "[]", shorter="0")
    assert os.listdir(tmp_path) == ["a.json"]


@pytest.mark.parametrize(
    "error",
    [OSError(28, "No space left on device"), RuntimeError("Can't decrement id"), NotWrittenError("x: cannot be")],
)
def test_what_cannot_be_kept_in_a_cache_is_told_once(error, caplog):
    for _ in range(2):
        with optional_cache():
            raise error
    (told,) = caplog.messages
    assert told.endswith("the run continues without the cache")
    with pytest.raises(InputError, match="expected"), optional_cache():
        raise InputError("expected something else")
