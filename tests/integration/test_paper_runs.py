"""Experiments with the literal settings of their papers, at small size and without recordings."""

import numpy as np
import pytest

SMALL = ("dataset.n_frames=4", "inference.n_particles=40")
POINTS = (*SMALL, "dataset.n_points=150")
WALKER = ("dataset.motion=builtin", "prior.motions=builtin", "prior.exclude=[]")
RUNS = {
    "walk_straight": SMALL,
    "walk_circle": SMALL,
    "walk_prior_only": SMALL,
    "arm_twist": SMALL,
    "walk_cyclic": SMALL,
    "body_implicit": (*SMALL, *WALKER),
    "body_smooth": (*SMALL, "dataset.motion=builtin"),
    "arm_smooth_300": (*SMALL, "dataset.motion=builtin"),
    "synthesize_run": (*SMALL[:1], *WALKER),
    "points_no_model": POINTS,
    "points_walk_steady": POINTS,
    "points_run_variable": POINTS,
    "stereo_walk": (*SMALL, "dataset.n_points=150"),
}
FAST = ("walk_straight", "points_walk_steady")


@pytest.mark.parametrize(
    "experiment", [pytest.param(name, marks=() if name in FAST else pytest.mark.slow) for name in RUNS]
)
def test_an_experiment_runs_with_the_literal_settings_of_its_paper(cache, summary_of, experiment):
    summary = summary_of(cache, f"experiment={experiment}", "paper=literal", *RUNS[experiment])
    assert summary["status"] == "complete"
    errors = [value for name, value in summary["metrics"].items() if name in ("mpjpe_abs_mm", "jump_deg_mean")]
    assert np.isfinite(errors).all()
    assert errors


def test_the_coverage_of_an_arm_experiment_is_that_of_the_arms(cache, summary_of):
    """The other parameters are fixed at the perturbed initial pose."""
    metrics = summary_of(cache, "experiment=arm_twist", *SMALL)["metrics"]
    assert {name for name in metrics if name.startswith("coverage_90_")} == {"coverage_90_arms"}
    assert metrics["coverage_90"] == metrics["coverage_90_arms"]
