"""Initial poses of every frame from world landmarks: exact landmarks return the poses, in any direction of view."""

from dataclasses import replace

import numpy as np
import pytest
from keypoint_scenes import BODY, walk
from view_scenes import errors_mm, frames, observed, swinging

from workbench.body.kinematics import axis_rotations, forward, joints
from workbench.cameras.camera import plain_camera
from workbench.core.losses import Loss
from workbench.core.prior import Smoothness
from workbench.inference.least_squares.motion.smooth_fit import fit_smooth, keypoint_problem
from workbench.inference.least_squares.video.landmark_depths import DepthArrays
from workbench.inference.least_squares.video.landmark_poses import (
    MEDIAN_WINDOW_S,
    landmark_paths,
    landmark_poses,
    median_rotations,
)

SKELETON, SIGMA_PX = BODY.skeleton, 4.0
CENTRED = plain_camera(640, 480, 700.0, (0.4, -5.0, 1.2), (0.4, 0.0, 1.0), name="front")
FROM_ABOVE = plain_camera(640, 480, 500.0, (3.0, 3.0, 3.5), (0.4, 0.0, 0.9), name="above")
OFF_AXIS = plain_camera(640, 480, 500.0, (-1.0, -5.0, 1.2), (-2.6, 0.0, 1.8), name="side")  # the person at 30°


def with_landmarks(observations, poses, scale=1.0, noise_m=0.0, seed=0):
    """Return observations with world landmarks of poses (T, 25), along the axes of a camera that looks at the person:
    the camera turned about the normal of the optical axis and the line of sight."""
    rng, result = np.random.default_rng(seed), []
    for frame, place in zip(observations, joints(SKELETON, poses), strict=True):
        (view,) = frame.keypoints
        camera = view.camera
        line = camera.directions(camera.undistorted(view.detections[:, :2]).mean(axis=0))
        axis = np.cross(camera.rotation[2], line)
        sine = np.linalg.norm(axis)
        turn = axis_rotations(axis / max(sine, 1e-12), np.array([np.arctan2(sine, camera.rotation[2] @ line)]))[0]
        world = (scale * (place - place[0]))[view.joints] @ turn @ camera.rotation.T
        world = world + noise_m * rng.standard_normal(world.shape)
        result.append(replace(frame, keypoints=(replace(view, world_landmarks=world),)))
    return result


def scene(camera, scale=1.0):
    times, poses = swinging(SKELETON)
    return times, with_landmarks(observed(SKELETON, frames(SKELETON, times, poses, (camera,))), poses, scale), poses


@pytest.mark.parametrize("camera", [CENTRED, FROM_ABOVE, OFF_AXIS], ids=lambda camera: camera.name)
def test_the_axes_of_a_camera_towards_the_person_are_a_rotation_of_its_own(camera):
    direction = np.array([0.3, 0.9, 0.2])
    direction /= np.linalg.norm(direction)
    axes = camera.viewing_axes(direction)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    np.testing.assert_allclose(axes[2], direction, atol=1e-12)
    normal = np.cross(camera.rotation[2], direction)
    np.testing.assert_allclose(axes @ normal, camera.rotation @ normal, atol=1e-12)  # the axis of the rotation


@pytest.mark.parametrize("scale", [1.0, 0.7])
@pytest.mark.parametrize("camera", [CENTRED, FROM_ABOVE, OFF_AXIS], ids=lambda camera: camera.name)
def test_exact_landmarks_of_any_size_return_the_poses(camera, scale):
    times, observations, poses = scene(camera, scale)
    estimate = landmark_poses(SKELETON, observations, times)
    cosines = np.einsum("tab,tab->t", *(forward(SKELETON, each).rotations[:, 0] for each in (estimate, poses)))
    # the median replaces each frame's rotation by one of its neighbours'
    assert np.degrees(np.arccos(np.clip(0.5 * (cosines - 1.0), -1.0, 1.0))).max() < 20.0
    assert errors_mm(SKELETON, estimate, poses) < 60.0


@pytest.mark.parametrize("camera", [CENTRED, FROM_ABOVE, OFF_AXIS], ids=lambda camera: camera.name)
def test_exact_landmarks_of_a_person_at_rest_return_the_pose(camera):
    times, poses = swinging(SKELETON)
    poses = np.repeat(poses[3:4], len(times), axis=0)
    clip = observed(SKELETON, frames(SKELETON, times, poses, (camera,)))
    estimate = landmark_poses(SKELETON, with_landmarks(clip, poses), times)
    np.testing.assert_allclose(estimate[:, 3:6], poses[:, 3:6], atol=1e-6)
    assert errors_mm(SKELETON, estimate, poses) < 10.0  # nominal angles against LIMB_SIGMA_M


def test_mirrored_landmarks_return_the_pose_reflected_in_depth():
    times, observations, _ = scene(CENTRED)
    as_observed, mirrored = landmark_paths(SKELETON, observations, times)
    np.testing.assert_array_equal(as_observed, landmark_poses(SKELETON, observations, times))
    shoulders = [SKELETON.joint(f"{side}_shoulder") for side in ("right", "left")]
    left = [np.diff(joints(SKELETON, path)[:, shoulders], axis=1) for path in (as_observed, mirrored)]
    depths, across = ([line[:, 0] @ CENTRED.rotation[k] for line in left] for k in (2, 0))
    np.testing.assert_allclose(depths[0], -depths[1], atol=0.05)
    np.testing.assert_allclose(across[0], across[1], atol=0.05)


def test_frames_without_landmarks_are_interpolated():
    times, observations, _ = scene(CENTRED)
    everywhere = landmark_poses(SKELETON, observations, times)
    (view,) = observations[4].keypoints
    for hidden in ((), (replace(view, world_landmarks=None),)):
        gap = [replace(frame, keypoints=hidden) if t == 4 else frame for t, frame in enumerate(observations)]
        estimate = landmark_poses(SKELETON, gap, times)
        np.testing.assert_allclose(estimate[4], 0.5 * (estimate[3] + estimate[5]), atol=1e-12)
        assert errors_mm(SKELETON, estimate, everywhere) < 60.0
    none = [replace(frame, keypoints=()) for frame in observations]
    assert landmark_poses(SKELETON, none, times) is None
    assert landmark_paths(SKELETON, none, times) is None


@pytest.mark.parametrize(("n_wrong", "expected"), [(3, True), (4, False)])
def test_a_median_rotation_ignores_a_minority_of_wrong_frames(n_wrong, expected):
    times = np.arange(7) * MEDIAN_WINDOW_S / 6.0  # all within half a window of the middle one
    half_turn = axis_rotations(np.array([0.0, 0.0, 1.0]), np.array([np.pi]))[0]
    rotations = np.array([half_turn if t < n_wrong else np.eye(3) for t in range(7)])
    assert np.allclose(median_rotations(rotations, times)[3], np.eye(3)) == expected


def turning_walk(n_frames=42):
    """Return times, noisy observations with landmarks, and poses of a walk that turns by half a circle on the spot."""
    times, _, poses = walk(n_frames)
    poses[:, :2] = [0.4, 0.0]
    poses[:, 3] = np.pi * np.clip((times - times[-1] / 3.0) / (times[-1] / 3.0), 0.0, 1.0)
    clip = observed(SKELETON, frames(SKELETON, times, poses, (CENTRED,), sigma_px=SIGMA_PX))
    return times, with_landmarks(clip, poses, scale=0.8, noise_m=0.05), poses


def facing_errors_deg(poses, truth):
    forwards = [forward(SKELETON, each).rotations[:, 0, :, 0] for each in (poses, truth)]
    return np.degrees(np.arccos(np.clip((forwards[0] * forwards[1]).sum(axis=1), -1.0, 1.0)))


def test_a_walk_that_turns_faces_the_right_way_in_all_frames():
    times, observations, truth = turning_walk()
    problem = replace(
        keypoint_problem(SKELETON, observations, times, SIGMA_PX, Loss("geman_mcclure", 3.0), Smoothness()),
        depths=DepthArrays.of(SKELETON, observations, 0.1),
    )
    fit = fit_smooth(problem, observations, landmark_paths(SKELETON, observations, times), 40)
    assert facing_errors_deg(fit.poses, truth).max() < 45.0


def test_the_median_of_a_long_video_takes_memory_in_proportion_to_its_frames():
    rotations = np.tile(np.eye(3), (5000, 1, 1))
    rotations[2000] = np.diag([-1.0, -1.0, 1.0])
    np.testing.assert_array_equal(median_rotations(rotations, np.arange(5000) / 30.0), np.tile(np.eye(3), (5000, 1, 1)))
