"""Kinematics of LANES poses at once against a NumPy reference."""

import likelihood_scenes as scenes
import numpy as np
import pytest

from tests.oracles.kinematics import forward as forward_oracle
from workbench.body.simd_kinematics import FRAME, LANES, POSITION, lane_frames, load_frames
from workbench.utils.kernel_cache import kernel

SKELETON = scenes.PERSON.skeleton


@kernel()
def compiled_lane_frames(poses, first, last, skeleton, values, frames):
    lane_frames(poses, first, last, skeleton, values, frames)


@kernel()
def compiled_load_frames(rotations, positions, first, frames):
    load_frames(rotations, positions, first, frames)


def frames_in_lanes(poses, first=0):
    skeleton = (SKELETON.parents, SKELETON.offsets, SKELETON.dof_joints, SKELETON.dof_axes)
    values, frames = np.empty((poses.shape[1] + 9) * LANES), np.full((len(SKELETON.parents), FRAME), np.nan)
    compiled_lane_frames(poses, first, len(poses), skeleton, values, frames)
    return frames


def unpacked(frames):
    rotations = frames[:, :POSITION].reshape(-1, 3, 3, LANES).transpose(3, 0, 1, 2)
    return rotations, frames[:, POSITION:].reshape(-1, 3, LANES).transpose(2, 0, 1)


@pytest.mark.parametrize("scale", [0.0, 0.3, 3.0, 300.0])
def test_lanes_agree_with_the_reference(scale):
    poses = scale * np.random.default_rng(0).standard_normal((LANES, 25))
    rotations, positions = unpacked(frames_in_lanes(poses))
    expected = forward_oracle(SKELETON, poses)
    # 22 turns add up their rounding; each angle is reduced by up to 1e3 quadrants of 6e-17
    np.testing.assert_allclose(rotations, expected.rotations, rtol=0.0, atol=22 * (1e-15 + scale * 3 * 6e-17))
    np.testing.assert_allclose(
        positions, expected.positions, rtol=0.0, atol=22 * (1e-15 + scale * 3 * 6e-17) * (1.0 + scale)
    )


def test_one_joint_is_exact_in_every_quadrant():
    poses = np.zeros((LANES, 25))
    poses[:, 3] = np.linspace(-4.0 * np.pi, 4.0 * np.pi, LANES)
    rotations, _ = unpacked(frames_in_lanes(poses))
    expected = forward_oracle(SKELETON, poses).rotations
    np.testing.assert_allclose(rotations, expected, rtol=0.0, atol=4e-15)


@pytest.mark.parametrize("angle", [1e6, 1e15, 1e300])
def test_huge_angles_give_finite_frames(angle):
    rotations, positions = unpacked(frames_in_lanes(np.full((LANES, 25), angle)))
    assert np.isfinite(rotations).all()
    assert not np.isnan(positions).any()


def test_the_last_pose_fills_the_remaining_lanes():
    poses = np.random.default_rng(0).standard_normal((LANES + 3, 25))
    rotations, positions = unpacked(frames_in_lanes(poses, first=LANES))
    all_rotations, _ = unpacked(frames_in_lanes(poses[[*range(LANES, LANES + 3)] + [LANES + 2] * (LANES - 3)]))
    np.testing.assert_array_equal(rotations, all_rotations)
    np.testing.assert_array_equal(positions[3:], np.repeat(positions[2:3], LANES - 3, axis=0))


def test_loaded_frames_are_unchanged():
    poses = np.random.default_rng(1).standard_normal((LANES + 5, 25))
    expected = forward_oracle(SKELETON, poses)
    frames = np.empty((len(SKELETON.parents), FRAME))
    compiled_load_frames(expected.rotations, expected.positions, 5, frames)
    rotations, positions = unpacked(frames)
    np.testing.assert_array_equal(rotations, expected.rotations[5:])
    np.testing.assert_array_equal(positions, expected.positions[5:])
