"""Retargeting against closed forms and against an independent optimiser."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from tests.oracles.kinematics import forward as forward_oracle
from workbench.body.kinematics import axis_rotations, forward, joints
from workbench.body.shape import from_height
from workbench.body.skeleton import ERROR_JOINTS, JOINT_NAMES, POSE_NAMES, person_skeleton
from workbench.motion.clip import MotionClip
from workbench.motion.retarget import Landmarks, continuous_angles, refine, retarget
from workbench.utils.errors import InputError

OWN = Landmarks(
    source="our own skeleton",
    joints={name: name for name in JOINT_NAMES if name not in ("pelvis", "head_centre")},
    head=("neck", "head_centre", 1.0),
    head_up=(0.0, 0.0, 1.0),
    lefts=dict.fromkeys(("neck", "left_shoulder", "right_shoulder", "left_hip", "right_hip"), (0.0, 1.0, 0.0)),
)


def own_clip(skeleton, poses):
    """A clip of our own skeleton in the given poses."""
    frames = forward(skeleton, poses)
    parents = np.maximum(skeleton.parents, 0)
    rotations = frames.rotations[:, parents].swapaxes(-1, -2) @ frames.rotations
    rotations[:, 0] = frames.rotations[:, 0]
    return MotionClip("own", 100.0, 1, skeleton.names, skeleton.parents, skeleton.offsets, rotations,
                      frames.positions)  # fmt: skip


def moving_poses(rng, n=60, turns=0.0):
    """Smooth angles away from the singular directions; the heading turns `turns` times around."""
    times = np.linspace(0, 1, n)[:, None]
    poses = 0.35 * np.sin(2 * np.pi * (times * rng.uniform(0.5, 2, 25) + rng.uniform(0, 1, 25)))
    for name in POSE_NAMES:
        if "elbow" in name or "knee" in name:
            poses[:, POSE_NAMES.index(name)] += 0.5
    poses[:, 3] += 2 * np.pi * turns * times[:, 0]
    return poses


def test_known_angles_and_lengths_are_recovered():
    shape = from_height(1.8, thigh=0.41, forearm=0.23, head=(0.02, 0.0, 0.15), shoulder=(-0.02, 0.19, 0.5))
    skeleton = person_skeleton(shape)
    poses = moving_poses(np.random.default_rng(3), turns=2.5)
    motion = retarget(own_clip(skeleton, poses), OWN)
    found = motion.poses.copy()
    whole = (found[:, 3] - poses[:, 3]) / (2 * np.pi)
    assert np.ptp(whole) < 1e-9  # the heading is continuous, and right but for whole turns
    assert whole[0] == pytest.approx(round(whole[0]), abs=1e-9)
    np.testing.assert_allclose(np.delete(found, 3, axis=1), np.delete(poses, 3, axis=1), atol=1e-7)
    np.testing.assert_allclose(motion.joint_error_mm, 0.0, atol=1e-4)
    for name in ("neck", "head", "shoulder", "hip", "upper_arm", "forearm", "thigh", "calf"):
        assert getattr(motion.shape, name) == pytest.approx(getattr(shape, name), abs=1e-7), name


def cmu_at_rest():
    """A person in the rest pose of the CMU skeletons: legs spread by 20 degrees, arms level, facing x. World axes."""
    leg, down = np.array([0.0, np.sin(np.pi / 9), -np.cos(np.pi / 9)]), np.array([1.0, -1.0, 1.0])
    bones = {"root": ("", [0, 0, 0]), "upperneck": ("root", [0, 0, 0.45]), "head": ("upperneck", [0, 0, 0.1]),
             "head_end": ("head", [0, 0, 0.1])}  # fmt: skip
    for side, mirror in (("l", np.ones(3)), ("r", down)):
        chain = {
            "humerus": ("root", [0, 0.2, 0.4]), "radius": ("{}humerus", [0, 0.3, 0]),
            "wrist": ("{}radius", [0, 0.2, 0]),
            "hand": ("{}wrist", [0, 0.05, 0]), "femur": ("root", [0, 0.1, -0.1]), "tibia": ("{}femur", 0.4 * leg),
            "foot": ("{}tibia", 0.42 * leg),
        }  # fmt: skip
        for name, (parent, offset) in chain.items():
            bones[side + name] = (parent.format(side), mirror * offset)
    names = tuple(bones)
    parents = np.array([names.index(parent) if parent else -1 for parent, _ in bones.values()])
    offsets = np.array([offset for _, offset in bones.values()])
    positions = np.zeros((len(names), 3))
    for k, parent in enumerate(parents):
        positions[k] = (positions[parent] if parent >= 0 else 0.0) + offsets[k]
    rotations = np.broadcast_to(np.eye(3), (2, len(names), 3, 3)).copy()
    both = np.stack([positions, positions])
    return MotionClip("rest", 120.0, 1, names, parents, offsets, rotations, both)


def test_cmu_rest_pose_in_closed_form():
    motion = retarget(cmu_at_rest())
    expected = dict.fromkeys(POSE_NAMES, 0.0) | {"root_z": -0.1}
    for side in ("left", "right"):
        # at rest the elbows' hinges are 30 degrees off the vertical: the arms are turned out by that much
        expected |= {f"{side}_shoulder_abduction": np.pi / 2, f"{side}_shoulder_twist": -np.pi / 6,
                     f"{side}_hip_abduction": np.pi / 9}  # fmt: skip
    assert dict(zip(POSE_NAMES, motion.poses[1], strict=True)) == pytest.approx(expected, abs=1e-6)
    assert motion.joint_error_mm.max() < 1e-3
    assert motion.shape.forearm == pytest.approx(0.25)
    assert motion.shape.neck == pytest.approx((0.0, 0.0, 0.55), abs=1e-9)
    assert motion.shape.head == pytest.approx((0.0, 0.0, 0.15), abs=1e-9)


def test_refinement_finds_the_minimum_of_its_cost():
    skeleton = person_skeleton(from_height(1.7))
    rng = np.random.default_rng(5)
    analytic = moving_poses(rng, n=6)
    targets = joints(skeleton, analytic) + rng.normal(0.0, 0.01, (6, len(JOINT_NAMES), 3))
    targets += rng.normal(0.0, 5.0, (6, 1, 3))  # the pelvis is not held: it may go any way
    refined = refine(skeleton, analytic, targets)
    rows = [JOINT_NAMES.index(name) for name in ERROR_JOINTS]
    for start, target, found in zip(analytic, targets, refined, strict=True):

        def residual(pose, start=start, target=target):
            places = forward_oracle(skeleton, pose[None]).positions[0]
            return np.concatenate([(places - target)[rows].ravel(), 0.1 * (pose - start)[3:]])

        best = least_squares(residual, start, method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14).x
        # three steps are said to end within 0.01 degrees of it
        np.testing.assert_allclose(found, best, atol=np.deg2rad(0.01))


def test_an_unknown_skeleton_is_refused_by_the_names_of_its_missing_joints():
    clip = cmu_at_rest()
    renamed = tuple("left middle" if name == "ltibia" else name for name in clip.joints)
    with pytest.raises(InputError, match=r"rest.*found no joint for left_knee; name them by the key landmarks"):
        retarget(replace(clip, joints=renamed))


@pytest.mark.parametrize("scale", [0.01, 100.0])
def test_a_wrong_unit_is_refused(scale):
    clip = cmu_at_rest()
    with pytest.raises(InputError, match="check the unit"):
        retarget(replace(clip, offsets=scale * clip.offsets, positions=scale * clip.positions))


def test_bones_without_length_are_refused():
    clip = cmu_at_rest()
    with pytest.raises(InputError, match="of positive length"):
        retarget(replace(clip, offsets=0.0 * clip.offsets))


def test_turns_are_continuous_through_the_half_turn_and_over_the_head():
    times = np.linspace(0.0, 1.0, 200)
    limits = np.array([[-0.8, 3.1], [-1.4, 3.1], [-1.9, 1.9]])
    # the middle angle goes past 90 degrees, where Euler angles from matrices fold back and jump by 180 degrees
    truth = np.stack([0.3 + 0.2 * times, -0.5 + 3.3 * times, 0.4 - 0.6 * times], axis=1)
    folded = Rotation.from_euler("XYZ", truth).as_euler("XYZ")
    assert np.abs(np.diff(folded, axis=0)).max() > 3.0
    found = continuous_angles(folded, limits)
    np.testing.assert_allclose(found, truth, atol=1e-9)


def test_of_two_courses_the_one_within_the_limits_is_kept():
    limits = np.array([[0.0, 3.1], [-1.4, 1.4], [-0.5, 3.1]])
    truth = np.array([2.5, 0.3, 2.4]) + np.linspace(0.0, 0.2, 20)[:, None]
    # (a - π, π - b, c - π) has smaller angles but the middle one is beyond its limit
    flipped = truth * [1.0, -1.0, 1.0] + [-np.pi, np.pi, -np.pi]
    for written in (truth, flipped):
        np.testing.assert_allclose(continuous_angles(written, limits), truth, atol=1e-9)
    # with wide limits either is allowed: the smaller angles are kept, whichever are written
    wide = np.array([[-4.0, 4.0]] * 3)
    for written in (truth, flipped):
        np.testing.assert_allclose(continuous_angles(written, wide), flipped, atol=1e-9)


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
    found = continuous_angles(Rotation.from_euler(order, angles).as_euler(order), limits)
    expected = Rotation.from_euler(order, angles).as_matrix()
    np.testing.assert_allclose(Rotation.from_euler(order, found).as_matrix(), expected, atol=1e-9)
    # of the two ways to write a rotation the nearer one was taken: no frame is further from the last than the truth is
    steps = np.linalg.norm(np.diff(found, axis=0), axis=1)
    assert np.all(steps <= np.linalg.norm(np.diff(angles, axis=0), axis=1) + 1e-9)
