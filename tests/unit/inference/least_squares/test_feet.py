"""Fits of a body with feet: ankle angles of a walker, with and without detected heels and toes."""

import numpy as np
import pytest
from feet_scenes import frames, side_camera, walker
from keypoint_scenes import streams

from workbench.body.limbs import person
from workbench.core.losses import Loss
from workbench.core.pose_prior import PosePrior
from workbench.core.prior import RECORDED_SMOOTHNESS, PriorCapabilities
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.motion.smooth_fit import SmoothFit, pose_prior_gaussians
from workbench.inference.least_squares.video.pose_problem import KeypointArrays, PoseProblem
from workbench.likelihoods.keypoints import KeypointLikelihood

TIMES, BODY, POSES = walker()
CAMERA = side_camera()
ANKLES = [BODY.skeleton.dof(f"{side}_ankle_flexion") for side in ("left", "right")]


class Prior:
    """A prior with the smoothness of recorded motions, and nothing else."""

    capabilities = PriorCapabilities(smoothness=RECORDED_SMOOTHNESS)


def fit(sequence, body=BODY, sigma_px=3.0):
    inference = LeastSquares(body, KeypointLikelihood(body, sigma_px=sigma_px), Prior(), problem=SmoothFit())
    return inference.fit_frames(sequence, None, streams()["start"])[0]


def ankle_errors_deg(found):
    return np.degrees(found.poses[:, ANKLES] - POSES[:, ANKLES])


def test_ankles_follow_detected_heels_and_toes():
    found = fit(frames(TIMES, BODY, POSES, CAMERA, sigma_px=3.0))
    errors = ankle_errors_deg(found)
    assert np.sqrt((errors**2).mean()) < 4.0
    std_deg = np.degrees(np.sqrt(found.covariance[:, ANKLES, ANKLES]))
    assert (np.abs(errors) < 1.645 * std_deg).mean() > 0.7
    assert np.median(std_deg) < 6.0


def test_without_heels_and_toes_the_ankles_have_wide_intervals():
    found = fit(frames(TIMES, BODY, POSES, CAMERA, sigma_px=3.0, feet=False))
    std_deg = np.degrees(np.sqrt(found.covariance[:, ANKLES, ANKLES]))
    assert std_deg.min() > 11.0
    assert (np.abs(ankle_errors_deg(found)) < 1.645 * std_deg).mean() > 0.9


def test_the_width_without_observations_does_not_depend_on_the_rate():
    widths = []
    for rate_hz in (30.0, 60.0):
        times, body, poses = walker(int(1.5 * rate_hz), rate_hz, first=int(2.0 * rate_hz))
        found = fit(frames(times, body, poses, CAMERA, sigma_px=3.0, feet=False), body)
        widths.append(np.median(np.sqrt(found.covariance[:, ANKLES, ANKLES])))
    assert widths[1] == pytest.approx(widths[0], rel=0.1)


def test_the_other_angles_are_those_of_the_body_without_feet():
    sequence = frames(TIMES, BODY, POSES, CAMERA, sigma_px=3.0, feet=False)
    with_feet, without = fit(sequence), fit(sequence, person(BODY.shape))
    np.testing.assert_allclose(with_feet.poses[:, :25], without.poses, atol=2e-3)


def test_a_pose_prior_of_the_person_leaves_the_ankles_to_their_nominal_values():
    """The mixture is over the posture of the plain body, the last 21 of its numbers."""
    mixture = PosePrior(np.ones(1), np.full((1, 21), 0.3), 0.04 * np.eye(21)[None])
    observed = KeypointArrays.none(len(TIMES))
    contacts = np.zeros((len(TIMES), 2), bool)
    problem = PoseProblem(BODY.skeleton, observed, TIMES, Loss("squared", 1.0), RECORDED_SMOOTHNESS, contacts)
    covariances = np.tile(np.eye(27), (len(POSES), 1, 1))
    means, precisions = pose_prior_gaussians(mixture, POSES, covariances, 0.5, problem.nominal)
    np.testing.assert_allclose(means[:, 4:25], 0.3)
    np.testing.assert_allclose(precisions[:, 4:25, 4:25], np.tile(0.5 / 0.04 * np.eye(21), (len(POSES), 1, 1)))
    assert not precisions[:, :4].any()
    assert not precisions[:, 4:25, 25:].any()
    np.testing.assert_array_equal(precisions[0, 25:, 25:], problem.nominal[1][25:, 25:])
    np.testing.assert_array_equal(means[:, 25:], np.tile(problem.nominal[0][25:], (len(POSES), 1)))
