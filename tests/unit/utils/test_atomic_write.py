"""A file appears complete or not at all."""

import errno
import os

import pytest

from workbench.utils.atomic_write import NotWrittenError, optional_cache, replace_text, whole_file
from workbench.utils.errors import InputError


def write_half(path):
    with whole_file(path) as part:
        part.write_text("half")
        raise KeyboardInterrupt


def test_a_complete_file_gets_its_name(tmp_path):
    with whole_file(tmp_path / "deep" / "a.txt", parents=True) as part:
        part.write_text("complete")
        assert not (tmp_path / "deep" / "a.txt").exists()
    assert (tmp_path / "deep" / "a.txt").read_text() == "complete"
    assert os.listdir(tmp_path / "deep") == ["a.txt"]


def test_an_interrupted_write_leaves_the_old_file(tmp_path):
    (tmp_path / "a.txt").write_text("old")
    with pytest.raises(KeyboardInterrupt):
        write_half(tmp_path / "a.txt")
    assert (tmp_path / "a.txt").read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_a_path_inside_a_file_is_rejected(tmp_path):
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(InputError, match=r"a\.txt: cannot be written"),
        whole_file(tmp_path / "file" / "a.txt", parents=True),
    ):
        pass


@pytest.fixture
def full(monkeypatch):
    """Simulate a full disk."""

    def no_space(*paths):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", no_space)


def test_on_a_full_disk_a_text_is_overwritten_within_its_size(tmp_path, full):
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
def test_a_failed_cache_write_is_reported_once(error, caplog):
    for _ in range(2):
        with optional_cache():
            raise error
    (message,) = caplog.messages
    assert message.endswith("the run continues without the cache")
    with pytest.raises(InputError, match="expected"), optional_cache():
        raise InputError("expected something else")
