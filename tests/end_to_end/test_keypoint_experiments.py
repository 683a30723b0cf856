"""The experiments on keypoints, from their names, at small size and without recordings."""

import numpy as np
import pytest

from workbench.recording.read.reader import read

STEADY = "inference.problem={_target_: workbench.inference.least_squares.motion_fit.MotionFit, frames_per_style: null}"


def test_a_generated_walk_is_found_in_noisy_keypoints(summary_of, tmp_path):
    small = ("dataset.n_frames=10", "prior.n_components=4", "prior.activities=[walk]", "inference.n_particles=30")
    summary = summary_of(tmp_path, "experiment=walk_keypoints_synthetic", STEADY, *small)
    metrics = summary["metrics"]
    assert summary["status"] == "complete"
    # noise of 4 px is 2.5 cm where the person is 270 px tall; the frames' means are better
    assert metrics["error_px"] < 4.0
    assert metrics["error_rel_mm"] < 40.0
    assert read(tmp_path / "out" / "run.rrd").poses[1].shape == (10, 25)


@pytest.mark.slow
def test_the_whole_experiment(summary_of, tmp_path):
    metrics = summary_of(tmp_path, "experiment=walk_keypoints_synthetic")["metrics"]
    assert metrics["error_px"] < 3.0
    assert metrics["error_rel_mm"] < 30.0
    assert np.isfinite(metrics["knee_deg"])
