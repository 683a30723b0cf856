"""`workbench detect` refuses what it cannot read before it downloads anything, and writes one folder a video."""

import cv2
import numpy as np
import pytest

from workbench.cli import detect
from workbench.cli.main import main
from workbench.datasets.detection import detection_files
from workbench.datasets.detection.landmark_network import PersonLandmarks


@pytest.fixture
def film(tmp_path):
    (tmp_path / "film").mkdir()
    for t in range(3):
        cv2.imwrite(str(tmp_path / "film" / f"{t}.png"), np.full((48, 64, 3), 9, np.uint8))
    return tmp_path / "film"


@pytest.fixture
def model(tmp_path, monkeypatch):
    """A model that sees nobody."""
    zeros = np.zeros((33, 3))
    monkeypatch.setattr(
        detection_files,
        "LandmarkNetwork",
        lambda _: lambda image, region: PersonLandmarks(zeros[:, :2], zeros[:, 0], zeros, 0.0, region),
    )
    (tmp_path / "model.tflite").write_bytes(b"model")
    return tmp_path / "model.tflite"


def test_every_video_has_its_folder(film, model, tmp_path, capsys):
    assert main(["detect", str(film), "-o", str(tmp_path / "out"), "--model", str(model)]) == 0
    folder = tmp_path / "out" / film.stem
    assert "no person" in capsys.readouterr().out
    assert len(list(folder.glob("*.json"))) > 1


@pytest.mark.parametrize("videos", [["none.mp4"], ["a/walk.mp4", "b/walk.mp4"]])
def test_what_cannot_be_read_is_refused_before_anything_is_downloaded(videos, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(detect, "model_file", lambda *_: pytest.fail("downloads"))
    monkeypatch.chdir(tmp_path)
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "walk.mp4").write_bytes(b"")
    assert main(["detect", *videos]) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_a_file_that_is_no_video(model, tmp_path, capsys):
    (tmp_path / "walk.mp4").write_bytes(b"no video")
    assert main(["detect", str(tmp_path / "walk.mp4"), "-o", str(tmp_path / "out"), "--model", str(model)]) == 2
    assert "walk.mp4" in capsys.readouterr().err


def test_a_single_image_is_searched(film, model, tmp_path):
    assert main(["detect", str(film / "1.png"), "-o", str(tmp_path / "out"), "--model", str(model)]) == 0
    assert len(list((tmp_path / "out" / "1").glob("*.json"))) == 1
