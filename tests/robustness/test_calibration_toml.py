"""Calibration files in TOML: random damage, and what keeps a parser busy for minutes."""

import os

import pytest
from damage import refusal, withstands
from sound_files import TOML, written

from workbench.body.camera import load_cameras

BOMBS = {
    "a dotted key": ".".join("a" * 200_000) + " = 1", "a table's dotted name": "[" + ".".join("a" * 200_000) + "]",
    "a quoted dotted key": 'a."b".' * 100 + "c = 1", "lists in one another": "a = " + "[" * 5000,
    "tables in one another": "a = " + "{b = " * 3000 + "}" * 3000, "digits": "a = 1" + "0" * 5000,
    "many keys": "\n".join(f"a{k}.b = 1" for k in range(80_000)), "one long word": "x" * 900_000,
    "more characters": "#" * 1_000_001,
}  # fmt: skip


def test_random_damage(tmp_path):
    withstands(load_cameras, written(tmp_path / "a.toml", TOML), 200)


@pytest.mark.parametrize("bomb", BOMBS)
def test_a_bomb(tmp_path, bomb):
    assert "a.toml: " in refusal(load_cameras, written(tmp_path / "a.toml", BOMBS[bomb]))


def test_a_folder_and_a_pipe(tmp_path):
    (tmp_path / "a.toml").mkdir()
    os.mkfifo(tmp_path / "b.toml")
    assert refusal(load_cameras, tmp_path / "a.toml").endswith("expected a file, found a folder")
    assert refusal(load_cameras, tmp_path / "b.toml").endswith("expected a file, found none")
