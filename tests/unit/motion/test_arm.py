"""The generated arm, motions of chosen body parts, and motions by name."""

import numpy as np
import pytest

from workbench.body.kinematics import joints
from workbench.body.skeleton import PARTS, POSE_NAMES, parameters, person_skeleton
from workbench.datasets.synthetic import Synthetic
from workbench.motion.library import write_library
from workbench.motion.sources import find_motion
from workbench.motion.synthetic.arm import BEND_RAD, STRAIGHT_S, bending_arm
from workbench.motion.synthetic.gait import builtin_motions
from workbench.utils.errors import InputError

ARM = [POSE_NAMES.index(name) for name in PARTS["right_arm"]]
ELBOW = POSE_NAMES.index("right_elbow_flexion")


def test_the_elbow_flexes_after_a_pause_and_only_the_arm_moves():
    motion = bending_arm(3.0, 30.0)
    still = np.delete(motion.poses, ARM, axis=1)
    assert (np.ptp(motion.poses[:, ARM], axis=0) > 0.1).all()
    assert (np.ptp(still, axis=0) == 0.0).all()
    straight = np.arange(len(motion)) / 30.0 <= STRAIGHT_S
    assert (motion.poses[straight, ELBOW] == 0.0).all()
    assert motion.poses[-1, ELBOW] == pytest.approx(BEND_RAD)


def test_with_a_straight_elbow_the_twist_moves_no_joint():
    motion = bending_arm(0.5, 30.0)
    skeleton = person_skeleton(motion.shape)
    twisted = motion.poses.copy()
    twisted[:, POSE_NAMES.index("right_shoulder_twist")] += 1.0
    np.testing.assert_allclose(joints(skeleton, twisted), joints(skeleton, motion.poses), atol=1e-12)


def test_only_the_chosen_parts_move():
    full, arm = (Synthetic(n_frames=5, moving=moving, width=64, height=64) for moving in (None, ["right_arm"]))
    poses, moved = (np.array([frame.truth.pose for frame in scene.frames()]) for scene in (full, arm))
    np.testing.assert_array_equal(moved[:, ARM], poses[:, ARM])
    others = np.delete(np.arange(len(POSE_NAMES)), ARM)
    np.testing.assert_array_equal(moved[:, others], np.repeat(poses[:1, others], 5, axis=0))


def test_parts_expand_to_their_parameters_in_the_order_of_the_pose():
    assert parameters("x", ["right_elbow_flexion", "root_x", "left_arm"]) == (
        "root_x",
        *PARTS["left_arm"],
        POSE_NAMES[ELBOW],
    )
    assert set(PARTS["upper_body"]) | set(PARTS["lower_body"]) == set(PARTS["body"])
    with pytest.raises(InputError, match="synthetic: moving: 'wing'"):
        _ = Synthetic(n_frames=2, moving=["wing"]).info


def test_motions_are_loaded_by_name(tmp_path, trusted):
    library = tmp_path / "two.h5"
    motions = builtin_motions(2)
    write_library(library, motions)
    motion = find_motion(f"{library}:{motions[1].name}", data=None, rate_hz=30.0)
    np.testing.assert_array_equal(motion.poses, motions[1].resampled(30.0).poses)
    assert find_motion("builtin_arm", data=None, rate_hz=25.0).rate_hz == 25.0
    for name, data, message in (
        (f"{library}:unknown", None, "unknown"),
        ("35_02", None, r"paths\.data"),
        ("35_02", str(tmp_path), "35_02.amc: no such"),
        ("dataset-1_guide_normal_001", str(tmp_path), "guide_normal"),
        ("waltz", str(tmp_path), "waltz"),
    ):
        with pytest.raises(InputError, match=message):
            find_motion(name, data=data, rate_hz=30.0)
