"""The studies of learning through the command line, on the built-in walkers; on recordings where there are any."""

import json

import numpy as np
import pytest

from workbench.recording.read.reader import read

METRICS = {
    "learn_walk": {"n_cycles", "n_components", "explained", "explained_5"},
    "period_snr": {"period_error_max_pct", "period_error_max_pct_30", "white_noise_peak_ratio", "n_clips"},
    "align_cycles": {"n_sequences", "passes", "deviation_before", "deviation_after"},
    "impute_gaps": {f"rmse_deg_20{method}" for method in ("", "_linear", "_periodic", "_paper", "_markers")},
}
SMALL = {"impute_gaps": ["study.fractions=[0.2]"]}


@pytest.mark.parametrize("experiment", sorted(METRICS))
def test_a_study_runs_from_its_name_and_leaves_a_recording(run, experiment):
    code, told, folder = run("out", f"experiment={experiment}", *SMALL.get(experiment, []))
    assert code == 0, told
    assert "12 walks (builtin)" in told
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["status"], summary["experiment"]) == ("complete", experiment)
    assert METRICS[experiment] <= summary["metrics"].keys()
    assert np.isfinite([summary["metrics"][name] for name in METRICS[experiment]]).all()
    recorded = read(folder / "run.rrd")
    assert recorded.properties["metrics"] | recorded.properties["cost"] == summary["metrics"]
    assert recorded.properties["provenance"]["experiment"] == experiment
    assert "motions: builtin" in recorded.config
    assert "Paper" in recorded.note
    assert len(recorded.figures) >= 5
    assert not list(folder.glob("*.part"))


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bits_and_another_one_other_gaps(run):
    found = []
    for folder, overrides in (("a", ["threads=1"]), ("b", []), ("c", ["seed=1"])):
        code, told, out = run(folder, "experiment=period_snr", *overrides)
        assert code == 0, told
        found.append(read(out / "run.rrd"))
    first, again, other = found
    assert first.properties["metrics"] == again.properties["metrics"]
    for figure, same in zip(first.figures, again.figures, strict=True):
        assert all(curve.tobytes() == same.curves[label].tobytes() for label, curve in figure.curves.items())
    name = "period_error_median_pct_30"
    assert first.properties["metrics"][name] != other.properties["metrics"][name]


def test_recorded_walks(run, data):
    code, told, folder = run("out", "experiment=period_snr", f"paths.data={data}", "study.subjects=['08']")
    assert code == 0, told
    assert "walks (cmu) of 1 people" in told
    metrics = read(folder / "run.rrd").properties["metrics"]
    assert metrics["period_error_max_pct"] <= 2.0  # the agreed limits, for every clip of this person
    assert metrics["period_error_max_pct_30"] <= 5.0
