"""The filter over a person's joints, against the densities it stands for."""

import numpy as np
import pytest
from crowd_scenes import CAMERAS, walkers
from scipy.linalg import expm
from scipy.stats import multivariate_normal

from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.association import keypoint_kalman as beliefs
from workbench.datasets.association.detections import Detection, DetectorView, triangulate_places
from workbench.datasets.association.keypoint_kalman import ARMS, LEGS, PredictedView, exchanged, initial_state, predict

FRONT = DetectorView(CAMERAS["front"], np.ones(15, dtype=bool))
BODY = walkers([((0.0, 0.0), (1.0, 0.0))], 1)[0][0]


def seen(joints, sigma_m=0.03):
    return Detection(FRONT.places(joints)[0], np.full(15, sigma_m), np.zeros(15, dtype=bool))


def test_prediction_is_that_of_the_process_it_stands_for():
    """By the matrix exponential of dx = v dt, dv = −v/τ dt + noise (Van Loan 1978), and in two steps as in one."""
    belief = predict(initial_state(BODY, np.full(15, 0.1)), 0.2)
    drift = np.array([[0.0, 1.0], [0.0, -1.0 / beliefs.TAU_S]])
    noise = np.array([[0.0, 0.0], [0.0, 2.0 / beliefs.TAU_S]])  # which keeps a variance of 1 at rest
    both = expm(np.block([[-drift, noise], [np.zeros((2, 2)), drift.T]]) * 0.2)
    moves, added = both[2:, 2:].T, both[2:, 2:].T @ both[:2, 2:]
    for joint in (JOINT_NAMES.index("left_wrist"), JOINT_NAMES.index("neck")):
        variance = beliefs.INDIVIDUAL_M_S[joint] ** 2 + beliefs.WALKING_M_S**2
        expected = moves @ np.diag([0.1**2, variance]) @ moves.T + variance * added
        place = np.array([3 * joint, 45 + 3 * joint])
        np.testing.assert_allclose(belief.covariance[np.ix_(place, place)], expected, rtol=1e-9)
    twice = predict(predict(initial_state(BODY, np.full(15, 0.1)), 0.15), 0.05)
    np.testing.assert_allclose(twice.covariance, belief.covariance, rtol=1e-9, atol=1e-12)


def test_a_match_has_the_density_of_the_joints_together():
    belief = initial_state(BODY, np.full(15, 0.1))
    shifted = BODY + np.array([0.0, 0.05, 0.02])
    match = PredictedView(belief, FRONT).match(seen(shifted))
    places, slopes, depth = FRONT.project(BODY)
    off = (FRONT.places(shifted)[0] - places) * depth[:, None]
    slopes = slopes * depth[:, None, None]
    expected = sum(
        multivariate_normal.logpdf(off[j], cov=0.01 * slopes[j] @ slopes[j].T + 0.03**2 * np.eye(2)) for j in range(15)
    )
    assert match.log_density == pytest.approx(expected)
    assert len(match.rows) == 15


def test_what_is_seen_again_and_again_is_believed():
    belief = initial_state(BODY, np.full(15, 0.3))
    there = BODY + np.array([0.0, 0.2, 0.1])
    for _ in range(20):
        for camera in CAMERAS.values():
            eye = DetectorView(camera, np.ones(15, dtype=bool))
            expected = PredictedView(belief, eye)
            belief = expected.updated(
                expected.match(Detection(eye.places(there)[0], np.full(15, 0.03), np.zeros(15, dtype=bool)))
            )
    np.testing.assert_allclose(belief.joints, there, atol=5e-3)
    assert (np.linalg.eigvalsh(belief.covariance) > -1e-12).all()


def test_joints_astray_cost_what_is_agreed_and_move_nothing():
    belief = predict(initial_state(BODY, np.full(15, 0.02)), 1 / 30)
    expected = PredictedView(belief, FRONT)
    right, wrong = seen(BODY), seen(BODY)
    wrist = JOINT_NAMES.index("left_wrist")
    wrong.places[wrist] += 0.2
    match = expected.match(wrong)
    assert wrist not in match.rows
    assert len(match.rows) == 14
    right.places[wrist] = np.nan
    assert match.log_density == pytest.approx(expected.match(right).log_density + beliefs.LOG_OUTLIER)
    np.testing.assert_allclose(expected.updated(match).mean, expected.updated(expected.match(right)).mean)


@pytest.mark.parametrize("parts", [ARMS, LEGS, (*ARMS, *LEGS)])
def test_exchanged_sides_are_known_for_what_they_are(parts):
    order = exchanged(*parts)
    np.testing.assert_array_equal(order[order], np.arange(15))
    names = [JOINT_NAMES[j] for j in order]
    assert names[JOINT_NAMES.index(f"left_{parts[0]}")] == f"right_{parts[0]}"
    assert names[JOINT_NAMES.index("neck")] == "neck"
    belief = initial_state(BODY, np.full(15, 0.02))
    plain, other = seen(BODY), seen(BODY[order])
    expected = PredictedView(belief, FRONT)
    np.testing.assert_allclose(
        expected.updated(expected.match(other)).mean, expected.updated(expected.match(plain)).mean, atol=0.02
    )


def test_rays_meet_where_they_came_from():
    eyes = [DetectorView(camera, np.ones(15, dtype=bool)) for camera in CAMERAS.values()]
    places = np.array([eye.places(BODY)[0] for eye in eyes])
    places[0, 3] = places[1, 4] = places[2, 4] = np.nan
    met, n_rays = triangulate_places(eyes, places)
    assert n_rays[[3, 4, 5]].tolist() == [2, 1, 3]
    assert np.isnan(met[4]).all()
    others = np.arange(15) != 4
    np.testing.assert_allclose(met[others], BODY[others], atol=1e-9)
