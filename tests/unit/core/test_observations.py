"""Scales of the observations of keypoints."""

import numpy as np
import pytest

from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES, feet_skeleton, person_skeleton
from workbench.cameras.camera import plain_camera
from workbench.core.observations import Keypoints, person_px, usable_keypoints

CAMERA = plain_camera(640, 480, 500.0, (0.0, -4.0, 1.0), (0.0, 0.0, 1.0))


def test_a_lying_person_has_the_height_of_a_standing_one():
    standing = np.array([[300.0, 100.0, 1.0], [320.0, 350.0, 1.0], [280.0, 350.0, 0.5]])
    lying = standing[:, [1, 0, 2]]
    views = [Keypoints(np.arange(3), detections, CAMERA) for detections in (standing, lying)]
    assert person_px(views[:1]) == person_px(views[1:]) == 250.0
    taller = Keypoints(np.arange(3), standing * [2.0, 2.0, 1.0], CAMERA)
    assert person_px([*views, taller]) == pytest.approx(250.0)  # the median over views


def test_feet_are_keypoints_of_a_skeleton_with_feet_alone():
    keypoints, feet = np.full((len(JOINT_NAMES), 3), np.nan), np.full((4, 3), 0.5)
    keypoints[[1, 5]], feet[2] = 0.9, np.nan
    world = np.arange(45.0).reshape(15, 3)
    shape = from_height(1.7)
    plain = usable_keypoints(person_skeleton(shape), keypoints, CAMERA, world, feet)
    assert plain.joints.tolist() == [1, 5]
    skeleton = feet_skeleton(shape)
    found = usable_keypoints(skeleton, keypoints, CAMERA, world, feet)
    assert [skeleton.names[j] for j in found.joints] == ["neck", "left_wrist", "left_heel", "left_toes", "right_toes"]
    np.testing.assert_array_equal(found.detections, [[0.9] * 3] * 2 + [[0.5] * 3] * 3)
    np.testing.assert_array_equal(found.world_landmarks[:2], world[[1, 5]])
    assert np.isnan(found.world_landmarks[2:]).all()
    assert usable_keypoints(skeleton, keypoints, CAMERA).joints.tolist() == [1, 5]
