"""The commands of calibration write and check cameras; bad input is one sentence."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from observed_walkers import camera_arc, observed_joints
from rendered_boards import COLUMNS, ROWS, board_poses, lens, rendered

from workbench.body.camera import load_cameras
from workbench.body.skeleton import JOINT_NAMES
from workbench.camera_calibration.camera_file import write_cameras
from workbench.cli.main import main
from workbench.datasets.files.decode import decode


@pytest.fixture(scope="module")
def films(tmp_path_factory):
    """Folders of images of two cameras 0.3 m apart that see the same boards."""
    folder = tmp_path_factory.mktemp("boards")
    right = replace(lens("right"), translation=np.array([-0.1, 0.0, 0.0]))
    for camera in (lens("left"), right):
        (folder / camera.name).mkdir()
        for k, pose in enumerate(board_poses(7)):
            cv2.imwrite(str(folder / camera.name / f"{k}.png"), rendered(camera, *pose))
    return folder


def board(films, *words):
    sources = [f"{name}={films / name}" for name in ("left", "right")]
    return ["calibrate", "board", *sources, "--corners", f"{COLUMNS}x{ROWS}", "--square-mm", "50", *words]


def test_two_cameras_are_written_with_residuals_by_image(films, tmp_path, capsys):
    assert main([*board(films, "--floor", "3"), "-o", str(tmp_path / "c.toml")]) == 0
    said = capsys.readouterr().out
    left, right = load_cameras(tmp_path / "c.toml")
    assert np.linalg.norm(left.position - right.position) == pytest.approx(0.1, abs=0.005)
    assert left.position[2] > 0.3
    assert left.matrix[0, 0] == pytest.approx(700.0, rel=0.02)
    for words in ("left: px by image: 0: ", "right with left: px by image", "the floor is the board of image 3"):
        assert words in said


def test_a_file_that_is_there_is_kept(films, tmp_path, capsys):
    (tmp_path / "c.toml").write_text("mine")
    assert main([*board(films), "-o", str(tmp_path / "c.toml")]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert (tmp_path / "c.toml").read_text() == "mine"


def test_a_camera_by_height_says_how_sure_it_is(films, tmp_path, capsys):
    rows = ["frame,joint,u,v,visible"]
    for k, far_m in enumerate((4.0, 5.0, 6.0, 8.0)):  # a level camera 1.2 m high, f = 600 px, a person of 1.70 m
        foot, head = (239.5 + 600.0 * (1.2 - part * 1.7) / far_m for part in (0.039, 0.93))
        rows += [f"{k},{side}_ankle,{u},{foot},1" for side, u in (("left", 300), ("right", 320))]
        rows.append(f"{k},head_centre,310,{head},1")
    (tmp_path / "marks.csv").write_text("\n".join(rows))
    words = ["calibrate", "height", str(films / "left"), str(tmp_path / "marks.csv"), "--height-m", "1.7"]
    assert main([*words, "-o", str(tmp_path / "c.toml")]) == 0
    assert "do not determine the focal length" in capsys.readouterr().out  # level, it scales with all distances
    words += ["--distance-m", "4", "--overwrite"]
    assert main([*words, "-o", str(tmp_path / "c.toml")]) == 0
    said = capsys.readouterr().out
    assert "focal length 60" in said
    assert "do not determine" not in said
    (camera,) = load_cameras(tmp_path / "c.toml")
    assert camera.matrix[0, 0] == pytest.approx(600.0, rel=0.05)
    assert (camera.width, camera.height) == next(decode(films / "left")).shape[1::-1]
    assert camera.position[2] == pytest.approx(1.2, rel=0.05)


@pytest.mark.parametrize(
    ("words", "said"), [
        (["--corners", "9"], "9x6"), (["--square-mm", "0"], "squares of"), (["-o", "c.csv"], "suffix .toml"),
        (["left"], "NAME=SOURCE"), (["left=a"], "occurs twice"), (["le ft=a"], "letters"),
        (["x=none.mp4"], "no such video"), (["--floor", "99"], "image 99"),
    ],
)  # fmt: skip
def test_bad_words_are_one_sentence(films, tmp_path, monkeypatch, capsys, words, said):
    monkeypatch.chdir(tmp_path)
    sources, rest = (words, []) if not words[0].startswith("-") else ([], words)
    calibrate, way, *others = board(films)
    assert main([calibrate, way, *sources, *others, "-o", "c.toml", *rest]) == 2
    printed = capsys.readouterr().err
    assert said in printed
    assert printed.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.fixture
def folder(tmp_path):
    (camera,) = camera_arc(1)
    write_cameras(tmp_path / "camera.toml", [camera], 0.0, {})
    marks = observed_joints([camera]).keypoints[0]
    (tmp_path / "film").mkdir()
    rows = ["frame,joint,u,v,visible"]
    for t in range(3):
        cv2.imwrite(str(tmp_path / "film" / f"{t}.png"), np.full((960, 1280, 3), 60, np.uint8))
        rows += [f"{t},{name},{u:.2f},{v:.2f},1" for name, (u, v, _) in zip(JOINT_NAMES, marks[t], strict=True)]
    (tmp_path / "marks.csv").write_text("\n".join(rows))
    return tmp_path


def words(folder, marks="keypoints"):
    files = {"source": "film", "calibration_file": "camera.toml", marks: "marks.csv"}
    keys = [f"dataset.{key}={folder / name}" for key, name in files.items()]
    return ["check-calibration", "dataset=video", *keys, "dataset.rate_hz=10", "-o", str(folder / "out")]


@pytest.mark.parametrize("marks", ["keypoints", "initial_annotations", "eval_annotations"])
def test_a_video_is_checked_whatever_its_annotations_are_for(folder, capsys, marks):
    assert main([*words(folder, marks), "body=height", "body.height_m=1.7"]) == 0
    said = capsys.readouterr().out
    assert "the person leans by" in said
    assert "verdict: trustworthy" in said
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
def test_bad_words_of_a_check_are_one_sentence(given, said, capsys):
    assert main(["check-calibration", *given]) == 2
    printed = capsys.readouterr().err
    assert said in printed
    assert printed.count("\n") == 1
