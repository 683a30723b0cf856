"""The study experiments through the command line, on the built-in motions."""

import json

import numpy as np
import pytest

from workbench.recording.read.reader import read
from workbench.studies.learning_activities import style

METRICS = {
    "learn_walk": {"n_cycles", "n_components", "explained_variance", "explained_variance_5"},
    "period_snr": {"period_error_max_pct", "period_error_max_pct_30", "white_noise_peak_ratio", "n_clips"},
    "align_cycles": {"n_sequences", "n_passes", "deviation_before", "deviation_after"},
    "impute_gaps": {f"rmse_deg_20{method}" for method in ("", "_linear", "_periodic", "_paper", "_markers")},
    "learn_walk_run": {"n_examples", "n_clips", "cycle_rate_hz_walk", "activity_accuracy", "unseen_style_deg_legs"},
    "temperature": {"tv_sign_tree", "tv_search", "visited_pct"},
    "coefficient_histograms": {"tv_c3_sign_tree", "tv_c3_search", "tv_sampling"},
}
FAST = ("align_cycles", "temperature")
SMALL = {
    "impute_gaps": ["study.fractions=[0.2]"],
    "temperature": ["prior.motions=builtin", "study.betas=[0.01,1]", "study.n_probes=3", "study.n_draws=3"],
    "coefficient_histograms": ["prior.motions=builtin", "study.n_draws=100"],
}


CASES = [name if name in FAST else pytest.param(name, marks=pytest.mark.slow) for name in METRICS]


@pytest.mark.parametrize("experiment", CASES)
@pytest.mark.slow
def test_a_study_writes_a_recording_and_a_summary(run, experiment):
    code, output, folder = run("out", f"experiment={experiment}", *SMALL.get(experiment, []))
    assert code == 0, output
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["status"], summary["experiment"]) == ("complete", experiment)
    assert METRICS[experiment] <= summary["metrics"].keys()
    assert np.isfinite([summary["metrics"][name] for name in METRICS[experiment]]).all()
    recording = read(folder / "run.rrd")
    assert recording.properties["metrics"] | recording.properties["cost"] == summary["metrics"]
    assert recording.properties["provenance"]["experiment"] == experiment
    assert "motions: builtin" in recording.config
    assert "Paper" in recording.note
    assert len(recording.figures) >= 4
    assert not list(folder.glob("*.part"))


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("dataset-2_run_active_017", "active"), ("dataset-1_walk_not-confident_001", "not-confident"), ("35_02", "35"),
        ("walker_03_straight", "walker_03"), ("mine", "mine"),
    ],
)  # fmt: skip
def test_a_style_is_read_from_the_name_of_a_clip(source, expected):
    assert style(source) == expected


@pytest.mark.slow
def test_the_same_seed_is_bitwise_identical_and_another_one_differs(run):
    recordings = []
    for folder, overrides in (("a", ["n_threads=1"]), ("b", []), ("c", ["seed=1"])):
        code, output, out = run(folder, "experiment=period_snr", *overrides)
        assert code == 0, output
        recordings.append(read(out / "run.rrd"))
    first, repeated, other = recordings
    assert first.properties["metrics"] == repeated.properties["metrics"]
    for figure, same in zip(first.figures, repeated.figures, strict=True):
        assert all(curve.tobytes() == same.curves[label].tobytes() for label, curve in figure.curves.items())
    name = "period_error_median_pct_30"
    assert first.properties["metrics"][name] != other.properties["metrics"][name]
