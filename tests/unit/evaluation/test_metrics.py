"""The table of metrics: lookup by names of recordings and summaries, aggregation, words."""

import numpy as np
import pytest

from workbench.evaluation.metrics import CALIBRATED, HEADLINE, HEADLINE_ERRORS, METRICS, SECTIONS, row_of

VALUES = [3.0, -4.0, 1.0]


@pytest.mark.parametrize(
    ("name", "heading", "label"),
    [
        ("mpjpe_px", "2-D MPJPE (px)", "expected pose"),
        ("nees_per_dim", "NEES per dimension", ""),
        ("mpjpe_abs_arms_mm", "arms: true error (mm)", "arms"),
        ("mpjpe_abs_offset_corrected_mm", "absolute MPJPE, joint offsets corrected (mm)", ""),
        ("coverage_90_joints_legs", "legs: joints: coverage of 90 % (fraction)", "legs"),
        ("marker_offset_left_elbow_mm", "left elbow: offset of the marker (mm)", "left elbow"),
        ("ess_mean", "effective sample size, mean (particles)", ""),
        ("jump_deg_p99", "largest change of a joint angle, 99th percentile (degrees)", ""),
        ("visible_limbs", "visible limbs", ""),  # of a user's own component
    ],
)
def test_a_name_has_a_heading_and_a_label(name, heading, label):
    row = row_of(name)
    assert (row.name, row.heading, row.label) == (name, heading, label)


@pytest.mark.parametrize(
    ("name", "numbers"),
    [
        ("mpjpe_abs_mm", {"mpjpe_abs_mm": 0.0}),
        ("knee_flexion_rmse_deg", {"knee_flexion_rmse_deg": np.sqrt(26.0 / 3.0)}),
        ("ess", {"ess_mean": 0.0}),
        ("jump_deg", {"jump_deg_mean": 0.0, "jump_deg_p99": 2.96}),
        ("visible_limbs", {"visible_limbs": 0.0}),
        ("n_frames", {}),
    ],
)
def test_frames_are_aggregated_to_the_numbers_of_the_run(name, numbers):
    assert row_of(name).of_run(VALUES) == pytest.approx(numbers)


def test_rows_are_complete_and_unique():
    names = [row.name for row in METRICS]
    assert len(set(names)) == len(names)
    for row in METRICS:
        assert row.title
        assert row.meaning
        assert row.section in SECTIONS
        assert row.plot in ("", None) or row.plot in names
        assert row.better in ("lower", "higher", "") or isinstance(row.better, float)


def test_runs_are_ranked_by_errors_of_joints():
    assert HEADLINE_ERRORS == ("mpjpe_abs_mm", "mpjpe_mm", "mpjpe_px")
    assert CALIBRATED == {"coverage_90": 0.9}
    assert {*HEADLINE_ERRORS, *CALIBRATED} < set(HEADLINE)


def test_a_value_is_stated_with_its_unit():
    assert row_of("mpjpe_px").words(3.14159, 1) == "2-D MPJPE 3.1 px"
    assert row_of("nees_per_dim").words(1.0) == "NEES per dimension 1"
