"""Coverage, ranks and expected errors of one step against truths at known quantiles."""

from dataclasses import replace

import numpy as np
import pytest
from single_steps import BODY, SKELETON, standing, step_of

from workbench.body.kinematics import joints
from workbench.body.skeleton import POSE_NAMES
from workbench.core.frame import Truth
from workbench.evaluation.errors.pose_errors import step_errors
from workbench.evaluation.uncertainty.posterior_calibration import expected_calibration_error
from workbench.evaluation.uncertainty.step_calibration import (
    _FIXED_TOLERANCE,
    area_under_curve,
    expected_errors,
    given_parameters,
    group_errors,
    joint_calibration,
    pose_calibration,
    pose_ranks,
    spearman,
)

HEADING, TWIST = SKELETON.dof("root_heading"), SKELETON.dof("left_shoulder_twist")


def sampled_poses(n=4000):
    return standing() + 0.1 * np.random.default_rng(0).normal(size=(n, 25))


@pytest.mark.parametrize("turns", [-51, -1, 1, 51])
def test_calibration_is_invariant_to_full_turns(turns):
    poses, true = sampled_poses(), standing()
    expected = pose_calibration(step_of(poses, Truth(pose=true)), SKELETON)
    turned = true.copy()
    turned[[HEADING, TWIST]] += 2.0 * np.pi * turns
    calibration = pose_calibration(step_of(poses, Truth(pose=turned)), SKELETON)
    assert calibration == pytest.approx(expected, abs=1e-9)
    ranks = [pose_ranks(step_of(poses, Truth(pose=pose))) for pose in (true, turned)]
    assert ranks[0] == pytest.approx(ranks[1], abs=1e-9)


def test_a_parameter_without_spread_counts_where_it_is_wrong():
    poses, true = sampled_poses(), standing()
    poses[:, HEADING] = true[HEADING]  # without spread
    correct = pose_calibration(step_of(poses, Truth(pose=true)), SKELETON)
    assert correct["coverage_90"] == 1.0
    assert len(pose_ranks(step_of(poses, Truth(pose=true)))) == 24
    true[HEADING] += 0.2
    wrong = pose_calibration(step_of(poses, Truth(pose=true)), SKELETON)
    assert wrong["coverage_90"] == pytest.approx(24 / 25)
    assert wrong["crps_deg"] > correct["crps_deg"]
    assert wrong["nees_per_dim"] == pytest.approx(correct["nees_per_dim"])


def test_fixed_parameters_count_once_their_true_value_changes():
    poses, initial = sampled_poses(), standing()
    arm = [name for name in SKELETON.dof_names if "right_elbow" in name or "right_shoulder" in name]
    fixed = [i for i, name in enumerate(SKELETON.dof_names) if name not in arm]
    poses[:, fixed] = initial[fixed] + 0.05  # the initial pose is wrong
    step = step_of(poses, Truth(pose=initial))
    errors = step_errors(step, BODY, arm, initial=initial)
    assert errors["coverage_90"] == errors["coverage_90_arms"] == 1.0
    assert "coverage_90_legs" not in errors
    assert "crps_mm" not in errors
    assert len(pose_ranks(step)) == len(arm)
    true = initial.copy()
    true[HEADING] += 0.2
    moved = step_errors(step_of(poses, Truth(pose=true)), BODY, arm, initial=initial)
    assert moved["coverage_90"] == pytest.approx(len(arm) / (len(arm) + 1))
    assert moved["coverage_90_root"] == 0.0
    changes = np.where(np.arange(25) % 2, _FIXED_TOLERANCE, np.nextafter(_FIXED_TOLERANCE, 1.0))
    given = [i for i in fixed if i % 2]
    for change in (changes, -changes):
        assert np.flatnonzero(given_parameters(SKELETON, arm, change, np.zeros(25))).tolist() == given
    estimated = step_errors(step, BODY, SKELETON.dof_names, initial=initial)  # degenerate particles
    assert estimated["coverage_90"] == pytest.approx(len(arm) / 25)


def test_nees_per_dim_is_the_mean_squared_standardized_error():
    poses, true = sampled_poses(), standing() + 0.3
    calibration = pose_calibration(step_of(poses, Truth(pose=true)), SKELETON)
    assert calibration["nees_per_dim"] == pytest.approx(9.0, rel=0.02)


def test_coverage_is_computed_per_joint_group():
    true = standing()
    legs = [i for i, name in enumerate(SKELETON.dof_names) if "hip" in name or "knee" in name]
    true[legs] += 5.0 - 2.0 * np.pi
    errors = pose_calibration(step_of(sampled_poses(), Truth(pose=true)), SKELETON)
    assert errors["coverage_90_legs"] == 0.0
    assert errors["coverage_90_arms"] == errors["coverage_90_root"] == errors["coverage_90_head"] == 1.0
    positions = np.full((len(SKELETON.names), 3), np.nan)
    positions[SKELETON.joint("left_wrist")] = 100.0
    far = joint_calibration(step_of(sampled_poses(), Truth(joints=positions)), SKELETON, positions, range(1, 15))
    assert far["coverage_90_joints_arms"] == 0.0
    assert "coverage_90_joints_legs" not in far


def test_the_calibration_error_is_zero_for_uniform_ranks_and_a_half_for_extreme_ones():
    assert expected_calibration_error((np.arange(1000) + 0.5) / 1000) == pytest.approx(0.0, abs=2e-3)
    assert expected_calibration_error(np.array([0.0, 1.0])) == pytest.approx(0.5)
    assert expected_calibration_error(np.array([0.5])) == pytest.approx(0.5)


def test_a_spread_of_the_root_by_a_centimetre_is_the_expected_error_of_all_groups():
    poses = np.zeros((400, len(POSE_NAMES)))
    poses[:, 0] = np.repeat([-0.01, 0.01], 200)
    names = [f"expected_error_{group}_mm" for group in ("root", "head", "arms", "legs")]
    assert expected_errors(step_of(poses, None), SKELETON) == pytest.approx(dict.fromkeys(names, 10.0))


def test_a_spread_of_an_elbow_is_an_expected_error_of_the_arms_alone():
    poses = np.zeros((400, len(POSE_NAMES)))
    poses[:, POSE_NAMES.index("left_elbow_flexion")] = np.linspace(0.2, 1.2, 400)
    errors = expected_errors(step_of(poses, None), SKELETON)
    assert errors["expected_error_arms_mm"] > 5.0
    assert errors["expected_error_legs_mm"] == errors["expected_error_root_mm"] == 0.0


def test_errors_by_group_ignore_unknown_joints():
    pose = np.zeros((1, len(POSE_NAMES)))
    truth = joints(SKELETON, pose)[0] + [0.0, 0.03, 0.0]
    assert group_errors(step_of(pose, Truth(joints=truth)), SKELETON)["mpjpe_abs_legs_mm"] == pytest.approx(30.0)
    truth[0] = np.nan
    assert "mpjpe_abs_root_mm" not in group_errors(step_of(pose, Truth(joints=truth)), SKELETON)
    assert group_errors(step_of(pose, None), SKELETON) == {}


def test_expected_errors_in_the_order_of_errors_have_correlation_and_area_one():
    expected, errors = np.array([1.0, 2.0, 3.0, 4.0]), np.array([5.0, 20.0, 60.0, 90.0])
    assert spearman(expected, errors) == pytest.approx(1.0)
    assert area_under_curve(expected, errors > 50.0) == 1.0
    assert area_under_curve(-expected, errors > 50.0) == 0.0
    assert np.isnan(area_under_curve(expected, errors > 500.0))
    assert np.isnan(spearman(np.ones(4), errors))


def test_expected_errors_of_many_particles_are_estimated_from_weighted_samples():
    rng = np.random.default_rng(0)
    poses = np.zeros((20_000, len(POSE_NAMES)))
    poses[:, :3] = 0.02 * rng.standard_normal((20_000, 3))
    error_mm = expected_errors(step_of(poses, None), SKELETON)["expected_error_root_mm"]
    assert error_mm == pytest.approx(20.0 * np.sqrt(8.0 / np.pi), rel=0.06)
    half = replace(step_of(poses, None), log_weights=np.where(np.arange(20_000) < 10_000, -np.log(1e4), -np.inf))
    moved = poses + np.eye(len(POSE_NAMES))[0] * (np.arange(20_000) >= 10_000)[:, None]  # of weight zero
    shifted = replace(half, poses=moved, expected_pose=half.expected_pose)
    assert expected_errors(shifted, SKELETON) == expected_errors(half, SKELETON)


def test_the_area_under_the_curve_is_the_fraction_of_ordered_pairs():
    rng = np.random.default_rng(0)
    expected, errors = rng.integers(0, 6, 80).astype(float), rng.random(80)
    large = errors > 0.6
    pairs = np.sign(expected[large][:, None] - expected[~large])
    assert area_under_curve(expected, large) == pytest.approx(np.mean(0.5 * (pairs + 1.0)))
