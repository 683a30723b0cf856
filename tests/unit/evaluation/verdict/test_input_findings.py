"""Findings on keypoints, points and jumps, and their thresholds on both sides."""

from dataclasses import replace

import numpy as np
import pytest
from verdict_scenes import RATE_HZ, N, point_scene, scene

from workbench.evaluation.verdict.time_findings import _jumps

ONE, TWO, POINTS = scene(1), scene(2), point_scene()


def levels(intact):
    """Return the levels of a scene's findings by kind."""
    return {finding.kind: finding.level for finding in intact.verdict().findings}


def sized(low_m, high_m, along=2):
    """Return the scene of points whose middle 90 % extend from low_m to high_m along an axis, 0.3 m along others."""
    points = np.tile(np.linspace(0.0, 0.3 / 0.9, 101)[:, None], (1, 3))
    points[:, along] = np.linspace(low_m, high_m, 101) / 0.9
    return replace(POINTS, points=np.tile(points, (N, 1, 1)))


@pytest.mark.parametrize(
    ("extent_m", "kind"),
    [(0.39, "height mismatch"), (0.41, None), (2.49, None), (2.51, "height mismatch"), (170.0, "unit of length")],
)
def test_points_extend_over_a_persons_size(extent_m, kind):
    found = levels(sized(0.0, extent_m))
    assert {"height mismatch", "unit of length"} & set(found) == ({kind} if kind else set())


@pytest.mark.parametrize(("extent_m", "lies"), [(0.44, False), (0.46, True)])
def test_points_that_extend_farther_along_another_axis_lie(extent_m, lies):
    assert (levels(sized(0.0, extent_m, along=0)).get("vertical") == "doubtful") == lies


@pytest.mark.parametrize(("n_joints", "few"), [(7, False), (6, True)])
def test_half_of_the_joints_must_be_observed(n_joints, few):
    keypoints = ONE.keypoints.copy()
    keypoints[:, :, 1 : 15 - n_joints] = np.nan
    assert ("too few observations" in levels(replace(ONE, keypoints=keypoints))) == few


@pytest.mark.parametrize(("n_missing", "few"), [(30, False), (31, True)])
def test_half_of_a_cameras_frames_with_the_person_must_have_keypoints(n_missing, few):
    keypoints = TWO.keypoints.copy()
    keypoints[1, np.linspace(0, N - 1, n_missing).astype(int)] = np.nan
    text = replace(TWO, keypoints=keypoints).verdict().message
    assert ("c1 has keypoints in" in text) == few


@pytest.mark.parametrize(("factor", "is_jump"), [(4.9, False), (5.1, True)])
def test_a_jump_is_five_times_the_motion_around(factor, is_jump):
    steps = np.full(30, 0.1)
    steps[15] = factor * 0.1
    assert (_jumps(steps, np.arange(30) / RATE_HZ) == [15]) == is_jump


@pytest.mark.parametrize(("factor", "is_wrong"), [(1.019, False), (1.021, True), (0.981, False), (0.979, True)])
def test_a_rate_may_differ_by_two_percent(factor, is_wrong):
    other = replace(ONE, inputs=replace(ONE.inputs, source_rate_hz=factor * RATE_HZ))
    assert ("frame-rate mismatch" in levels(other)) == is_wrong
    other = replace(ONE, times_s=factor * ONE.times_s)
    assert ("frame-rate mismatch" in levels(other)) == is_wrong
