"""Left and right are exchanged and come back; that a mirror image is one, `test_kinematics_symmetry` says."""

import numpy as np

from workbench.body.angles import exchanged
from workbench.body.skeleton import POSE_NAMES


def test_sides_are_exchanged_and_the_root_stays():
    poses = np.arange(50.0).reshape(2, 25)
    other = exchanged(poses)
    left, right = POSE_NAMES.index("left_knee_flexion"), POSE_NAMES.index("right_knee_flexion")
    assert (other[:, [left, right]] == poses[:, [right, left]]).all()
    assert (other[:, :9] == poses[:, :9]).all()
    assert (exchanged(other) == poses).all()
    assert (exchanged(poses[0]) == other[0]).all()


def test_other_parameters_than_a_persons_stay_as_they_are():
    pose = np.arange(66.0)
    assert exchanged(pose) is pose
