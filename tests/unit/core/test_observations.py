"""Scales of the observations of keypoints."""

import numpy as np
import pytest

from workbench.cameras.camera import plain_camera
from workbench.core.observations import Keypoints, person_px

CAMERA = plain_camera(640, 480, 500.0, (0.0, -4.0, 1.0), (0.0, 0.0, 1.0))


def test_a_lying_person_has_the_height_of_a_standing_one():
    standing = np.array([[300.0, 100.0, 1.0], [320.0, 350.0, 1.0], [280.0, 350.0, 0.5]])
    lying = standing[:, [1, 0, 2]]
    views = [Keypoints(np.arange(3), detections, CAMERA) for detections in (standing, lying)]
    assert person_px(views[:1]) == person_px(views[1:]) == 250.0
    taller = Keypoints(np.arange(3), standing * [2.0, 2.0, 1.0], CAMERA)
    assert person_px([*views, taller]) == pytest.approx(250.0)  # the median over views
