"""`workbench calibrate` writes cameras, `check-calibration` checks them; invalid input is rejected with one message."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from observed_walkers import camera_arc, observed_joints
from rendered_boards import COLUMNS, ROWS, board_poses, lens, rendered

from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.camera_file import load_cameras, write_cameras
from workbench.cli.main import main
from workbench.utils.decode import decode


@pytest.fixture(scope="module")
def videos(tmp_path_factory):
    """Folders of images in which two cameras at a distance of 0.1 m show the same boards."""
    folder = tmp_path_factory.mktemp("boards")
    right = replace(lens("right"), translation=np.array([-0.1, 0.0, 0.0]))
    for camera in (lens("left"), right):
        (folder / camera.name).mkdir()
        for k, pose in enumerate(board_poses(7)):
            cv2.imwrite(str(folder / camera.name / f"{k}.png"), rendered(camera, *pose))
    return folder


def board(videos, *arguments):
    sources = [f"{name}={videos / name}" for name in ("left", "right")]
    return ["calibrate", "board", *sources, "--corners", f"{COLUMNS}x{ROWS}", "--square-mm", "50", *arguments]


def test_two_cameras_are_calibrated_with_residuals_per_image(videos, tmp_path, capsys):
    assert main([*board(videos, "--floor", "3"), "-o", str(tmp_path / "c.toml")]) == 0
    output = capsys.readouterr().out
    left, right = load_cameras(tmp_path / "c.toml")
    assert np.linalg.norm(left.position - right.position) == pytest.approx(0.1, abs=0.005)
    assert left.position[2] > 0.3
    assert left.matrix[0, 0] == pytest.approx(700.0, rel=0.02)
    for text in ("left: px by image: 0: ", "right with left: px by image", "the floor is the board of image 3"):
        assert text in output


def test_an_existing_file_is_not_overwritten(videos, tmp_path, capsys):
    (tmp_path / "c.toml").write_text("existing")
    assert main([*board(videos), "-o", str(tmp_path / "c.toml")]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert (tmp_path / "c.toml").read_text() == "existing"


def test_a_level_camera_is_calibrated_by_height_and_distance(videos, tmp_path, capsys):
    rows = ["frame,joint,u,v,visible"]
    for k, distance_m in enumerate((4.0, 5.0, 6.0, 8.0)):  # a level camera 1.2 m high, f = 600 px, a person of 1.70 m
        foot, head = (239.5 + 600.0 * (1.2 - fraction * 1.7) / distance_m for fraction in (0.039, 0.93))
        rows += [f"{k},{side}_ankle,{u},{foot},1" for side, u in (("left", 300), ("right", 320))]
        rows.append(f"{k},head_centre,310,{head},1")
    (tmp_path / "annotations.csv").write_text("\n".join(rows))
    arguments = ["calibrate", "height", str(videos / "left"), str(tmp_path / "annotations.csv"), "--height-m", "1.7"]
    assert main([*arguments, "-o", str(tmp_path / "c.toml")]) == 0
    assert "do not determine the focal length" in capsys.readouterr().out  # it scales with all distances
    arguments += ["--distance-m", "4", "--overwrite"]
    assert main([*arguments, "-o", str(tmp_path / "c.toml")]) == 0
    output = capsys.readouterr().out
    assert "focal length 60" in output
    assert "do not determine" not in output
    (camera,) = load_cameras(tmp_path / "c.toml")
    assert camera.matrix[0, 0] == pytest.approx(600.0, rel=0.05)
    assert (camera.width, camera.height) == next(decode(videos / "left")).shape[1::-1]
    assert camera.position[2] == pytest.approx(1.2, rel=0.05)


@pytest.mark.parametrize(
    ("arguments", "text"), [
        (["--corners", "9"], "9x6"), (["--square-mm", "0"], "squares of"), (["-o", "c.csv"], "suffix .toml"),
        (["left"], "NAME=SOURCE"), (["left=a"], "occurs twice"), (["le ft=a"], "letters"),
        (["x=none.mp4"], "no such video"), (["--floor", "99"], "image 99"),
    ],
)  # fmt: skip
def test_invalid_arguments_are_rejected_with_one_message(videos, tmp_path, monkeypatch, capsys, arguments, text):
    monkeypatch.chdir(tmp_path)
    sources, options = ([], arguments) if arguments[0].startswith("-") else (arguments, [])
    calibrate, kind, *others = board(videos)
    assert main([calibrate, kind, *sources, *others, "-o", "c.toml", *options]) == 2
    message = capsys.readouterr().err
    assert text in message
    assert message.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.fixture
def folder(tmp_path):
    """A folder with a video of three frames, its camera and annotations of a person."""
    (camera,) = camera_arc(1)
    write_cameras(tmp_path / "camera.toml", [camera], 0.0, {})
    keypoints = observed_joints([camera]).keypoints[0]
    (tmp_path / "video").mkdir()
    rows = ["frame,joint,u,v,visible"]
    for t in range(3):
        cv2.imwrite(str(tmp_path / "video" / f"{t}.png"), np.full((960, 1280, 3), 60, np.uint8))
        rows += [f"{t},{name},{u:.2f},{v:.2f},1" for name, (u, v, _) in zip(JOINT_NAMES, keypoints[t], strict=True)]
    (tmp_path / "annotations.csv").write_text("\n".join(rows))
    return tmp_path


def arguments(folder, key="keypoints"):
    files = {"source": "video", "calibration_file": "camera.toml", key: "annotations.csv"}
    keys = [f"dataset.{key}={folder / name}" for key, name in files.items()]
    return ["check-calibration", "dataset=video", *keys, "dataset.rate_hz=10", "-o", str(folder / "out")]


@pytest.mark.parametrize("key", ["keypoints", "initial_annotations", "eval_annotations"])
def test_a_calibration_is_checked_by_annotations_under_any_key(folder, capsys, key):
    assert main([*arguments(folder, key), "body=height", "body.height_m=1.7"]) == 0
    output = capsys.readouterr().out
    assert "the person leans by" in output
    assert "verdict: trustworthy" in output
    (overlay,) = (folder / "out").iterdir()
    assert cv2.imread(str(overlay)).shape == (960, 1280, 3)


def test_images_of_another_size_than_the_calibration_are_rejected(folder, capsys):
    (folder / "camera.toml").write_text((folder / "camera.toml").read_text().replace("1280", "640"))
    assert main(arguments(folder)) == 2
    assert "images are 1280×960" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("overrides", "text"), [
        (["seed=3"], "expected a dataset"), (["dataset=blank"], "cameras and images"), (["dataset=video"], "source"),
    ],
)  # fmt: skip
def test_invalid_overrides_of_a_check_are_rejected_with_one_message(overrides, text, capsys):
    assert main(["check-calibration", *overrides]) == 2
    message = capsys.readouterr().err
    assert text in message
    assert message.count("\n") == 1
