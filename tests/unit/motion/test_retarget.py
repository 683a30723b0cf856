"""Retargeting against closed forms and against an independent optimiser."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from tests.oracles.kinematics import forward as forward_oracle
from workbench.body.kinematics import forward, joints
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
    """Return a clip of our skeleton in the given poses."""
    frames = forward(skeleton, poses)
    parents = np.maximum(skeleton.parents, 0)
    rotations = frames.rotations[:, parents].swapaxes(-1, -2) @ frames.rotations
    rotations[:, 0] = frames.rotations[:, 0]
    return MotionClip("own", 100.0, skeleton.names, skeleton.parents, skeleton.offsets, rotations,
                      frames.positions)  # fmt: skip


def moving_poses(rng, n=60, turns=0.0):
    """Return poses with smooth angles away from the singular directions; the heading makes `turns` turns."""
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
    turns = (motion.poses[:, 3] - poses[:, 3]) / (2 * np.pi)
    assert np.ptp(turns) < 1e-9  # the heading is continuous and right up to full turns
    assert turns[0] == pytest.approx(round(turns[0]), abs=1e-9)
    np.testing.assert_allclose(np.delete(motion.poses, 3, axis=1), np.delete(poses, 3, axis=1), atol=1e-7)
    np.testing.assert_allclose(motion.joint_error_mm, 0.0, atol=1e-4)
    for name in ("neck", "head", "shoulder", "hip", "upper_arm", "forearm", "thigh", "calf"):
        assert getattr(motion.shape, name) == pytest.approx(getattr(shape, name), abs=1e-7), name


def cmu_at_rest():
    """Return a clip in the rest pose of the CMU skeletons: legs spread by 20°, arms level, facing x."""
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
    positions = np.stack([positions, positions])
    return MotionClip("rest", 120.0, names, parents, offsets, rotations, positions)


def test_cmu_rest_pose_in_closed_form():
    motion = retarget(cmu_at_rest())
    expected = dict.fromkeys(POSE_NAMES, 0.0) | {"root_z": -0.1}
    for side in ("left", "right"):
        # at rest the elbows' hinges are 30 degrees off the vertical, so the arms are turned outward by 30 degrees
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
    analytic = moving_poses(rng, n=3)
    targets = joints(skeleton, analytic) + rng.normal(0.0, 0.01, (3, len(JOINT_NAMES), 3))
    targets += rng.normal(0.0, 5.0, (3, 1, 3))  # the position of the root is free
    refined = refine(skeleton, analytic, targets)
    rows = [JOINT_NAMES.index(name) for name in ERROR_JOINTS]
    for start, target, pose in zip(analytic, targets, refined, strict=True):

        def residual(pose, start=start, target=target):
            positions = forward_oracle(skeleton, pose[None]).positions[0]
            return np.concatenate([(positions - target)[rows].ravel(), 0.1 * (pose - start)[3:]])

        optimum = least_squares(residual, start, method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14).x
        # three steps end within 0.01 degrees of the optimum, as documented
        np.testing.assert_allclose(pose, optimum, atol=np.deg2rad(0.01))


def test_a_skeleton_with_missing_joints_is_rejected_with_their_names():
    clip = cmu_at_rest()
    renamed = tuple("left middle" if name == "ltibia" else name for name in clip.joints)
    with pytest.raises(InputError, match=r"rest.*found no joint for left_knee; name them by the key landmarks"):
        retarget(replace(clip, joints=renamed))


@pytest.mark.parametrize("scale", [0.01, 100.0])
def test_a_wrong_unit_is_rejected(scale):
    clip = cmu_at_rest()
    with pytest.raises(InputError, match="check the unit"):
        retarget(replace(clip, offsets=scale * clip.offsets, positions=scale * clip.positions))


def test_bones_without_length_are_rejected():
    clip = cmu_at_rest()
    with pytest.raises(InputError, match="of positive length"):
        retarget(replace(clip, offsets=0.0 * clip.offsets))


def test_angles_are_continuous_beyond_a_half_turn_and_a_quarter_turn():
    times = np.linspace(0.0, 1.0, 200)
    limits = np.array([[-0.8, 3.1], [-1.4, 3.1], [-1.9, 1.9]])
    # the middle angle exceeds 90 degrees, where Euler angles from matrices jump by 180 degrees
    truth = np.stack([0.3 + 0.2 * times, -0.5 + 3.3 * times, 0.4 - 0.6 * times], axis=1)
    folded = Rotation.from_euler("XYZ", truth).as_euler("XYZ")
    assert np.abs(np.diff(folded, axis=0)).max() > 3.0
    np.testing.assert_allclose(continuous_angles(folded, limits), truth, atol=1e-9)


def test_of_two_equivalent_sequences_the_one_within_the_limits_is_chosen():
    limits = np.array([[0.0, 3.1], [-1.4, 1.4], [-0.5, 3.1]])
    truth = np.array([2.5, 0.3, 2.4]) + np.linspace(0.0, 0.2, 20)[:, None]
    # (a - π, π - b, c - π) has smaller angles, but its middle angle is beyond its limit
    flipped = truth * [1.0, -1.0, 1.0] + [-np.pi, np.pi, -np.pi]
    for angles in (truth, flipped):
        np.testing.assert_allclose(continuous_angles(angles, limits), truth, atol=1e-9)
    # wide limits allow both; the smaller angles are chosen
    wide = np.array([[-4.0, 4.0]] * 3)
    for angles in (truth, flipped):
        np.testing.assert_allclose(continuous_angles(angles, wide), flipped, atol=1e-9)


FEW_EXAMPLES = settings(max_examples=15)
SEEDS = st.integers(0, 2**32 - 1)


def poses_inside_the_limits(rng, skeleton, n=12):
    """Return a movement between two poses within the limits and away from the singular middle angles, ±90 degrees.

    The arms are abducted by less than 2 rad: beyond, (a − π, π − b, c − π) can be within the limits, too.
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


@FEW_EXAMPLES
@given(seed=SEEDS, height=st.floats(1.2, 2.1))
def test_angles_within_the_limits_are_recovered(seed, height):
    skeleton = person_skeleton(from_height(height))
    poses = poses_inside_the_limits(np.random.default_rng(seed), skeleton)
    motion = retarget(own_clip(skeleton, poses), OWN)
    turns = np.round((motion.poses - poses)[0] / (2 * np.pi)) * 2 * np.pi  # angles are unique up to full turns
    turns[:3] = 0.0
    np.testing.assert_allclose(motion.poses, poses + turns, atol=1e-6)
