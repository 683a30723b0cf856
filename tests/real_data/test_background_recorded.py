"""The background model of the recorded video, and the calibrations and lenses of recorded cameras."""

import cv2
import numpy as np
import pytest

from workbench.cameras.camera_file import load_cameras
from workbench.core.frame_cache import FrameCache
from workbench.datasets.video import Video
from workbench.likelihoods.cues.image_levels import log_ratio, static_backgrounds
from workbench.recording.write import images


@pytest.mark.slow  # decodes 97 frames
def test_the_woman_is_foreground_and_the_remaining_image_is_background(data):
    folder = data / "sports2d_walk"
    files = {"eval_annotations": str(folder / "keypoints.csv"), "first_frame": 64, "n_frames": 97, "scale": 0.5}
    video = Video(str(folder / "demo.mp4"), str(folder / "Calib_demo.toml"), **files)
    scenes = static_backgrounds(FrameCache(video), 60, 0.7)
    fractions = []
    for frame in video.frames():
        if frame.truth is None:
            continue
        ratio = log_ratio(frame.views[0], scenes, 0.7, 0.05)
        annotated = frame.truth.annotations[np.isfinite(frame.truth.annotations).all(axis=1)]
        column, row = np.rint(annotated).astype(int).T
        background = np.ones(ratio.shape, dtype=bool)
        low, high = np.maximum(annotated.min(axis=0) - 60, 0).astype(int), annotated.max(axis=0).astype(int) + 60
        background[low[1] : high[1], low[0] : high[0]] = False
        fractions.append([(ratio[row, column] > 0.0).mean(), (ratio[background] > 0.0).mean()])
    woman, remaining = np.mean(fractions, axis=0)
    assert woman > 0.7  # some joints have the intensity of the wall behind them
    assert remaining < 0.05  # the outlier fraction of the background model


def test_the_four_calibrated_cameras_point_at_the_man(data):
    cameras = load_cameras(data / "pose2sim_balance" / "Calib_qualisys.toml")
    assert [camera.name for camera in cameras] == ["cam_01", "cam_02", "cam_03", "cam_04"]
    for camera in cameras:
        assert (camera.width, camera.height) == (1088, 1920)
        np.testing.assert_allclose(camera.rotation @ camera.rotation.T, np.eye(3), atol=1e-12)
        assert camera.position[2] > 0.5  # cameras on tripods: the file's z axis points up
        assert camera.rotation[1, 2] < -0.5  # and it points upwards in the image
    # the optical axes nearly meet in one point, at the man
    directions = np.stack([camera.rotation[2] for camera in cameras])
    centres = np.stack([camera.position for camera in cameras])
    orthogonal = np.eye(3) - directions[:, :, None] * directions[:, None]
    meeting = np.linalg.solve(orthogonal.sum(axis=0), np.einsum("nab,nb->a", orthogonal, centres))
    for camera in cameras:
        u, v = camera.project(meeting)
        assert 0 < u < camera.width
        assert 0 < v < camera.height
        expected, _ = cv2.projectPoints(
            meeting, cv2.Rodrigues(camera.rotation)[0], camera.translation, camera.matrix, camera.distortion
        )
        np.testing.assert_allclose((u, v), expected.ravel(), atol=1e-8)


def test_a_recorded_image_is_undistorted(data):
    camera = load_cameras(data / "pose2sim_balance" / "Calib_qualisys.toml")[0]
    video = cv2.VideoCapture(str(data / "pose2sim_balance" / "cam01.mp4"))
    success, frame = video.read()
    assert success
    shown = images.recorded_camera(camera)
    undistorted = cv2.imdecode(images.jpeg(shown, np.ascontiguousarray(frame[..., ::-1]), 95), cv2.IMREAD_COLOR)
    assert undistorted.shape == (camera.height, camera.width, 3)
    # The video is 8 px narrower than its calibration; the recording has the calibrated size.
    reference = cv2.undistort(frame, camera.matrix, camera.distortion)
    width = frame.shape[1]
    assert np.abs(undistorted[:, :width].astype(int) - reference).mean() < 2.0  # grey levels, JPEG
