"""The experiments on points, from their names, at small size and without recordings."""

import pytest

from workbench.recording.read.reader import read

ALIKE = ("points_walk_variable", "points_run_steady", "points_run_variable", "stereo_walk")
FITTED = ["points_walk_steady", "points_transition", *(pytest.param(name, marks=pytest.mark.slow) for name in ALIKE)]


@pytest.mark.parametrize("experiment", FITTED)
def test_a_fit_follows_the_person_from_an_automatic_start(cache, summary_of, tmp_path, experiment):
    small = ("prior.n_components=4", "dataset.n_points=200", "inference.n_particles=40")
    summary = summary_of(cache, f"experiment={experiment}", "dataset.n_frames=20", *small)
    metrics = summary["metrics"]
    assert summary["status"] == "complete"
    # generated people whose model was learned from others: a body is about as thick as these bounds
    assert metrics["error_abs_mm"] < 60.0
    assert metrics["knee_deg"] < 15.0
    assert metrics["hip_deg"] < 15.0
    assert {"iterations", "ms_per_frame", "jacobian_cost_ratio", "activity_accuracy"} <= metrics.keys()
    found = read(tmp_path / "out" / "run.rrd")
    assert found.poses[1].shape == (20, 25)
    assert "ms_per_frame" not in found.properties["metrics"]  # equal runs must give equal recordings
