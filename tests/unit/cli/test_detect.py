"""`workbench detect` rejects unreadable videos before it downloads a model, and writes one folder per video."""

import numpy as np
import pytest

from workbench.cli import detect
from workbench.cli.main import main
from workbench.detections.detector import detection_files
from workbench.detections.detector.landmark_network import PersonLandmarks


@pytest.fixture
def model(tmp_path, monkeypatch):
    """A model that detects no person."""
    zeros = np.zeros((33, 3))
    monkeypatch.setattr(
        detection_files,
        "LandmarkNetwork",
        lambda _: lambda image, region: PersonLandmarks(zeros[:, :2], zeros[:, 0], zeros, 0.0, region),
    )
    (tmp_path / "model.tflite").write_bytes(b"model")
    return tmp_path / "model.tflite"


def test_detections_of_a_video_are_written_to_its_folder(images, model, tmp_path, capsys):
    assert main(["detect", str(images), "-o", str(tmp_path / "out"), "--model", str(model)]) == 0
    folder = tmp_path / "out" / images.stem
    assert "no person" in capsys.readouterr().out
    assert len(list(folder.glob("*.json"))) > 1


@pytest.mark.parametrize("videos", [["none.mp4"], ["a/walk.mp4", "b/walk.mp4"]])
def test_invalid_videos_are_rejected_before_a_download(videos, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(detect, "model_file", lambda *_: pytest.fail("downloads"))
    monkeypatch.chdir(tmp_path)
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "walk.mp4").write_bytes(b"")
    assert main(["detect", *videos]) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_a_file_that_is_no_video_is_rejected(model, tmp_path, capsys):
    (tmp_path / "walk.mp4").write_bytes(b"no video")
    assert main(["detect", str(tmp_path / "walk.mp4"), "-o", str(tmp_path / "out"), "--model", str(model)]) == 2
    assert "walk.mp4" in capsys.readouterr().err


def test_a_single_image_is_a_video_of_one_frame(images, model, tmp_path):
    assert main(["detect", str(images / "1.png"), "-o", str(tmp_path / "out"), "--model", str(model)]) == 0
    assert len(list((tmp_path / "out" / "1").glob("*.json"))) == 1
