"""The command prints what fits and draws it."""

import cv2
import numpy as np
import pytest
from seen_walkers import around, seen_by

from workbench.body.skeleton import JOINT_NAMES
from workbench.camera_calibration.camera_file import write_cameras
from workbench.cli.main import main


@pytest.fixture
def folder(tmp_path):
    (camera,) = around(1)
    write_cameras(tmp_path / "camera.toml", [camera], 0.0, {})
    marks = seen_by([camera]).marks[0]
    (tmp_path / "film").mkdir()
    rows = ["frame,joint,u,v,visible"]
    for t in range(3):
        cv2.imwrite(str(tmp_path / "film" / f"{t}.png"), np.full((960, 1280, 3), 60, np.uint8))
        rows += [f"{t},{name},{u:.2f},{v:.2f},1" for name, (u, v, _) in zip(JOINT_NAMES, marks[t], strict=True)]
    (tmp_path / "marks.csv").write_text("\n".join(rows))
    return tmp_path


def words(folder, marks="keypoints"):
    files = {"source": "film", "camera": "camera.toml", marks: "marks.csv"}
    keys = [f"dataset.{key}={folder / name}" for key, name in files.items()]
    return ["check-calibration", "dataset=video", *keys, "dataset.rate_hz=10", "-o", str(folder / "out")]


@pytest.mark.parametrize("marks", ["keypoints", "start_marks", "eval_marks"])
def test_a_video_is_checked_whatever_its_annotations_are_for(folder, capsys, marks):
    assert main([*words(folder, marks), "body=height", "body.height_m=1.7"]) == 0
    said = capsys.readouterr().out
    assert "the person leans by" in said
    assert "the calibration fits; drawn in" in said
    (picture,) = (folder / "out").iterdir()
    assert cv2.imread(str(picture)).shape == (960, 1280, 3)


def test_images_of_another_size_are_refused_in_one_sentence(folder, capsys):
    (folder / "camera.toml").write_text((folder / "camera.toml").read_text().replace("1280", "640"))
    assert main(words(folder)) == 2
    assert "images are 1280×960" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "said"), [
        (["seed=3"], "expected a dataset"), (["dataset=blank"], "cameras and images"), (["dataset=video"], "source"),
    ],
)  # fmt: skip
def test_bad_words_are_one_sentence(given, said, capsys):
    assert main(["check-calibration", *given]) == 2
    printed = capsys.readouterr().err
    assert said in printed
    assert printed.count("\n") == 1
