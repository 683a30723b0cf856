"""Smooth fits to the keypoints of several views: depth, missing frames, joint limits, pose prior, limb lengths."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from keypoint_scenes import BODY, CAMERA, streams, walk
from view_scenes import CAMERAS, errors_mm, frames, observed, swinging

from workbench.body.kinematics import joints, length_jacobian
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.skeleton import person_skeleton
from workbench.cameras.camera import plain_camera
from workbench.core.losses import Loss
from workbench.core.observations import Keypoints
from workbench.core.pose_prior import PosePrior
from workbench.core.prior import PriorCapabilities, Smoothness
from workbench.core.residual import robust
from workbench.inference.initialization.limb_lengths import LENGTHS, best_observed, fit_lengths, of_keypoints, shape_of
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.motion.frame_by_frame import FrameByFrame
from workbench.inference.least_squares.motion.smooth_fit import SmoothFit
from workbench.inference.least_squares.solver.residuals import views_residual
from workbench.inference.least_squares.video.pose_problem import KeypointArrays, PoseProblem
from workbench.likelihoods.keypoints import KeypointLikelihood
from workbench.utils.errors import InputError

SKELETON = BODY.skeleton


def run(sequence, problem, **options):
    inference = LeastSquares(BODY, KeypointLikelihood(BODY, **options), problem=problem, n_particles=20)
    return list(inference.run(sequence, None, streams()))


def estimates(steps):
    return np.array([step.expected_pose for step in steps])


def test_every_view_adds_its_residuals_to_those_of_an_upright_root():
    times, poses = swinging(SKELETON, 1)
    (observation,) = observed(SKELETON, frames(SKELETON, times, poses))
    assert [view.camera.name for view in observation.keypoints] == ["front", "side"]
    residuals, jacobian = views_residual(SKELETON, observation.keypoints, 3.0)(poses[0])
    assert residuals.shape == (2 * 2 * 15 + 2,)  # two views of two coordinates of 15 joints, and pitch and roll
    np.testing.assert_allclose(residuals[:60], 0.0, atol=1e-9)
    assert jacobian.shape == (62, 25)


@pytest.mark.parametrize("problem", [FrameByFrame(), SmoothFit()], ids=["frame by frame", "smooth"])
def test_two_cameras_determine_depth_better_than_one(problem):
    times, poses = swinging(SKELETON)
    two_mm, one_mm = (
        errors_mm(SKELETON, estimates(run(frames(SKELETON, times, poses, cameras, 1.0), problem)), poses)
        for cameras in (CAMERAS, CAMERAS[:1])
    )
    assert two_mm < 10.0  # one pixel is 7 mm, and the error in depth is larger
    assert one_mm > 3.0 * two_mm


def test_a_smooth_fit_interpolates_frames_without_keypoints():
    times, poses = swinging(SKELETON)
    sequence = [
        replace(frame, views=()) if t in (6, 7) else frame for t, frame in enumerate(frames(SKELETON, times, poses))
    ]
    steps = run(sequence, SmoothFit())
    assert errors_mm(SKELETON, estimates(steps)[6:8], poses[6:8]) < 40.0  # the arm moves by 100 mm between frames
    assert steps[6].warnings == ("frames 6 to 7: no keypoints; interpolated from the frames next to them",)
    assert errors_mm(SKELETON, estimates(run(sequence, FrameByFrame()))[6:8], poses[6:8]) > 40.0


def test_a_smooth_fit_respects_joint_limits_that_single_frames_violate():
    times, poses = swinging(SKELETON)
    poses[:, SKELETON.dof("left_elbow_flexion")] = -0.6  # hyperextended, as by wrong keypoints

    def violation(problem):
        fitted = estimates(run(frames(SKELETON, times, poses), problem, loss="huber"))
        return np.abs(fitted - np.clip(fitted, *SKELETON.limits.T)).max()

    assert violation(SmoothFit()) < 0.1 < violation(FrameByFrame())


def test_a_pose_prior_determines_depth_with_one_camera():
    times, poses = swinging(SKELETON)
    sequence, likelihood = frames(SKELETON, times, poses, CAMERAS[:1], 1.0), KeypointLikelihood(BODY)
    means = np.array([poses[:, 4:].mean(axis=0), np.full(21, 0.8)])
    covariances = np.array([np.cov(poses[:, 4:].T) + 0.05**2 * np.eye(21), 0.2 * np.eye(21)])
    pose_prior = PosePrior(np.array([0.1, 0.9]), means, covariances)
    rng = np.random.default_rng(0)
    (without, *_), (with_prior, *_) = (
        LeastSquares(BODY, likelihood, prior).fit_frames(sequence, None, rng)
        for prior in (None, SimpleNamespace(capabilities=PriorCapabilities(pose_prior=pose_prior)))
    )
    assert errors_mm(SKELETON, with_prior.poses, poses) < 0.6 * errors_mm(SKELETON, without.poses, poses)
    change = with_prior.poses - without.poses
    expected = without.covariance + 0.5 * change[:, :, None] * change[:, None, :]
    np.testing.assert_allclose(with_prior.covariance, expected)


def test_the_gradient_of_a_smooth_fit_equals_finite_differences():
    times, poses = swinging(SKELETON, 3)
    observations = observed(SKELETON, frames(SKELETON, times, poses, sigma_px=4.0))
    residuals = [views_residual(SKELETON, frame.keypoints, 3.0) for frame in observations]
    loss, contacts = Loss("geman_mcclure", 1.5), np.zeros((3, 2), dtype=bool)
    options = (times, loss, Smoothness(), contacts)
    problem = PoseProblem(SKELETON, KeypointArrays.none(3), *options, residual_functions=residuals)
    x = (poses + 0.03).ravel()
    x[SKELETON.dof("left_knee_flexion")] = -0.3
    steps = 1e-6 * np.eye(len(x))[::2]
    exact = np.array([(problem.expand(x + step).cost - problem.expand(x - step).cost) / 2e-6 for step in steps])
    np.testing.assert_allclose(problem.expand(x).gradient[::2], exact, rtol=1e-5, atol=1e-6 * np.abs(exact).max())


def test_half_the_square_of_a_robust_residual_is_the_loss():
    values, jacobian = robust(lambda pose: (pose, np.eye(3)), Loss("huber", 1.0))(np.array([0.0, 0.5, -3.0]))
    np.testing.assert_allclose(0.5 * values**2, [0.0, 0.125, 2.5])
    np.testing.assert_allclose(jacobian.T @ values, [0.0, 0.5, -1.0])  # the derivative of the loss


LOG_RATIOS = np.array([0.04, -0.05, -0.15, 0.1, 0.0, -0.12, 0.08, 0.05, -0.06])
"""Logarithms of the ratios of height and LENGTHS to those of an average person."""


def test_the_jacobian_by_a_length_equals_finite_differences():
    assert LENGTHS[5] == "forearm"
    _, poses = swinging(SKELETON, 3)
    skeletons = [person_skeleton(shape_of(LOG_RATIOS + step * np.eye(9)[6])) for step in (1e-6, -1e-6)]
    by_length = (skeletons[0].offsets - skeletons[1].offsets)[..., None] / 2e-6
    exact = (joints(skeletons[0], poses) - joints(skeletons[1], poses)) / 2e-6
    jacobian = length_jacobian(person_skeleton(shape_of(LOG_RATIOS)), by_length, poses)[..., 0]
    np.testing.assert_allclose(jacobian, exact, atol=1e-8)
    dependent = {SKELETON.names[j] for j in np.flatnonzero(np.abs(exact).max(axis=(0, 2)) > 1e-6)}
    assert dependent == {"left_wrist", "right_wrist"}


def test_two_cameras_measure_a_person_of_unknown_height():
    skeleton = person(shape_of(LOG_RATIOS)).skeleton
    times, poses = swinging(skeleton, 8, rate_hz=7.0)
    keypoints = [frame.keypoints for frame in observed(skeleton, frames(skeleton, times, poses))]
    measured = fit_lengths(keypoints, keypoint_sigma=0.002)
    # The pixels have no noise. With a deviation of 4 mm, eight frames and two cameras, the bias by the priors is 1 mm.
    np.testing.assert_allclose(person_skeleton(measured.shape).offsets, skeleton.offsets, atol=0.002)
    assert measured.error_px < 0.5
    assert errors_mm(skeleton, measured.poses, poses) < 15.0


def test_trial_steps_to_impossible_heights_are_tolerated():
    """The search from exact keypoints of two cameras takes such steps."""
    _, _, poses = walk(8)
    cameras = (CAMERA, plain_camera(640, 480, 700.0, (5.4, 0.0, 1.2), (0.4, 0.0, 1.0), "side"))
    keypoints = [
        [Keypoints(np.arange(15), np.column_stack([c.project(positions), np.ones(15)]), c) for c in cameras]
        for positions in joints(BODY.skeleton, poses)
    ]
    measured = fit_lengths(keypoints, keypoint_sigma=0.002)
    np.testing.assert_allclose(person_skeleton(measured.shape).offsets, BODY.skeleton.offsets, atol=0.001)


def test_one_camera_measures_proportions_of_a_person_of_known_height():
    log_ratios = np.zeros(9)
    log_ratios[1 + LENGTHS.index("torso")] = 0.1
    average, long_torso = (shape_of(ratios).scaled(1.9 / 1.7) for ratios in (np.zeros(9), log_ratios))
    skeleton = person_skeleton(long_torso)
    times, poses = swinging(skeleton, 8, rate_hz=7.0)
    sequence = frames(skeleton, times, poses, CAMERAS[:1])
    body = of_keypoints(sequence, height_m=1.9)
    assert body.shape.thigh == pytest.approx(average.thigh, rel=0.05)  # PROPORTION_SIGMA
    assert abs(body.shape.neck[2] - long_torso.neck[2]) < abs(body.shape.neck[2] - average.neck[2])
    with pytest.raises(InputError, match="height"):
        of_keypoints(sequence, height_m=19.0)
    with pytest.raises(InputError, match="expected keypoints in the dataset's frames"):
        of_keypoints([replace(frame, views=()) for frame in sequence])


@pytest.mark.parametrize("height_m", [0.5, 2.5])
def test_the_smallest_and_the_largest_person_have_limbs(height_m):
    skeleton = person_skeleton(from_height(height_m))
    times, poses = swinging(skeleton, 4, rate_hz=7.0)
    body = of_keypoints(frames(skeleton, times, poses, CAMERAS[:1]), height_m=height_m)
    assert body.shape.thigh == pytest.approx(from_height(height_m).thigh, rel=0.1)


def test_lengths_are_measured_where_most_of_the_person_is_seen():
    """In each of three equal parts; of equal frames in the first."""
    views = observed(SKELETON, frames(SKELETON, *swinging(SKELETON, 9), CAMERAS[:1]))
    candidates = [frame.keypoints for frame in views]
    (hidden,) = candidates[3]
    candidates[3] = (replace(hidden, joints=hidden.joints[:5], detections=hidden.detections[:5]),)
    chosen = best_observed(candidates, 3)
    assert [candidates.index(frame) for frame in chosen] == [0, 4, 6]
    assert best_observed(candidates, 20) == candidates


def test_the_average_shape_has_the_published_arm_lengths():
    assert shape_of(np.zeros(9)) == from_height(1.7, upper_arm=0.162 * 1.7, forearm=0.154 * 1.7)
