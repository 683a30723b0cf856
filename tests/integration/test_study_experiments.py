"""The study experiments through the command line, on the built-in motions."""

import json

import pytest

from workbench.recording.read.reader import read
from workbench.studies.learning_activities import style


@pytest.mark.slow
def test_a_study_writes_a_recording_and_a_summary(run):
    """The metrics and figures of all studies are those of the baselines."""
    small = ["prior.motions=builtin", "study.betas=[0.01,1]", "study.n_probes=3", "study.n_draws=3"]
    code, output, folder = run("out", "experiment=temperature", *small)
    assert code == 0, output
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["status"], summary["experiment"]) == ("complete", "temperature")
    assert {"tv_sign_tree", "tv_search", "visited_pct"} <= summary["metrics"].keys()
    recording = read(folder / "run.rrd")
    assert recording.properties["metrics"] | recording.properties["cost"] == summary["metrics"]
    assert recording.properties["provenance"]["experiment"] == "temperature"
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
def test_the_same_seed_is_bitwise_identical_at_any_number_of_threads(run):
    recordings = []
    for folder, overrides in (("a", ["n_threads=1"]), ("b", [])):
        code, output, out = run(folder, "experiment=period_snr", *overrides)
        assert code == 0, output
        recordings.append(read(out / "run.rrd"))
    first, repeated = recordings
    assert first.properties["metrics"] == repeated.properties["metrics"]
    for figure, same in zip(first.figures, repeated.figures, strict=True):
        assert all(curve.tobytes() == same.curves[label].tobytes() for label, curve in figure.curves.items())
