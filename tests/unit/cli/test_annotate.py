"""The command prints the page's address, serves it until it is interrupted, and counts the annotations."""

import cv2
import numpy as np
import pytest

from workbench.cli import annotate
from workbench.cli.main import main


@pytest.fixture
def film(tmp_path):
    (tmp_path / "film").mkdir()
    for t in range(3):
        cv2.imwrite(str(tmp_path / "film" / f"{t}.png"), np.full((48, 64, 3), 9, np.uint8))
    return tmp_path / "film"


def test_the_page_is_opened_and_annotations_are_counted(film, tmp_path, monkeypatch, capsys):
    opened = []
    monkeypatch.setattr(annotate.webbrowser, "open", opened.append)
    monkeypatch.setattr(annotate, "serve", lambda server: server.annotations.put((1, "neck"), (3.0, 4.0, True)))
    assert main(["annotate", str(film), "-o", str(tmp_path / "m.csv")]) == 0
    printed = capsys.readouterr().out
    assert opened[0].startswith("http://127.0.0.1:")
    assert opened[0] in printed
    assert "m.csv: 0 joints in 0 of 3 frames" in printed
    assert printed.endswith("m.csv: 1 joints in 1 of 3 frames\n")


def test_a_folder_that_is_not_there_is_one_sentence(film, capsys):
    assert main(["annotate", str(film), "-o", str(film / "none" / "m.csv"), "--no-browser"]) == 2
    printed = capsys.readouterr().err
    assert "expected a folder" in printed
    assert printed.count("\n") == 1
