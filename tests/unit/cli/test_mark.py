"""The command prints the page's address, serves it until it is interrupted, and counts the annotations."""

import cv2
import numpy as np
import pytest

from workbench.cli import annotate as mark


@pytest.fixture
def film(tmp_path):
    (tmp_path / "film").mkdir()
    for t in range(3):
        cv2.imwrite(str(tmp_path / "film" / f"{t}.png"), np.full((48, 64, 3), 9, np.uint8))
    return tmp_path / "film"


def test_the_page_is_opened_and_annotations_are_counted(film, tmp_path, monkeypatch, capsys):
    opened = []
    monkeypatch.setattr(mark.webbrowser, "open", opened.append)
    monkeypatch.setattr(mark, "serve", lambda server: server.annotations.put((1, "neck"), (3.0, 4.0, True)))
    assert mark.main([str(film), "-o", str(tmp_path / "m.csv")]) == 0
    said = capsys.readouterr().out
    assert opened[0].startswith("http://127.0.0.1:")
    assert opened[0] in said
    assert "m.csv: 0 joints in 0 of 3 frames" in said
    assert said.endswith("m.csv: 1 joints in 1 of 3 frames\n")


@pytest.mark.parametrize(
    ("video", "output", "said"),
    [("none.mp4", "m.csv", "no such video"), ("film", "none/m.csv", "expected a folder")],
)
def test_bad_words_are_one_sentence(film, tmp_path, capsys, video, output, said):
    assert mark.main([str(tmp_path / video), "-o", str(tmp_path / output), "--no-browser"]) == 2
    printed = capsys.readouterr().err
    assert said in printed
    assert printed.count("\n") == 1
