"""A real camera with a lens: marks, image and projected joints fall together in the recording."""

import cv2
import numpy as np
import pytest

from workbench.body.camera import load_cameras
from workbench.recording.write import images


def test_real_calibrations_are_straightened(data):
    for camera in load_cameras(data / "pose2sim_balance" / "Calib_qualisys.toml"):
        assert camera.distortion.any()
        shown = images.picture(camera)
        rng = np.random.default_rng(0)
        rays = np.column_stack([rng.uniform(-0.2, 0.2, 50), rng.uniform(-0.4, 0.4, 50), np.ones(50)])
        points = (3.0 * rays - camera.translation) @ camera.rotation
        straight = shown.camera.project(points)
        assert images.straightened(camera, camera.project(points)) == pytest.approx(straight, abs=1e-3)  # px, mild lens


def test_a_real_image_is_straightened_as_its_marks_are(data):
    camera = load_cameras(data / "pose2sim_balance" / "Calib_qualisys.toml")[0]
    video = cv2.VideoCapture(str(data / "pose2sim_balance" / "cam01.mp4"))
    read, frame = video.read()
    assert read
    shown = images.picture(camera)
    ((_, logged),) = images.image(shown, np.ascontiguousarray(frame[..., ::-1]), 95)
    straight = cv2.imdecode(logged.fields["blob"][0], cv2.IMREAD_COLOR)
    assert straight.shape == (camera.height, camera.width, 3)
    # The video is 8 px narrower than its calibration says; the recording has the calibrated size.
    reference = cv2.undistort(frame, camera.matrix, camera.distortion)
    width = frame.shape[1]
    assert np.abs(straight[:, :width].astype(int) - reference).mean() < 2.0  # grey levels, JPEG
