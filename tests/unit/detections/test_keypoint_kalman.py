"""The Kalman filter over a person's joints against the densities and the process of its model."""

import numpy as np
import pytest
from crowd_scenes import CAMERAS, walkers
from scipy.linalg import expm
from scipy.stats import multivariate_normal

from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.triangulation import triangulate_normalized
from workbench.detections.association import keypoint_kalman as kalman
from workbench.detections.association.detector_view import Detection, DetectorView
from workbench.detections.association.keypoint_kalman import (
    ARMS,
    LEGS,
    PredictedView,
    exchanged,
    initial_state,
    predict,
)

FRONT = DetectorView(CAMERAS["front"], np.ones(15, dtype=bool))
BODY = walkers([((0.0, 0.0), (1.0, 0.0))], 1)[0][0]


def detection(joints, sigma_m=0.03):
    return Detection(FRONT.places(joints)[0], np.full(15, sigma_m), np.zeros(15, dtype=bool))


def test_prediction_solves_the_stochastic_differential_equation():
    """Compare with the matrix exponential of dx = v dt, dv = −v/τ dt + noise (Van Loan 1978), in one and two steps."""
    state = predict(initial_state(BODY, np.full(15, 0.1)), 0.2)
    drift = np.array([[0.0, 1.0], [0.0, -1.0 / kalman.TAU_S]])
    noise = np.array([[0.0, 0.0], [0.0, 2.0 / kalman.TAU_S]])  # with a stationary variance of 1
    block = expm(np.block([[-drift, noise], [np.zeros((2, 2)), drift.T]]) * 0.2)
    transition, integral = block[2:, 2:].T, block[2:, 2:].T @ block[:2, 2:]
    for joint in (JOINT_NAMES.index("left_wrist"), JOINT_NAMES.index("neck")):
        variance = kalman.INDIVIDUAL_M_S[joint] ** 2 + kalman.WALKING_M_S**2
        expected = transition @ np.diag([0.1**2, variance]) @ transition.T + variance * integral
        rows = np.array([3 * joint, 45 + 3 * joint])
        np.testing.assert_allclose(state.covariance[np.ix_(rows, rows)], expected, rtol=1e-9)
    twice = predict(predict(initial_state(BODY, np.full(15, 0.1)), 0.15), 0.05)
    np.testing.assert_allclose(twice.covariance, state.covariance, rtol=1e-9, atol=1e-12)


def test_the_log_density_of_a_match_is_the_sum_over_joints():
    state = initial_state(BODY, np.full(15, 0.1))
    shifted = BODY + np.array([0.0, 0.05, 0.02])
    match = PredictedView(state, FRONT).matches([detection(shifted)])[0]
    places, jacobians, depth = FRONT.project(BODY)
    residuals = (FRONT.places(shifted)[0] - places) * depth[:, None]
    jacobians = jacobians * depth[:, None, None]
    expected = sum(
        multivariate_normal.logpdf(residuals[j], cov=0.01 * jacobians[j] @ jacobians[j].T + 0.03**2 * np.eye(2))
        for j in range(15)
    )
    assert match.log_density == pytest.approx(expected)
    assert len(match.rows) == 15


def test_the_state_converges_to_repeated_detections():
    state = initial_state(BODY, np.full(15, 0.3))
    true_joints = BODY + np.array([0.0, 0.2, 0.1])
    for _ in range(20):
        for camera in CAMERAS.values():
            view = DetectorView(camera, np.ones(15, dtype=bool))
            predicted = PredictedView(state, view)
            state = predicted.updated(
                predicted.matches(
                    [Detection(view.places(true_joints)[0], np.full(15, 0.03), np.zeros(15, dtype=bool))]
                )[0]
            )
    np.testing.assert_allclose(state.joints, true_joints, atol=5e-3)
    assert (np.linalg.eigvalsh(state.covariance) > -1e-12).all()


def test_an_outlier_joint_has_a_constant_density_and_no_influence():
    state = predict(initial_state(BODY, np.full(15, 0.02)), 1 / 30)
    predicted = PredictedView(state, FRONT)
    without_wrist, with_outlier = detection(BODY), detection(BODY)
    wrist = JOINT_NAMES.index("left_wrist")
    with_outlier.places[wrist] += 0.2
    outlier_match = predicted.matches([with_outlier])[0]
    assert wrist not in outlier_match.rows
    assert len(outlier_match.rows) == 14
    without_wrist.places[wrist] = np.nan
    expected = predicted.matches([without_wrist])[0]
    assert outlier_match.log_density == pytest.approx(expected.log_density + kalman.LOG_OUTLIER)
    np.testing.assert_allclose(predicted.updated(outlier_match).mean, predicted.updated(expected).mean)


@pytest.mark.parametrize("parts", [ARMS, LEGS, (*ARMS, *LEGS)])
def test_exchanged_sides_are_matched_in_their_correct_order(parts):
    order = exchanged(*parts)
    np.testing.assert_array_equal(order[order], np.arange(15))
    names = [JOINT_NAMES[j] for j in order]
    assert names[JOINT_NAMES.index(f"left_{parts[0]}")] == f"right_{parts[0]}"
    assert names[JOINT_NAMES.index("neck")] == "neck"
    state = initial_state(BODY, np.full(15, 0.02))
    correct, swapped = detection(BODY), detection(BODY[order])
    predicted = PredictedView(state, FRONT)
    from_swapped, from_correct = (predicted.updated(predicted.matches([d])[0]).mean for d in (swapped, correct))
    np.testing.assert_allclose(from_swapped, from_correct, atol=0.02)


def test_triangulation_recovers_the_joints():
    views = [DetectorView(camera, np.ones(15, dtype=bool)) for camera in CAMERAS.values()]
    places = np.array([view.places(BODY)[0] for view in views])
    places[0, 3] = places[1, 4] = places[2, 4] = np.nan
    triangulated = triangulate_normalized([view.calibrated for view in views], places)
    assert np.isnan(triangulated[4]).all()
    others = np.arange(15) != 4
    np.testing.assert_allclose(triangulated[others], BODY[others], atol=1e-9)
