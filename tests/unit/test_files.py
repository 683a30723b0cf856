"""A file appears whole or not at all."""

import os

import pytest

from workbench.errors import InputError
from workbench.files import whole_file


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
