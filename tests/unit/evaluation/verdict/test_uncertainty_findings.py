"""Thresholds of the findings on uncertainty, observations near the body and convergence, on both sides."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from verdict_scenes import N, scene

from workbench.cameras.camera import plain_camera
from workbench.evaluation.verdict.run_measurements import _depth_std

ONE = scene(1)
CAMERA = plain_camera(640, 480, 500.0, (3.0, 1.0, 2.0), (0.0, 0.0, 1.0), "camera")


def level_of(intact, kind):
    """Return the level of a scene's finding of this kind, "" without one, and the verdict's."""
    verdict = intact.verdict()
    return next((each.level for each in verdict.findings if each.kind == kind), ""), verdict.level


def with_errors(**errors):
    """Return a scene with a ground truth and these metrics in every frame."""
    known = {"mpjpe_abs_mm": 60.0, "mpjpe_mm": 60.0, "mpjpe_px": 2.0, "forearm_width_px": 20.0} | errors
    return replace(ONE, errors={name: np.full(N, value) for name, value in known.items()}, truth_m=np.zeros((N, 3)))


@pytest.mark.parametrize("metric", ["coverage_90", "coverage_90_joints"])
@pytest.mark.parametrize(
    ("coverage", "level"), [(0.61, ""), (0.59, "doubtful"), (0.41, "doubtful"), (0.39, "not usable")]
)
def test_intervals_that_cover_too_little_lower_the_verdict(metric, coverage, level):
    assert level_of(with_errors(**{metric: coverage}), "overconfident") == (level, level or "trustworthy")


@pytest.mark.parametrize(("frame", "level"), [(0, ""), (1, "not usable")])
def test_the_coverage_counts_from_the_frame_after_the_initial_pose_on(frame, level):
    intact = with_errors(coverage_90=np.nan)
    intact.errors["coverage_90"][frame] = 0.1
    assert level_of(intact, "overconfident")[0] == level


def test_the_lower_coverage_of_parameters_and_joints_counts():
    scene_with_both = with_errors(coverage_90=0.9, coverage_90_joints=0.5)
    assert level_of(scene_with_both, "overconfident") == ("doubtful", "doubtful")


@pytest.mark.parametrize(
    ("fraction", "level"), [(0.51, ""), (0.49, "doubtful"), (0.26, "doubtful"), (0.24, "not usable")]
)
def test_observations_far_from_the_body_lower_the_verdict(fraction, level):
    far = replace(ONE, inlier_fraction=fraction)
    assert level_of(far, "observations far from the body") == (level, level or "trustworthy")


@pytest.mark.parametrize(("decrease", "level"), [(0.0, ""), (0.009, ""), (0.011, "doubtful")])
def test_a_fit_whose_cost_still_decreases_has_not_converged(decrease, level):
    assert level_of(replace(ONE, cost_decrease=decrease), "not converged")[0] == level


@pytest.mark.parametrize(
    ("depths_m", "weights", "n_views", "expected_m"),
    [
        ([0.0, 3.0], [0.25, 0.75], 1, 3.0 * np.sqrt(0.25 * 0.75)),
        ([-1.0, 1.0, 4.0], [0.5, 0.25, 0.25], 1, np.sqrt(0.5 * 1.75**2 + 0.25 * 0.25**2 + 0.25 * 3.25**2)),
        ([2.0], [1.0], 1, np.nan),
        ([0.0, 3.0], [0.25, 0.75], 2, np.nan),
    ],
)
def test_the_deviation_of_the_depth_is_that_of_weighted_particles(depths_m, weights, n_views, expected_m):
    poses = np.zeros((len(depths_m), 25))
    poses[:, :3] = np.outer(depths_m, CAMERA.rotation[2]) + 5.0 * CAMERA.rotation[0]
    frame = SimpleNamespace(views=[SimpleNamespace(camera=CAMERA)] * n_views)
    step = SimpleNamespace(frame=frame, poses=poses, log_weights=np.log(weights))
    assert _depth_std(step) == pytest.approx(expected_m, nan_ok=True)
