"""What a posterior says of its own errors, by joint group, and how well that tells them."""

from dataclasses import replace

import numpy as np
import pytest
from single_steps import SKELETON, step_of

from workbench.body.kinematics import joints
from workbench.body.skeleton import POSE_NAMES
from workbench.core.frame import Truth
from workbench.evaluation.step_calibration import area_under_curve, group_errors, spearman, stated_doubt


def test_who_spreads_sideways_by_a_centimetre_doubts_everything_by_as_much():
    poses = np.zeros((400, len(POSE_NAMES)))
    poses[:, 0] = np.repeat([-0.01, 0.01], 200)
    assert stated_doubt(step_of(poses, None), SKELETON) == pytest.approx(
        dict.fromkeys(("doubt_root_mm", "doubt_head_mm", "doubt_arms_mm", "doubt_legs_mm"), 10.0)
    )


def test_an_elbow_that_is_not_known_is_doubted_alone():
    poses = np.zeros((400, len(POSE_NAMES)))
    poses[:, POSE_NAMES.index("left_elbow_flexion")] = np.linspace(0.2, 1.2, 400)
    told = stated_doubt(step_of(poses, None), SKELETON)
    assert told["doubt_arms_mm"] > 5.0
    assert told["doubt_legs_mm"] == told["doubt_root_mm"] == 0.0


def test_errors_by_group_leave_out_what_is_not_known():
    pose = np.zeros((1, len(POSE_NAMES)))
    truth = joints(SKELETON, pose)[0] + [0.0, 0.03, 0.0]
    assert group_errors(step_of(pose, Truth(joints=truth)), SKELETON)["missed_legs_mm"] == pytest.approx(30.0)
    truth[0] = np.nan
    assert "missed_root_mm" not in group_errors(step_of(pose, Truth(joints=truth)), SKELETON)
    assert group_errors(step_of(pose, None), SKELETON) == {}


def test_a_doubt_that_orders_errors_has_a_rank_correlation_and_an_area_of_one():
    stated, errors = np.array([1.0, 2.0, 3.0, 4.0]), np.array([5.0, 20.0, 60.0, 90.0])
    assert spearman(stated, errors) == pytest.approx(1.0)
    assert area_under_curve(stated, errors > 50.0) == 1.0
    assert area_under_curve(-stated, errors > 50.0) == 0.0
    assert np.isnan(area_under_curve(stated, errors > 500.0))
    assert np.isnan(spearman(np.ones(4), errors))


def test_of_many_particles_a_few_tell_the_same():
    rng = np.random.default_rng(0)
    poses = np.zeros((20_000, len(POSE_NAMES)))
    poses[:, :3] = 0.02 * rng.standard_normal((20_000, 3))
    told = stated_doubt(step_of(poses, None), SKELETON)["doubt_root_mm"]
    assert told == pytest.approx(20.0 * np.sqrt(8.0 / np.pi), rel=0.06)
    light = replace(step_of(poses, None), log_weights=np.where(np.arange(20_000) < 10_000, -np.log(1e4), -np.inf))
    moved = poses + np.eye(len(POSE_NAMES))[0] * (np.arange(20_000) >= 10_000)[:, None]  # without any weight
    same = replace(light, poses=moved, expected_pose=light.expected_pose)
    assert stated_doubt(same, SKELETON) == stated_doubt(light, SKELETON)


def test_the_area_counts_pairs():
    rng = np.random.default_rng(0)
    stated, errors = rng.integers(0, 6, 80).astype(float), rng.random(80)
    wrong = errors > 0.6
    pairs = np.sign(stated[wrong][:, None] - stated[~wrong])
    assert area_under_curve(stated, wrong) == pytest.approx(np.mean(0.5 * (pairs + 1.0)))
