"""Recorded cameras and images: calibrations, lenses, and the background of the demonstration video."""

import cv2
import numpy as np
import pytest

from workbench.body.camera import load_cameras
from workbench.core.frame_cache import FrameCache
from workbench.datasets.video import Video
from workbench.likelihoods.cues.image_levels import log_ratio, static_backgrounds
from workbench.recording.write import images


@pytest.mark.slow  # it decodes a hundred frames
def test_the_woman_is_foreground_and_the_rest_is_not(data):
    folder = data / "sports2d_walk"
    files = {"eval_annotations": str(folder / "keypoints.csv"), "first_frame": 64, "n_frames": 97, "scale": 0.5}
    video = Video(str(folder / "demo.mp4"), str(folder / "Calib_demo.toml"), **files)
    scenes = static_backgrounds(FrameCache(video), 60, 0.7)
    shares = []
    for frame in video.frames():
        if frame.truth is None:
            continue
        ratio = log_ratio(frame.views[0], scenes, 0.7, 0.05)
        marks = frame.truth.annotations[np.isfinite(frame.truth.annotations).all(axis=1)]
        column, row = np.rint(marks).astype(int).T
        away = np.ones(ratio.shape, dtype=bool)
        low, high = np.maximum(marks.min(axis=0) - 60, 0).astype(int), marks.max(axis=0).astype(int) + 60
        away[low[1] : high[1], low[0] : high[0]] = False
        shares.append([(ratio[row, column] > 0.0).mean(), (ratio[away] > 0.0).mean()])
    woman, rest = np.mean(shares, axis=0)
    assert woman > 0.7  # joints lie on her, though some on what looks like the wall behind
    assert rest < 0.05  # the share of outliers that the background is given


def test_four_calibrated_cameras(data):
    cameras = load_cameras(data / "pose2sim_balance" / "Calib_qualisys.toml")
    assert [camera.name for camera in cameras] == ["cam_01", "cam_02", "cam_03", "cam_04"]
    for camera in cameras:
        assert (camera.width, camera.height) == (1088, 1920)
        np.testing.assert_allclose(camera.rotation @ camera.rotation.T, np.eye(3), atol=1e-12)
        assert camera.position[2] > 0.5  # cameras on tripods: the file's z axis points up
        assert camera.rotation[1, 2] < -0.5  # and it points up in the picture
        # the four look at one place, where the man balances: where their optical axes pass each other most closely
    directions = np.stack([camera.rotation[2] for camera in cameras])
    centres = np.stack([camera.position for camera in cameras])
    across = np.eye(3) - directions[:, :, None] * directions[:, None]
    meeting = np.linalg.solve(across.sum(axis=0), np.einsum("nab,nb->a", across, centres))
    for camera in cameras:
        u, v = camera.project(meeting)
        assert 0 < u < camera.width
        assert 0 < v < camera.height
        expected, _ = cv2.projectPoints(
            meeting, cv2.Rodrigues(camera.rotation)[0], camera.translation, camera.matrix, camera.distortion
        )
        np.testing.assert_allclose((u, v), expected.ravel(), atol=1e-8)


def test_a_real_image_is_straightened_as_its_marks_are(data):
    camera = load_cameras(data / "pose2sim_balance" / "Calib_qualisys.toml")[0]
    video = cv2.VideoCapture(str(data / "pose2sim_balance" / "cam01.mp4"))
    read, frame = video.read()
    assert read
    shown = images.recorded_camera(camera)
    straight = cv2.imdecode(images.jpeg(shown, np.ascontiguousarray(frame[..., ::-1]), 95), cv2.IMREAD_COLOR)
    assert straight.shape == (camera.height, camera.width, 3)
    # The video is 8 px narrower than its calibration says; the recording has the calibrated size.
    reference = cv2.undistort(frame, camera.matrix, camera.distortion)
    width = frame.shape[1]
    assert np.abs(straight[:, :width].astype(int) - reference).mean() < 2.0  # grey levels, JPEG
