"""Experiments on points, on keypoints and with several image cues, at small size and without recordings."""

import numpy as np
import pytest

from workbench.recording.read.reader import read


@pytest.mark.slow
def test_a_fit_from_an_automatic_initialization_tracks_the_person(cache, summary_of, tmp_path):
    """The numbers of the other experiments on points and on keypoints are those of the baselines."""
    small = ("prior.n_components=4", "dataset.n_points=200", "inference.n_particles=40")
    summary = summary_of(cache, "experiment=points_transition", "dataset.n_frames=20", *small)
    metrics = summary["metrics"]
    assert summary["status"] == "complete"
    # the model is learned from other generated people: the bounds are about the thickness of a body
    assert metrics["mpjpe_abs_mm"] < 60.0
    assert metrics["knee_flexion_rmse_deg"] < 15.0
    assert metrics["hip_flexion_rmse_deg"] < 15.0
    assert {"iterations", "ms_per_frame", "jacobian_cost_ratio", "activity_accuracy"} <= metrics.keys()
    recording = read(tmp_path / "out" / "run.rrd")
    assert recording.poses[1].shape == (20, 25)
    assert "ms_per_frame" not in recording.properties["metrics"]  # identical runs have identical recordings


SMALL = ("dataset.n_frames=5", "inference.n_particles=200", "dataset.width=160", "dataset.height=120")
SMALL += ("dataset.person_px=80", "dataset.focal_px=175", "likelihood=product")
SMALL += ("experiment=walk_straight",)
CUES = ("image_motion", "background", "appearance")


@pytest.mark.slow
def test_the_variance_fractions_of_the_cues_are_recorded_per_frame(run):
    without_edges = "likelihood.weights.edges=0"  # their model is learned from rendered people
    code, output, folder = run("out", *SMALL, without_edges)
    assert code == 0, output
    recording = read(folder / "run.rrd")
    fractions = np.array([recording.metric(f"variance_fraction_{cue}")[1] for cue in CUES])
    assert fractions.shape == (3, 5)
    np.testing.assert_allclose(fractions.sum(axis=0), [0.0, 1.0, 1.0, 1.0, 1.0], atol=1e-9)  # not frame 0
    assert (np.abs(fractions).mean(axis=1) > 0.01).all()
    assert "variance_fraction_edges" not in recording.metric_names

    code, output, repeated = run("repeated", *SMALL, without_edges, "n_threads=1")
    assert code == 0, output
    np.testing.assert_array_equal(read(repeated / "run.rrd").poses[1], recording.poses[1])


@pytest.mark.slow  # renders people to learn from
def test_the_edge_model_is_learned_once(run, tmp_path):
    empty_cache = f"paths.cache={tmp_path / 'cache'}"
    for folder in ("first", "second"):
        code, output, _ = run(folder, *SMALL, empty_cache, *(f"likelihood.weights.{cue}=0" for cue in CUES))
        assert code == 0, output
        assert ("learning edges" in output) == (folder == "first")
