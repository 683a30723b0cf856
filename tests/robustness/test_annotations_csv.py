"""Annotated joints in CSV: random damage, places beyond any image."""

import os

import pytest
from damage import refusal, withstands
from sound_files import ANNOTATIONS, written

from workbench.datasets.files.joint_annotations import read_marks


def test_random_damage(tmp_path):
    withstands(read_marks, written(tmp_path / "a.csv", ANNOTATIONS), 200)


@pytest.mark.parametrize("value", ["1e8", "nan", "-inf", "x", "9" * 400, ""])
def test_a_pixel_that_is_none(tmp_path, value):
    found = refusal(read_marks, written(tmp_path / "a.csv", ANNOTATIONS.replace("31,23", f"{value},23")))
    assert "a.csv:2: u must " in found


def test_a_pipe(tmp_path):
    os.mkfifo(tmp_path / "a.csv")
    assert refusal(read_marks, tmp_path / "a.csv").endswith("expected a file, found none")
