"""Retargeting of clips of our own skeleton: the angles come back, whoever moves, wherever and facing anywhere."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from own_clips import OWN, own_clip
from scipy.spatial.transform import Rotation

from workbench.body.kinematics import axis_rotations
from workbench.body.shape import from_height
from workbench.body.skeleton import POSE_NAMES, person_skeleton
from workbench.motion.retarget import continuous_turns, retarget

QUICK = settings(max_examples=25, deadline=None)
SEEDS = st.integers(0, 2**32 - 1)


def poses_inside_the_limits(rng, skeleton, n=12):
    """A smooth movement between two poses that keep to the limits and off the singular middle angles, ±90 degrees.

    The arms are lifted by less than 2 rad: beyond, (a − π, π − b, c − π) can be within the limits as well as (a, b, c).
    """
    low, high = skeleton.limits[:, 0].copy(), skeleton.limits[:, 1].copy()
    low[:3], high[:3] = -3.0, 3.0
    low[3:6], high[3:6] = (-3.0, -0.5, -0.5), (3.0, 0.5, 0.5)
    for side in ("left", "right"):
        high[POSE_NAMES.index(f"{side}_shoulder_abduction")] = 2.0
    for name in ("neck_nod", "left_shoulder_flexion", "right_shoulder_flexion", "left_hip_abduction",
                 "right_hip_abduction"):  # fmt: skip
        dof = POSE_NAMES.index(name)
        low[dof], high[dof] = max(low[dof], -1.3), min(high[dof], 1.3)
    start, end = rng.uniform(low, high), rng.uniform(low, high)
    return start + np.linspace(0, 1, n)[:, None] * (end - start)


@QUICK
@given(seed=SEEDS, height=st.floats(1.2, 2.1))
def test_angles_come_back(seed, height):
    skeleton = person_skeleton(from_height(height))
    poses = poses_inside_the_limits(np.random.default_rng(seed), skeleton)
    motion = retarget(own_clip(skeleton, poses), OWN)
    whole = np.round((motion.poses - poses)[0] / (2 * np.pi)) * 2 * np.pi  # an angle may be whole turns away
    whole[:3] = 0.0
    np.testing.assert_allclose(motion.poses, poses + whole, atol=1e-6)


@QUICK
@given(seed=SEEDS, yaw=st.floats(-3.0, 3.0))
def test_turning_the_world_turns_only_the_root(seed, yaw):
    rng = np.random.default_rng(seed)
    skeleton = person_skeleton(from_height(1.7))
    clip = own_clip(skeleton, poses_inside_the_limits(rng, skeleton))
    clip = replace(clip, positions=clip.positions + rng.normal(0.0, 0.01, clip.positions.shape))
    turn, shift = axis_rotations(np.array([0.0, 0.0, 1.0]), np.array([yaw]))[0], rng.uniform(-5, 5, 3)
    rotations = clip.rotations.copy()
    rotations[:, 0] = turn @ rotations[:, 0]
    turned = replace(clip, rotations=rotations, positions=clip.positions @ turn.T + shift)
    before, after = retarget(clip, OWN), retarget(turned, OWN)
    np.testing.assert_allclose(after.joint_error_mm, before.joint_error_mm, atol=1e-3)
    np.testing.assert_allclose(after.poses[:, :3], before.poses[:, :3] @ turn.T + shift, atol=1e-6)
    np.testing.assert_allclose(after.poses[:, 4:], before.poses[:, 4:], atol=1e-5)
    whole = (after.poses[:, 3] - before.poses[:, 3] - yaw) / (2 * np.pi)
    np.testing.assert_allclose(whole, np.round(whole[0]), atol=1e-6)


@QUICK
@given(seed=SEEDS, order=st.sampled_from(["XYZ", "YXZ", "ZYX"]))
def test_continuous_turns_are_the_same_rotations(seed, order):
    rng = np.random.default_rng(seed)
    angles = np.cumsum(rng.normal(0.0, 0.3, (40, 3)), axis=0)
    limits = np.sort(rng.uniform(-3, 3, (3, 2)), axis=1)
    found = continuous_turns(Rotation.from_euler(order, angles).as_euler(order), limits)
    expected = Rotation.from_euler(order, angles).as_matrix()
    np.testing.assert_allclose(Rotation.from_euler(order, found).as_matrix(), expected, atol=1e-9)
    # of the two ways to write a rotation the nearer one was taken: no frame is further from the last than the truth is
    steps = np.linalg.norm(np.diff(found, axis=0), axis=1)
    assert np.all(steps <= np.linalg.norm(np.diff(angles, axis=0), axis=1) + 1e-9)
