"""Foot contacts: their detection in the image, the constraints that they add to a fit, and the floor height."""

from dataclasses import replace

import numpy as np
import pytest
from keypoint_scenes import BODY, streams
from scipy.spatial.transform import Rotation
from view_scenes import CAMERAS, frames, observed

from tests.oracles.smooth_poses import foot_drifts, joint_residual
from workbench.body.kinematics import joints
from workbench.core.losses import SQUARED
from workbench.core.prior import Smoothness
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.solver.sparse_solver import minimise
from workbench.inference.least_squares.video.foot_contact import (
    MIN_CONTACT_S,
    contact_pairs,
    detect_foot_contacts,
    image_speeds,
    median_foot_height,
)
from workbench.inference.least_squares.video.pose_problem import KeypointArrays, PoseProblem
from workbench.likelihoods.keypoints import KeypointLikelihood

SKELETON = BODY.skeleton
RATE_HZ = 30.0
LEFT, RIGHT = SKELETON.joint("left_ankle"), SKELETON.joint("right_ankle")


def leg_swing(n_frames=30):
    """Return times (T,) and poses (T, 25) of a person who stands on the left leg and swings the right one."""
    times = np.arange(n_frames) / RATE_HZ
    poses = np.zeros((n_frames, 25))
    poses[:, :4] = [0.4, 0.0, 0.95, -1.4]
    poses[:, SKELETON.dof("right_hip_flexion")] = 0.6 - 0.6 * np.cos(2.0 * np.pi * times)
    poses[:, SKELETON.dof("right_knee_flexion")] = 0.3
    poses[:, :3] += joints(SKELETON, poses)[:1, LEFT] - joints(SKELETON, poses)[:, LEFT]
    return times, poses


@pytest.mark.parametrize("cameras", [CAMERAS, CAMERAS[:1]], ids=["two", "one"])
def test_the_standing_foot_is_in_contact_and_the_swinging_one_is_not(cameras):
    times, poses = leg_swing()
    contacts = detect_foot_contacts(SKELETON, observed(SKELETON, frames(SKELETON, times, poses, cameras, 1.0)), times)
    assert contacts[:, 0].all()
    assert not contacts[:, 1].any()  # it is slow at its turning points, for less than MIN_CONTACT_S
    assert MIN_CONTACT_S > 2.0 * 0.1


def test_contacts_are_the_same_if_the_camera_pans():
    times, poses = leg_swing()
    (still,) = CAMERAS[:1]
    turns = Rotation.from_euler("y", 0.01 * np.arange(30)[:, None]).as_matrix()  # the person leaves the image
    cameras = [replace(still, rotation=turn @ still.rotation, translation=turn @ still.translation) for turn in turns]
    panned = [observed(SKELETON, frames(SKELETON, times, poses, (camera,), 1.0))[t] for t, camera in enumerate(cameras)]
    contacts = detect_foot_contacts(SKELETON, panned, times)
    assert contacts[:, 0].all()
    assert not contacts[:, 1].any()


def with_landmarks(view, places):
    """Return a view with the world landmarks of a detector that knows the joints at places (J, 3), m."""
    middle = view.camera.directions(view.camera.undistorted(view.detections[:, :2]).mean(axis=0))
    return replace(view, world_landmarks=places[view.joints] @ view.camera.viewing_axes(middle).T)


@pytest.mark.parametrize("n_cameras", [1, 2])
@pytest.mark.parametrize(
    ("raised_m", "n_raised", "is_raised"), [(0.14, 15, 0), (0.16, 15, 1), (0.16, 7, 0), (-0.16, 15, 0)]
)
def test_a_foot_at_rest_that_is_raised_above_the_other_is_not_in_contact(n_cameras, raised_m, n_raised, is_raised):
    """It is raised if it is in most frames of the contact, as landmarks are wrong in some."""
    times, poses = np.arange(15) / RATE_HZ, np.tile(leg_swing(1)[1], (15, 1))
    places = joints(SKELETON, poses)
    places[:, RIGHT, 2] = places[:, LEFT, 2] + np.where(np.arange(15) < n_raised, raised_m, 0.0)
    seen = observed(SKELETON, frames(SKELETON, times, poses, CAMERAS[:n_cameras]))
    assert detect_foot_contacts(SKELETON, seen, times).all()
    seen = [
        replace(frame, keypoints=tuple(with_landmarks(view, places[t]) for view in frame.keypoints))
        for t, frame in enumerate(seen)
    ]
    contacts = detect_foot_contacts(SKELETON, seen, times)
    assert contacts.tolist() == [[raised_m > -0.15, not is_raised]] * 15


def test_a_contact_ends_where_frames_are_missing():
    times, poses = leg_swing(20)
    times = np.where(np.arange(20) < 12, times, times + 1.0)
    contacts = detect_foot_contacts(SKELETON, observed(SKELETON, frames(SKELETON, times, poses, CAMERAS, 1.0)), times)
    assert contacts[:12, 0].all()
    assert not contacts[12:].any()  # shorter than MIN_CONTACT_S
    pairs = contact_pairs(np.ones((20, 2), bool), times)
    assert sorted(map(tuple, pairs.tolist())) == [(t, k) for t in range(19) if t != 11 for k in (0, 1)]


def test_a_foot_that_moves_in_one_view_or_is_in_no_view_is_not_in_contact():
    times, poses = leg_swing()
    front, side = (observed(SKELETON, frames(SKELETON, times, poses, (camera,))) for camera in CAMERAS)
    both = []
    for t, (first, second) in enumerate(zip(front, side, strict=True)):
        (view,) = second.keypoints
        moving = replace(view, detections=view.detections + np.array([20.0 * t, 0.0, 0.0]))
        both.append(replace(first, keypoints=(*first.keypoints, moving)))
    assert detect_foot_contacts(SKELETON, front, times)[:, 0].all()
    assert not detect_foot_contacts(SKELETON, both, times).any()
    without_views = [replace(frame, keypoints=()) for frame in front]
    assert not detect_foot_contacts(SKELETON, without_views, times).any()


def test_image_speeds_are_interpolated_over_single_missing_frames():
    times = np.arange(12) / RATE_HZ
    pixels = np.stack([90.0 * times, np.full(12, 5.0)], axis=1)  # 90 px/s
    pixels[4] = np.nan
    np.testing.assert_allclose(image_speeds(pixels, times), 90.0)
    pixels[:9] = np.nan
    assert np.isnan(image_speeds(pixels, times)[:6]).all()


def test_the_jacobian_of_contact_constraints_equals_finite_differences():
    times, poses = leg_swing(4)
    contacts = np.array([[True, False], [True, True], [False, True], [False, True]])
    constraints = foot_drifts(SKELETON, contacts, times)
    assert [t for t, _ in constraints] == [0, 1, 2]  # the left foot, then the right one twice
    residual = constraints[1][1]
    x = poses[1:3].ravel() + 0.01 * np.random.default_rng(0).standard_normal(50)
    values, jacobian = residual(x)
    steps = 1e-6 * np.eye(50)
    exact = [(residual(x + step)[0] - residual(x - step)[0]) / 2e-6 for step in steps]
    assert values.shape == (3,)
    np.testing.assert_allclose(jacobian, np.transpose(exact), atol=1e-4 * np.abs(jacobian).max())


def test_a_foot_in_contact_moves_less_than_its_observations():
    times, poses = leg_swing(6)
    sliding = joints(SKELETON, poses)
    sliding[:, :, 0] += 0.02 * np.arange(6)[:, None]  # 0.6 m/s
    residuals = [joint_residual(SKELETON, np.arange(len(SKELETON.names)), points, 0.05) for points in sliding]

    def distance(contacts):
        keypoints = KeypointArrays.none(6)
        options = (times, SQUARED, Smoothness(), contacts)
        problem = PoseProblem(SKELETON, keypoints, *options, residual_functions=residuals)
        x = poses.ravel()
        step = 1e-6 * np.random.default_rng(0).standard_normal(len(x))
        change = (problem.expand(x + step).cost - problem.expand(x - step).cost) / 2.0
        assert problem.expand(x).gradient @ step == pytest.approx(change, rel=1e-4)
        ankles = joints(SKELETON, minimise(problem.expand, x).x.reshape(poses.shape))[:, LEFT]
        return np.linalg.norm(ankles[-1] - ankles[0])

    assert distance(np.tile([True, False], (6, 1))) < 0.5 * distance(np.zeros((6, 2), dtype=bool))


def test_one_camera_determines_the_floor_by_the_foot_contacts():
    times, poses = leg_swing(45)
    sequence = frames(SKELETON, times, poses, CAMERAS[:1], 1.0)
    inference = LeastSquares(BODY, KeypointLikelihood(BODY, sigma_px=2.0, loss="huber"), n_particles=2)
    fit, observations, _ = inference.fit_frames(sequence, None, streams()["start"])
    contacts = detect_foot_contacts(SKELETON, observations, times)
    height = median_foot_height(SKELETON, fit.poses, contacts)
    assert height == pytest.approx(joints(SKELETON, poses)[0, LEFT, 2], abs=0.08)
    ankles = joints(SKELETON, fit.poses)[:, LEFT]
    assert np.ptp(ankles, axis=0).max() < 0.04  # also in depth
