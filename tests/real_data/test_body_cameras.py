"""The calibration files that come with the recordings."""

import cv2
import numpy as np

from workbench.body.camera import load_cameras


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
