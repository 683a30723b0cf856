"""Experiments on points, keypoints and several image cues, at small size and without recordings."""

import numpy as np
import pytest

from workbench.recording.read.reader import read

ALIKE = ("points_walk_variable", "points_run_steady", "points_run_variable", "stereo_walk")
FITTED = ["points_walk_steady", "points_transition", *(pytest.param(name, marks=pytest.mark.slow) for name in ALIKE)]


@pytest.mark.parametrize("experiment", FITTED)
@pytest.mark.slow
def test_a_fit_follows_the_person_from_an_automatic_start(cache, summary_of, tmp_path, experiment):
    small = ("prior.n_components=4", "dataset.n_points=200", "inference.n_particles=40")
    summary = summary_of(cache, f"experiment={experiment}", "dataset.n_frames=20", *small)
    metrics = summary["metrics"]
    assert summary["status"] == "complete"
    # generated people whose model was learned from others: a body is about as thick as these bounds
    assert metrics["mpjpe_abs_mm"] < 60.0
    assert metrics["knee_flexion_rmse_deg"] < 15.0
    assert metrics["hip_flexion_rmse_deg"] < 15.0
    assert {"iterations", "ms_per_frame", "jacobian_cost_ratio", "activity_accuracy"} <= metrics.keys()
    found = read(tmp_path / "out" / "run.rrd")
    assert found.poses[1].shape == (20, 25)
    assert "ms_per_frame" not in found.properties["metrics"]  # equal runs must give equal recordings


STEADY = "inference.problem={_target_: workbench.inference.least_squares.motion_fit.MotionFit, frames_per_style: null}"


@pytest.mark.slow
def test_a_generated_walk_is_found_in_noisy_keypoints(summary_of, tmp_path):
    small = ("dataset.n_frames=10", "prior.n_components=4", "prior.activities=[walk]", "inference.n_particles=30")
    summary = summary_of(tmp_path, "experiment=walk_keypoints_synthetic", STEADY, *small)
    metrics = summary["metrics"]
    assert summary["status"] == "complete"
    # noise of 4 px is 2.5 cm where the person is 270 px tall; the frames' means are better
    assert metrics["mpjpe_px"] < 4.0
    assert metrics["mpjpe_mm"] < 40.0
    assert read(tmp_path / "out" / "run.rrd").poses[1].shape == (10, 25)


@pytest.mark.slow
def test_the_whole_experiment(summary_of, tmp_path):
    metrics = summary_of(tmp_path, "experiment=walk_keypoints_synthetic")["metrics"]
    assert metrics["mpjpe_px"] < 3.0
    assert metrics["mpjpe_mm"] < 30.0
    assert np.isfinite(metrics["knee_flexion_rmse_deg"])


SMALL = ("dataset.n_frames=5", "inference.n_particles=200", "dataset.width=160", "dataset.height=120")
SMALL += ("dataset.person_px=80", "dataset.focal_px=175", "likelihood=product")
SMALL += ("experiment=walk_straight",)
CUES = ("image_motion", "background", "appearance")


@pytest.mark.slow
def test_the_shares_of_the_cues_are_recorded_frame_by_frame(run):
    switched_off = "likelihood.weights.edges=0"  # so that nothing has to be learned from rendered people
    code, told, folder = run("out", *SMALL, switched_off)
    assert code == 0, told
    recorded = read(folder / "run.rrd")
    shares = np.array([recorded.metric(f"variance_fraction_{cue}")[1] for cue in CUES])
    assert shares.shape == (3, 5)
    np.testing.assert_allclose(shares.sum(axis=0), [0.0, 1.0, 1.0, 1.0, 1.0], atol=1e-9)  # the first frame is given
    assert (np.abs(shares).mean(axis=1) > 0.01).all()  # every cue has its say
    assert "variance_fraction_edges" not in recorded.metric_names

    code, told, again = run("again", *SMALL, switched_off, "n_threads=1")
    assert code == 0, told
    np.testing.assert_array_equal(read(again / "run.rrd").poses[1], recorded.poses[1])


@pytest.mark.slow  # it renders people to learn from
def test_edges_are_learned_once(run, tmp_path):
    own = f"paths.cache={tmp_path / 'cache'}"
    for folder in ("out", "again"):
        code, told, _ = run(folder, *SMALL, own, *(f"likelihood.weights.{cue}=0" for cue in CUES))
        assert code == 0, told
        assert ("learning edges" in told) == (folder == "out")
