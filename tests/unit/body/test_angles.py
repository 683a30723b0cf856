"""Angles of a pose: flexions on any skeleton, exchanged sides and full turns."""

import numpy as np
import pytest
from full_skeleton_clips import BANDAI_LIKE, clip, wandering
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from single_steps import SKELETON

from workbench.body.angles import FLEXIONS, flexions, swap_left_right, unwrap_near
from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.skeleton import POSE_NAMES
from workbench.evaluation.errors.pose_errors import flexion_errors
from workbench.motion.full_skeleton import full_skeleton

BANDAI = full_skeleton(clip(BANDAI_LIKE, wandering(BANDAI_LIKE, 0)))
PERSON = person(from_height(1.8)).skeleton
LEGS = {
    "left_hip": ("left_knee", "LowerLeg_L"), "right_hip": ("right_knee", "LowerLeg_R"),
    "left_knee": ("left_ankle", "Foot_L"), "right_knee": ("right_ankle", "Foot_R"),
}  # fmt: skip


def flexed(skeleton, name, angle):
    """Return a pose in which one flexion is `angle`, rad."""
    pose = np.zeros(len(skeleton.dof_names))
    [(dof, sign)] = [(dof, sign) for dof, sign in FLEXIONS[name].items() if dof in skeleton.dof_names]
    pose[skeleton.dof(dof)] = sign * angle
    return pose


@pytest.mark.parametrize(("skeleton", "k"), [(PERSON, 0), (BANDAI, 1)], ids=["person", "full"])
@pytest.mark.parametrize("name", FLEXIONS)
def test_hips_flex_forward_and_knees_backward_on_every_skeleton(skeleton, k, name):
    pose = flexed(skeleton, name, 0.5)
    moved = skeleton.joint(LEGS[name][k])
    displacement = (joints(skeleton, pose[None]) - joints(skeleton, np.zeros_like(pose)[None]))[0, moved, 0]
    bone = np.linalg.norm(skeleton.offsets[moved])
    assert displacement == pytest.approx(np.sin(0.5) * bone * (1.0 if name.endswith("hip") else -1.0))
    assert flexions(skeleton, pose) == {
        other: pytest.approx(np.degrees(0.5) if other == name else 0.0) for other in FLEXIONS
    }


def test_full_turns_do_not_change_flexions_and_errors():
    pose = flexed(PERSON, "left_knee", 0.3)
    turned = flexed(PERSON, "left_knee", 0.3 + 2.0 * np.pi)
    assert flexions(PERSON, turned)["left_knee"] == pytest.approx(np.degrees(0.3))
    assert flexion_errors(PERSON, turned, pose)["knee_flexion_rmse_deg"] == pytest.approx(0.0, abs=1e-9)


def test_errors_on_a_full_skeleton_are_root_mean_squares_of_both_legs():
    errors = flexion_errors(BANDAI, flexed(BANDAI, "right_hip", 0.1), np.zeros(len(BANDAI.dof_names)))
    assert errors == {
        "knee_flexion_rmse_deg": 0.0,
        "hip_flexion_rmse_deg": pytest.approx(np.degrees(0.1) / np.sqrt(2.0)),
    }


def test_sides_are_exchanged_and_the_root_is_unchanged():
    poses = np.arange(50.0).reshape(2, 25)
    swapped = swap_left_right(poses)
    left, right = POSE_NAMES.index("left_knee_flexion"), POSE_NAMES.index("right_knee_flexion")
    assert (swapped[:, [left, right]] == poses[:, [right, left]]).all()
    assert (swapped[:, :9] == poses[:, :9]).all()
    assert (swap_left_right(swapped) == poses).all()
    assert (swap_left_right(poses[0]) == swapped[0]).all()


def test_poses_of_other_skeletons_are_unchanged():
    pose = np.arange(66.0)
    assert swap_left_right(pose) is pose


POSES = arrays(float, (3, 25), elements=st.floats(-400.0, 400.0))


@settings(max_examples=50)
@given(POSES, arrays(float, 25, elements=st.floats(-20.0, 20.0)))
def test_unwrapping_moves_angles_near_a_reference_and_keeps_the_pose(poses, reference):
    moved = unwrap_near(poses, reference)
    assert np.abs(moved[:, 3:] - reference[3:]).max() <= np.pi + 1e-9
    assert (moved[:, :3] == poses[:, :3]).all()
    assert np.abs(joints(SKELETON, moved) - joints(SKELETON, poses)).max() < 1e-9


def test_angles_near_the_reference_are_returned_unchanged():
    poses = np.random.default_rng(0).uniform(-3.0, 3.0, (5, 25))
    assert unwrap_near(poses, np.zeros(25)) is poses
