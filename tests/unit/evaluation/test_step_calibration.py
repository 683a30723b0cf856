"""Bands of one step against truths whose place in them is known."""

import numpy as np
import pytest
from single_steps import SKELETON, standing, step_of

from workbench.core.frame import Truth
from workbench.evaluation.posterior_calibration import expected_calibration_error
from workbench.evaluation.step_calibration import joint_calibration, pose_calibration, pose_ranks

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
    assert wrong["z2"] == pytest.approx(right["z2"])


def test_z2_is_the_mean_square_of_the_miss_in_deviations():
    poses, true = drawn(), standing() + 0.3
    found = pose_calibration(step_of(poses, Truth(pose=true)), SKELETON)
    assert found["z2"] == pytest.approx(9.0, rel=0.02)


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
