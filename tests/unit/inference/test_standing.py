"""Feet that stand: told by the image, tied to their place, on a floor that one camera's fit finds by them."""

from dataclasses import replace

import numpy as np
import pytest
from keypoint_scenes import BODY, streams
from view_scenes import CAMERAS, frames, observed

from workbench.body.kinematics import joints
from workbench.core.prior import Smoothness
from workbench.core.residual import SQUARED
from workbench.inference.least_squares.foot_contact import (
    MIN_CONTACT_S,
    contact_pairs,
    detect_foot_contacts,
    foot_contact_constraints,
    image_speeds,
    median_foot_height,
)
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.residual_problem import ResidualProblem
from workbench.inference.least_squares.residuals import joint_residual
from workbench.inference.least_squares.solver import minimise
from workbench.likelihoods.keypoints import KeypointLikelihood

SKELETON = BODY.skeleton
RATE_HZ = 30.0
LEFT, RIGHT = SKELETON.joint("left_ankle"), SKELETON.joint("right_ankle")


def lifting(n_frames=30):
    """Times (T,) and poses (T, 25) of someone who stands on the left leg and swings the right one."""
    times = np.arange(n_frames) / RATE_HZ
    poses = np.zeros((n_frames, 25))
    poses[:, :4] = [0.4, 0.0, 0.95, -1.4]
    poses[:, SKELETON.dof("right_hip_flexion")] = 0.6 - 0.6 * np.cos(2.0 * np.pi * times)
    poses[:, SKELETON.dof("right_knee_flexion")] = 0.3
    poses[:, :3] += joints(SKELETON, poses)[:1, LEFT] - joints(SKELETON, poses)[:, LEFT]
    return times, poses


@pytest.mark.parametrize("cameras", [CAMERAS, CAMERAS[:1]], ids=["two", "one"])
def test_the_foot_that_stands_is_told_from_the_one_that_swings(cameras):
    times, poses = lifting()
    stand = detect_foot_contacts(SKELETON, observed(SKELETON, frames(SKELETON, times, poses, cameras, 1.0)), times)
    assert stand[:, 0].all()
    assert not stand[:, 1].any()  # nor where it turns round, for less than MIN_CONTACT_S
    assert MIN_CONTACT_S > 2.0 * 0.1


def test_a_contact_ends_where_frames_are_missing():
    times, poses = lifting(20)
    times = np.where(np.arange(20) < 12, times, times + 1.0)
    stand = detect_foot_contacts(SKELETON, observed(SKELETON, frames(SKELETON, times, poses, CAMERAS, 1.0)), times)
    assert stand[:12, 0].all()
    assert not stand[12:].any()  # shorter than MIN_CONTACT_S by themselves
    pairs = contact_pairs(np.ones((20, 2), bool), times)
    assert sorted(map(tuple, pairs.tolist())) == [(t, k) for t in range(19) if t != 11 for k in (0, 1)]


def test_a_foot_that_a_camera_sees_move_or_nobody_sees_does_not_stand():
    times, poses = lifting()
    front, side = (observed(SKELETON, frames(SKELETON, times, poses, (camera,))) for camera in CAMERAS)
    swung = [replace(frame, keypoints=tuple(
        replace(view, marks=view.marks + np.array([20.0 * t, 0.0, 0.0])) for view in frame.keypoints
    )) for t, frame in enumerate(side)]  # fmt: skip
    both = [replace(a, keypoints=a.keypoints + b.keypoints) for a, b in zip(front, swung, strict=True)]
    assert detect_foot_contacts(SKELETON, front, times)[:, 0].all()
    assert not detect_foot_contacts(SKELETON, both, times).any()
    unseen = [replace(frame, keypoints=()) for frame in front]
    assert not detect_foot_contacts(SKELETON, unseen, times).any()


def test_speeds_in_the_image_bridge_gaps_and_trembling():
    times = np.arange(12) / RATE_HZ
    places = np.stack([90.0 * times, np.full(12, 5.0)], axis=1)  # 90 px/s
    places[4] = np.nan
    np.testing.assert_allclose(image_speeds(places, times), 90.0)
    places[:9] = np.nan
    assert np.isnan(image_speeds(places, times)[:6]).all()


def test_ties_are_the_derivatives_they_say():
    times, poses = lifting(4)
    stand = np.array([[True, False], [True, True], [False, True], [False, True]])
    ties = foot_contact_constraints(SKELETON, stand, times)
    assert [t for t, _ in ties] == [0, 1, 2]  # left, then right twice
    both = poses[1:3].ravel() + 0.01 * np.random.default_rng(0).standard_normal(50)
    misses, slopes = ties[1][1](both)
    steps = 1e-6 * np.eye(50)
    numeric = [(ties[1][1](both + step)[0] - ties[1][1](both - step)[0]) / 2e-6 for step in steps]
    assert misses.shape == (3,)
    np.testing.assert_allclose(slopes, np.transpose(numeric), atol=1e-4 * np.abs(slopes).max())


def test_a_tied_foot_stays_though_what_is_seen_of_it_slides():
    times, poses = lifting(6)
    slid = joints(SKELETON, poses)
    slid[:, :, 0] += 0.02 * np.arange(6)[:, None]  # 0.6 m/s
    whole = np.arange(len(SKELETON.names))
    residuals, moved = [joint_residual(SKELETON, whole, places, 0.05) for places in slid], []
    for stand in (np.zeros((6, 2), dtype=bool), np.tile([True, False], (6, 1))):
        problem = ResidualProblem(SKELETON, residuals, times, SQUARED, Smoothness(), stand)
        x = poses.ravel()
        quadratic = problem.expand(x)
        step = 1e-6 * np.random.default_rng(0).standard_normal(len(x))
        slope = (problem.expand(x + step).cost - problem.expand(x - step).cost) / 2.0
        assert quadratic.gradient @ step == pytest.approx(slope, rel=1e-4)
        found = minimise(problem.expand, x).x.reshape(poses.shape)
        ankles = joints(SKELETON, found)[:, LEFT]
        moved.append(np.linalg.norm(ankles[-1] - ankles[0]))
    assert moved[1] < 0.5 * moved[0]


@pytest.mark.slow
def test_one_camera_finds_the_floor_by_the_feet():
    times, poses = lifting(45)
    shown = frames(SKELETON, times, poses, CAMERAS[:1], 1.0)
    fitting = LeastSquares(BODY, KeypointLikelihood(BODY, sigma_px=2.0, loss="huber"), n_particles=2)
    fit, seen, _ = fitting.fit_frames(shown, None, streams()["start"])
    stand = detect_foot_contacts(SKELETON, seen, times)
    height = median_foot_height(SKELETON, fit.poses, stand)
    assert height == pytest.approx(joints(SKELETON, poses)[0, LEFT, 2], abs=0.08)
    ankles = joints(SKELETON, fit.poses)[:, LEFT]
    assert np.ptp(ankles, axis=0).max() < 0.04  # it stays where it is, in depth, too
