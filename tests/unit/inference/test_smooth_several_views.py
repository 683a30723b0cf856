"""Least squares on the keypoints of several views: what they tell together, poses without a motion model, limbs."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from keypoint_scenes import BODY, streams
from view_scenes import CAMERAS, errors_mm, frames, observed, swinging

from workbench.body.kinematics import joints, length_jacobian
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.skeleton import person_skeleton
from workbench.core.pose_prior import PosePrior
from workbench.core.prior import PriorCapabilities, Smoothness
from workbench.core.residual import Loss, robust
from workbench.inference.initialization.limb_lengths import LENGTHS, fit_lengths, of_keypoints, shape_of
from workbench.inference.least_squares.frame_by_frame import FrameByFrame
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.residual_problem import ResidualProblem
from workbench.inference.least_squares.residuals import views_residual
from workbench.inference.least_squares.smooth_fit import SmoothFit
from workbench.likelihoods.keypoints import KeypointLikelihood
from workbench.utils.errors import InputError

SKELETON = BODY.skeleton


def run(shown, problem, **given):
    inference = LeastSquares(BODY, KeypointLikelihood(BODY, **given), problem=problem, n_particles=20)
    return list(inference.run(shown, None, streams()))


def found(steps):
    return np.array([step.expected_pose for step in steps])


def test_every_view_adds_its_residuals_and_one_person_is_upright():
    times, poses = swinging(SKELETON, 1)
    (one,) = observed(SKELETON, frames(SKELETON, times, poses))
    assert [seen.camera.name for seen in one.keypoints] == ["front", "side"]
    misses, slopes = views_residual(SKELETON, one.keypoints, 3.0)(poses[0])
    assert misses.shape == (2 * 2 * 15 + 2,)  # two views, two pixels, and pitch and roll
    np.testing.assert_allclose(misses[:60], 0.0, atol=1e-9)
    assert slopes.shape == (62, 25)


@pytest.mark.parametrize("problem", [FrameByFrame(), SmoothFit()], ids=["frame by frame", "smooth"])
def test_two_cameras_see_depth_that_one_does_not(problem):
    times, poses = swinging(SKELETON)
    errors = [
        errors_mm(SKELETON, found(run(frames(SKELETON, times, poses, cameras, 1.0), problem)), poses)
        for cameras in (CAMERAS, CAMERAS[:1])
    ]
    assert errors[0] < 10.0  # a pixel is 7 mm there, and some of it is depth
    assert errors[1] > 3.0 * errors[0]


def test_a_smooth_fit_bridges_frames_that_show_nothing():
    times, poses = swinging(SKELETON)
    shown = frames(SKELETON, times, poses)
    for t in (6, 7):
        shown[t] = replace(shown[t], views=())
    steps = run(shown, SmoothFit())
    assert errors_mm(SKELETON, found(steps)[6:8], poses[6:8]) < 40.0  # the arm moves by 100 mm between frames
    assert steps[6].warnings == ("frames 6 to 7: no keypoints; interpolated from the frames next to them",)
    assert errors_mm(SKELETON, found(run(shown, FrameByFrame()))[6:8], poses[6:8]) > 40.0


def test_a_smooth_fit_keeps_the_limits_that_single_frames_break():
    times, poses = swinging(SKELETON)
    poses[:, SKELETON.dof("left_elbow_flexion")] = -0.6  # bent the wrong way, as a wrong keypoint would have it
    low, high = SKELETON.limits.T
    beyond = {}
    for name, problem in (("none", FrameByFrame()), ("smooth", SmoothFit())):
        fitted = found(run(frames(SKELETON, times, poses), problem, loss="huber"))
        beyond[name] = np.abs(fitted - np.clip(fitted, low, high)).max()
    assert beyond["smooth"] < 0.1 < beyond["none"]


def test_one_camera_is_told_by_the_postures_that_people_take_how_limbs_lie_in_depth():
    times, poses = swinging(SKELETON)
    shown, likelihood = frames(SKELETON, times, poses, CAMERAS[:1], 1.0), KeypointLikelihood(BODY)
    known, far = poses[:, 4:].mean(axis=0), np.full(21, 0.8)
    covariances = np.array([np.cov(poses[:, 4:].T) + 0.05**2 * np.eye(21), 0.2 * np.eye(21)])
    knows = SimpleNamespace(
        capabilities=PriorCapabilities(pose_prior=PosePrior(np.array([0.1, 0.9]), np.array([known, far]), covariances))
    )
    rng = np.random.default_rng(0)
    (before, *_), (after, *_) = (
        LeastSquares(BODY, likelihood, prior).fit_frames(shown, None, rng) for prior in (None, knows)
    )  # fmt: skip
    assert errors_mm(SKELETON, after.poses, poses) < 0.6 * errors_mm(SKELETON, before.poses, poses)
    drawn = after.poses - before.poses
    np.testing.assert_allclose(after.covariance, before.covariance + 0.5 * drawn[:, :, None] * drawn[:, None, :])


@pytest.mark.slow
def test_the_gradient_of_a_smooth_fit_is_that_of_finite_differences():
    times, poses = swinging(SKELETON, 4)
    seen = observed(SKELETON, frames(SKELETON, times, poses, sigma_px=4.0))
    each = [views_residual(SKELETON, one.keypoints, 3.0) for one in seen]
    loss, stand = Loss("geman_mcclure", 1.5), np.zeros((4, 2), dtype=bool)
    problem = ResidualProblem(SKELETON, each, times, loss, Smoothness(), stand)
    x = (poses + 0.03).ravel()
    x[SKELETON.dof("left_knee_flexion")] = -0.3
    moves = 1e-6 * np.eye(len(x))
    exact = np.array([(problem.expand(x + move).cost - problem.expand(x - move).cost) / 2e-6 for move in moves])
    np.testing.assert_allclose(problem.expand(x).gradient, exact, rtol=1e-5, atol=1e-6 * np.abs(exact).max())


def test_a_robust_residual_has_half_its_square_as_the_loss():
    loss, plain = Loss("huber", 1.0), np.array([0.0, 0.5, -3.0])
    misses, slopes = robust(lambda pose: (pose, np.eye(3)), loss)(plain)
    np.testing.assert_allclose(0.5 * misses**2, [0.0, 0.125, 2.5])
    np.testing.assert_allclose(slopes.T @ misses, [0.0, 0.5, -1.0])  # the loss's slope


OTHER = np.array([0.04, -0.05, -0.15, 0.1, 0.0, -0.12, 0.08, 0.05, -0.06])
"""Logarithms of the height over the average's, and of LENGTHS."""


def test_lengths_move_joints_as_finite_differences_say():
    _, poses = swinging(SKELETON, 3)
    skeletons = [person_skeleton(shape_of(OTHER + step * np.eye(9)[6])) for step in (1e-6, -1e-6)]
    by_length = (skeletons[0].offsets - skeletons[1].offsets)[..., None] / 2e-6
    exact = (joints(skeletons[0], poses) - joints(skeletons[1], poses)) / 2e-6
    found = length_jacobian(person_skeleton(shape_of(OTHER)), by_length, poses)[..., 0]
    np.testing.assert_allclose(found, exact, atol=1e-8)
    moved = {SKELETON.names[j] for j in np.flatnonzero(np.abs(exact).max(axis=(0, 2)) > 1e-6)}
    assert moved == {"left_wrist", "right_wrist"}  # the forearm is LENGTHS[5]
    assert LENGTHS[5] == "forearm"


def test_two_cameras_measure_a_person_of_unknown_height():
    other = person(shape_of(OTHER)).skeleton
    times, poses = swinging(other, 8, rate_hz=7.0)
    seen = [one.keypoints for one in observed(other, frames(other, times, poses))]
    measured = fit_lengths(seen, keypoint_sigma=0.002)
    # the pixels are without noise; of a deviation of 4 mm eight frames and two cameras leave 1 mm to the priors
    np.testing.assert_allclose(person_skeleton(measured.shape).offsets, other.offsets, atol=0.002)
    assert measured.error_px < 0.5
    assert errors_mm(other, measured.poses, poses) < 15.0


def test_one_camera_measures_proportions_under_a_given_height():
    longer = np.zeros(9)
    longer[1 + LENGTHS.index("torso")] = 0.1
    average, tall = (shape_of(lengths).scaled(1.9 / 1.7) for lengths in (np.zeros(9), longer))
    skeleton = person_skeleton(tall)
    times, poses = swinging(skeleton, 8, rate_hz=7.0)
    shown = frames(skeleton, times, poses, CAMERAS[:1])
    body = of_keypoints(shown, height_m=1.9)
    assert body.shape.thigh == pytest.approx(average.thigh, rel=0.05)  # PROPORTION_SIGMA
    assert abs(body.shape.neck[2] - tall.neck[2]) < abs(body.shape.neck[2] - average.neck[2])
    blind = [replace(frame, views=()) for frame in shown]
    with pytest.raises(InputError, match="expected keypoints in the dataset's frames"):
        of_keypoints(blind)
    with pytest.raises(InputError, match="height"):
        of_keypoints(shown, height_m=19.0)


def test_frames_that_are_near_in_time_are_not_looked_at_twice():
    times, poses = swinging(SKELETON, 40, rate_hz=140.0)
    taken = []

    def played():
        for frame in frames(SKELETON, times, poses):
            taken.append(frame.index)
            yield frame

    of_keypoints(played(), n_frames=3)
    assert taken[-1] == 21  # the frames 0, 10 and 20, and the one with which it stops
    assert from_height(1.7, upper_arm=0.162 * 1.7, forearm=0.154 * 1.7) == shape_of(np.zeros(9))
