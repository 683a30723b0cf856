"""Bands and expected errors of one step against truths whose place in them is known."""

from dataclasses import replace

import numpy as np
import pytest
from single_steps import BODY, SKELETON, standing, step_of

from workbench.body.kinematics import joints
from workbench.body.skeleton import POSE_NAMES
from workbench.core.frame import Truth
from workbench.evaluation.pose_errors import step_errors
from workbench.evaluation.posterior_calibration import expected_calibration_error
from workbench.evaluation.step_calibration import (
    area_under_curve,
    expected_errors,
    group_errors,
    joint_calibration,
    pose_calibration,
    pose_ranks,
    spearman,
)

HEADING, TWIST = SKELETON.dof("root_heading"), SKELETON.dof("left_shoulder_twist")


def drawn(n=4000):
    return standing() + 0.1 * np.random.default_rng(0).normal(size=(n, 25))


@pytest.mark.parametrize("turns", [-51, -1, 1, 51])
def test_whole_turns_are_no_error(turns):
    poses, true = drawn(), standing()
    expected = pose_calibration(step_of(poses, Truth(pose=true)), SKELETON)
    turned = true.copy()
    turned[[HEADING, TWIST]] += 2.0 * np.pi * turns
    found = pose_calibration(step_of(poses, Truth(pose=turned)), SKELETON)
    assert found == pytest.approx(expected, abs=1e-9)
    ranks = [pose_ranks(step_of(poses, Truth(pose=each))) for each in (true, turned)]
    assert ranks[0] == pytest.approx(ranks[1], abs=1e-9)


def test_a_number_in_which_all_agree_counts_where_it_is_wrong():
    poses, true = drawn(), standing()
    poses[:, HEADING] = true[HEADING]  # given
    right = pose_calibration(step_of(poses, Truth(pose=true)), SKELETON)
    assert right["coverage_90"] == 1.0
    assert len(pose_ranks(step_of(poses, Truth(pose=true)))) == 24
    true[HEADING] += 0.2
    wrong = pose_calibration(step_of(poses, Truth(pose=true)), SKELETON)
    assert wrong["coverage_90"] == pytest.approx(24 / 25)
    assert wrong["crps_deg"] > right["crps_deg"]
    assert wrong["nees_per_dim"] == pytest.approx(right["nees_per_dim"])


def test_parameters_that_are_given_count_once_their_true_value_changes():
    poses, initial = drawn(), standing()
    arm = [name for name in SKELETON.dof_names if "right_elbow" in name or "right_shoulder" in name]
    fixed = [i for i, name in enumerate(SKELETON.dof_names) if name not in arm]
    poses[:, fixed] = initial[fixed] + 0.05  # the given initial pose is wrong
    step = step_of(poses, Truth(pose=initial))
    found = step_errors(step, BODY, arm, initial=initial)
    assert found["coverage_90"] == found["coverage_90_arms"] == 1.0
    assert "coverage_90_legs" not in found
    assert "crps_mm" not in found
    assert len(pose_ranks(step)) == len(arm)
    true = initial.copy()
    true[HEADING] += 0.2
    moved = step_errors(step_of(poses, Truth(pose=true)), BODY, arm, initial=initial)
    assert moved["coverage_90"] == pytest.approx(len(arm) / (len(arm) + 1))
    assert moved["coverage_90_root"] == 0.0
    estimated = step_errors(step, BODY, SKELETON.dof_names, initial=initial)  # particles that agree by degeneracy
    assert estimated["coverage_90"] == pytest.approx(len(arm) / 25)


def test_z2_is_the_mean_square_of_the_miss_in_deviations():
    poses, true = drawn(), standing() + 0.3
    found = pose_calibration(step_of(poses, Truth(pose=true)), SKELETON)
    assert found["nees_per_dim"] == pytest.approx(9.0, rel=0.02)


def test_groups_have_coverages_of_their_own():
    true = standing()
    legs = [i for i, name in enumerate(SKELETON.dof_names) if "hip" in name or "knee" in name]
    true[legs] += 5.0 - 2.0 * np.pi
    found = pose_calibration(step_of(drawn(), Truth(pose=true)), SKELETON)
    assert found["coverage_90_legs"] == 0.0
    assert found["coverage_90_arms"] == found["coverage_90_root"] == found["coverage_90_head"] == 1.0
    places = np.full((len(SKELETON.names), 3), np.nan)
    places[SKELETON.joint("left_wrist")] = 100.0
    far = joint_calibration(step_of(drawn(), Truth(joints=places)), SKELETON, places, range(1, 15))
    assert far["coverage_90_joints_arms"] == 0.0
    assert "coverage_90_joints_legs" not in far


def test_the_calibration_error_of_even_ranks_is_nothing_and_of_ends_a_half():
    assert expected_calibration_error((np.arange(1000) + 0.5) / 1000) == pytest.approx(0.0, abs=2e-3)
    assert expected_calibration_error(np.array([0.0, 1.0])) == pytest.approx(0.5)
    assert expected_calibration_error(np.array([0.5])) == pytest.approx(0.5)


def test_who_spreads_sideways_by_a_centimetre_doubts_everything_by_as_much():
    poses = np.zeros((400, len(POSE_NAMES)))
    poses[:, 0] = np.repeat([-0.01, 0.01], 200)
    assert expected_errors(step_of(poses, None), SKELETON) == pytest.approx(
        dict.fromkeys(
            ("expected_error_root_mm", "expected_error_head_mm", "expected_error_arms_mm", "expected_error_legs_mm"),
            10.0,
        )
    )


def test_an_elbow_that_is_not_known_is_doubted_alone():
    poses = np.zeros((400, len(POSE_NAMES)))
    poses[:, POSE_NAMES.index("left_elbow_flexion")] = np.linspace(0.2, 1.2, 400)
    told = expected_errors(step_of(poses, None), SKELETON)
    assert told["expected_error_arms_mm"] > 5.0
    assert told["expected_error_legs_mm"] == told["expected_error_root_mm"] == 0.0


def test_errors_by_group_leave_out_what_is_not_known():
    pose = np.zeros((1, len(POSE_NAMES)))
    truth = joints(SKELETON, pose)[0] + [0.0, 0.03, 0.0]
    assert group_errors(step_of(pose, Truth(joints=truth)), SKELETON)["mpjpe_abs_legs_mm"] == pytest.approx(30.0)
    truth[0] = np.nan
    assert "mpjpe_abs_root_mm" not in group_errors(step_of(pose, Truth(joints=truth)), SKELETON)
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
    told = expected_errors(step_of(poses, None), SKELETON)["expected_error_root_mm"]
    assert told == pytest.approx(20.0 * np.sqrt(8.0 / np.pi), rel=0.06)
    light = replace(step_of(poses, None), log_weights=np.where(np.arange(20_000) < 10_000, -np.log(1e4), -np.inf))
    moved = poses + np.eye(len(POSE_NAMES))[0] * (np.arange(20_000) >= 10_000)[:, None]  # without any weight
    same = replace(light, poses=moved, expected_pose=light.expected_pose)
    assert expected_errors(same, SKELETON) == expected_errors(light, SKELETON)


def test_the_area_counts_pairs():
    rng = np.random.default_rng(0)
    stated, errors = rng.integers(0, 6, 80).astype(float), rng.random(80)
    wrong = errors > 0.6
    pairs = np.sign(stated[wrong][:, None] - stated[~wrong])
    assert area_under_curve(stated, wrong) == pytest.approx(np.mean(0.5 * (pairs + 1.0)))
