"""A camera that follows the recorded woman, made from the static video of her walk, is measured and compensated."""

import csv

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.cameras.background_tracks import track_background
from workbench.cameras.camera_file import load_cameras
from workbench.cameras.camera_motion import STATIC, TURNING, UNKNOWN, camera_motion
from workbench.cli.main import main
from workbench.detections.joint_annotations import read_annotations
from workbench.recording.read.reader import read
from workbench.utils.decode import decode

FIRST, LAST = 80, 115
WIDTH, HEIGHT = 900, 994
MAX_RATIO = 1.2
"""Of the error with a moving camera over that with the static one."""


def _left():
    """Return the left edges (T,), px, of a window that follows her to the left."""
    frames = np.arange(FIRST, LAST + 1)
    left = np.interp(frames, [60, 165], [868.0, 0.0])
    return np.convolve(np.pad(left, 10, mode="edge"), np.ones(21) / 21, "valid")


def _pan(camera, left):
    """Return the angle, rad, between the axis and the middle of a window."""
    return np.arctan((left + 0.5 * WIDTH - camera.matrix[0, 2]) / camera.matrix[0, 0])


@pytest.fixture(scope="module")
def homographies(data):
    """Return the homographies (T, 3, 3) of the static images and of a camera that turns."""
    (camera,) = load_cameras(data / "sports2d_walk" / "Calib_demo.toml")
    lens = camera.matrix.copy()
    lens[:2, 2] = (WIDTH - 1) / 2, (HEIGHT - 1) / 2
    turns = Rotation.from_euler("y", -_pan(camera, _left())[:, None]).as_matrix()
    pan = [lens @ turn @ np.linalg.inv(camera.matrix) for turn in turns]
    return {"static": [np.eye(3)] * len(pan), "pan": pan}


def _images(data, homographies):
    size = (WIDTH, HEIGHT) if np.any(homographies[0] - np.eye(3)) else None
    for image, homography in zip(decode(data / "sports2d_walk" / "demo.mp4", FIRST, LAST), homographies, strict=True):
        yield cv2.warpPerspective(image, homography, size or image.shape[1::-1], flags=cv2.INTER_LINEAR)


@pytest.mark.slow
def test_the_pan_is_measured(data, homographies):
    joints = read_annotations(data / "sports2d_walk" / "keypoints.csv")
    (camera,) = load_cameras(data / "sports2d_walk" / "Calib_demo.toml")
    no_people, expected = np.empty((0, joints.pixels.shape[1], 2)), np.ptp(np.degrees(_pan(camera, _left())))
    for name, kind in (("static", STATIC), ("pan", TURNING)):
        motion = camera_motion(track_background(_images(data, homographies[name]), [no_people] * (LAST - FIRST + 1)))
        assert motion.kind == kind
    motion = motion.at_focal(float(camera.matrix[0, 0]) / HEIGHT)
    axes = motion.rotations[:, 2]
    assert np.ptp(np.degrees(np.arctan2(axes[:, 0], axes[:, 2]))) == pytest.approx(expected, rel=0.02)
    assert np.ptp(np.degrees(np.arcsin(axes[:, 1]))) < 0.3


def tracked_runs(data, homographies, folder):
    """Return the runs that track the woman in each of the videos."""
    runs = {}
    with (data / "sports2d_walk" / "keypoints.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if FIRST <= int(row["frame"]) <= LAST]
    for name, each in homographies.items():
        images = list(_images(data, each))
        video = cv2.VideoWriter(
            str(folder / f"{name}.mp4"), cv2.VideoWriter_fourcc(*"mp4v"), 30.0, images[0].shape[1::-1]
        )
        for image in images:
            video.write(cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
        video.release()
        lines = ["frame,joint,u,v,visible"]
        for row in rows:
            frame = int(row["frame"]) - FIRST
            x, y, z = each[frame] @ [float(row["u"]), float(row["v"]), 1.0]
            lines.append(f"{frame},{row['joint']},{x / z:.2f},{y / z:.2f},{row['visible']}")
        (folder / f"{name}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
        model, run = data / "blazepose" / "pose_landmark_full.tflite", folder / name
        words = ["track", str(folder / f"{name}.mp4"), "--height", "1.65", "--model", str(model), "-o", str(run)]
        assert main([*words, f"dataset.eval_annotations={folder / name}.csv", f"dataset.cache={folder}"]) == 0
        runs[name] = read(run)
    return runs


@pytest.mark.slow
def test_a_camera_that_follows_her_shows_the_same_walk_as_the_static_one(data, homographies, tmp_path):
    """If its turns were not compensated, she would walk a quarter of the way."""
    static, pan = tracked_runs(data, homographies, tmp_path).values()
    assert pan.result["mpjpe_px"] < MAX_RATIO * static.result["mpjpe_px"]
    ways_m = [np.linalg.norm(np.ptp(run.poses[1][[0, -1], :2], axis=0)) for run in (pan, static)]
    assert ways_m[0] == pytest.approx(ways_m[1], rel=0.1)


@pytest.mark.parametrize("n_frames", [25, 100])
def test_a_crowd_that_walks_to_and_fro_does_not_make_a_camera_travel(data, n_frames):
    """The camera above the plaza moves by 8 of 1280 px; most corners are on people whom no detector sees."""
    if not (video := data.parent / "videos" / "vtest.avi").is_file():
        pytest.skip(f"no {video}")
    nobody = [np.empty((0, 22, 3))] * n_frames
    motion = camera_motion(track_background(decode(video, 0, n_frames - 1), nobody))
    assert motion.kind == UNKNOWN
    assert motion.sentence == "much of the background moves by itself; taken as static"
