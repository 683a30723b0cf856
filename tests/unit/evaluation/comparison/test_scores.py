"""Scores of joints against plain computations of each."""

import numpy as np
import pytest

from workbench.body.skeleton import JOINT_NAMES
from workbench.evaluation.comparison.scores import PCK_M, frame_scores

TIMES_S = np.arange(6) / 30.0
NONE = np.empty((0, 6, 15, 3))


@pytest.fixture
def motions():
    rng = np.random.default_rng(0)
    truth = rng.standard_normal((6, 15, 3))
    return truth + 0.1 * rng.standard_normal(truth.shape), truth


def test_means_are_over_the_joints_without_the_pelvis(motions):
    estimate, truth = motions
    scores = frame_scores(JOINT_NAMES, TIMES_S, estimate, truth, NONE).scores
    pelvis = JOINT_NAMES.index("pelvis")
    others = [k for k in range(15) if k != pelvis]
    distances = np.linalg.norm(estimate - truth, axis=2)[:, others]
    np.testing.assert_allclose(scores["mpjpe"], 1e3 * distances.mean(axis=1))
    np.testing.assert_allclose(scores["pck_150"], 100.0 * (distances < PCK_M).mean(axis=1))
    thresholds = np.linspace(0.0, PCK_M, 20_001)
    area = [np.trapezoid([(row < level).mean() for level in thresholds], thresholds) / PCK_M for row in distances]
    np.testing.assert_allclose(scores["auc_150"], 100.0 * np.array(area), atol=0.01)
    relative = (estimate - estimate[:, [pelvis]]) - (truth - truth[:, [pelvis]])
    np.testing.assert_allclose(scores["mpjpe_root"], 1e3 * np.linalg.norm(relative, axis=2)[:, others].mean(axis=1))
    acceleration = np.diff(estimate - truth, 2, axis=0)[:, others] * 30.0**2
    np.testing.assert_allclose(scores["acceleration"][1:-1], np.linalg.norm(acceleration, axis=2).mean(axis=1))
    assert np.isnan(scores["acceleration"][[0, -1]]).all()


def test_missing_joints_are_counted_and_left_out(motions):
    estimate, truth = (each.copy() for each in motions)
    knee, wrist = JOINT_NAMES.index("left_knee"), JOINT_NAMES.index("left_wrist")
    estimate[2, knee] = np.nan
    truth[2, wrist] = np.nan  # an unknown truth is not a missing estimate
    scores = frame_scores(JOINT_NAMES, TIMES_S, estimate, truth, NONE).scores
    distances = np.linalg.norm(estimate - truth, axis=2)[2, 1:]
    assert scores["missing"][2] == pytest.approx(100.0 / 13.0)
    assert scores["missing"][1] == 0.0
    assert scores["mpjpe"][2] == pytest.approx(1e3 * np.nanmean(distances))


def test_procrustes_ignores_a_similarity(motions):
    _, truth = motions
    moved = 1.2 * truth[..., [1, 2, 0]] + 3.0
    np.testing.assert_allclose(
        frame_scores(JOINT_NAMES, TIMES_S, moved, truth, NONE).scores["pa_mpjpe"], 0.0, atol=1e-9
    )


def test_the_knee_s_angle_is_zero_where_the_leg_is_straight():
    places = np.zeros((3, 15, 3))
    hip, knee, ankle = (JOINT_NAMES.index(f"left_{name}") for name in ("hip", "knee", "ankle"))
    places[:, hip, 2], places[:, knee, 2] = 0.9, 0.5
    for k, flexion in enumerate(np.radians([0.0, 30.0, 100.0])):
        places[k, ankle] = places[k, knee] + 0.4 * np.array([-np.sin(flexion), 0.0, -np.cos(flexion)])
    straight = places[[0, 0, 0]]
    own, true = frame_scores(JOINT_NAMES, TIMES_S[:3], places, straight, NONE[:, :3]).angles_deg["left_knee"]
    np.testing.assert_allclose(own, [0.0, 30.0, 100.0], atol=1e-6)
    np.testing.assert_allclose(true, 0.0, atol=1e-6)


def test_intervals_cover_a_truth_of_the_same_distribution():
    rng = np.random.default_rng(3)
    centres = rng.standard_normal((200, 15, 3))
    truth, samples = centres + rng.standard_normal(centres.shape), centres + rng.standard_normal((400, *centres.shape))
    scores = frame_scores(JOINT_NAMES, np.arange(200) / 30.0, centres, truth, samples).scores
    assert scores["coverage_90"].mean() == pytest.approx(90.0, abs=1.5)
    assert scores["crps"].mean() == pytest.approx(1e3 / np.sqrt(np.pi), rel=0.02)  # half the mean distance of two draws
