"""Keypoints over the image of a recording."""

import numpy as np

from workbench.body.camera import plain_camera
from workbench.body.skeleton import JOINT_NAMES
from workbench.recording.write import images

SHOWN = images.picture(plain_camera(64, 48, 60.0, (0.0, -4.0, 1.0), (0.0, 0.0, 1.0), name="left"))


def test_keypoints_are_drawn_where_they_are_and_vanish_in_the_next_frame():
    given = np.full((len(JOINT_NAMES), 3), np.nan)
    given[2], given[5] = [10.0, 20.0, 1.0], [30.0, 40.0, 0.25]
    ((path, points),) = images.keypoints(SHOWN, given, JOINT_NAMES)
    assert path == "/world/left/image/keypoints"
    np.testing.assert_array_equal(np.array(points.positions.as_arrow_array().to_pylist()), given[[2, 5], :2])
    sizes = np.abs(points.radii.as_arrow_array().to_pylist())
    assert sizes[1] == sizes[0] / 2.0
    assert points.labels.as_arrow_array().to_pylist() == [JOINT_NAMES[2], JOINT_NAMES[5]]
    ((_, none),) = images.keypoints(SHOWN, None, JOINT_NAMES)
    assert len(none.positions.as_arrow_array()) == 0
    assert "keypoints" in images.OVERLAYS
