"""Learning walking and running together, through the command line."""

import json

import numpy as np
import pytest

from workbench.core.study import Curves, Scatter
from workbench.recording.read.reader import read
from workbench.studies.learning_activities import style

STUDY = "experiment=learn_walk_run"
METRICS = {"n_examples", "n_clips", "cycle_rate_hz_walk", "cycle_rate_hz_run"} | {
    f"{name}{part}"
    for name in ("n_components_90", "activity_accuracy", "activity_accuracy_2", "unseen_style_deg")
    for part in ("", "_legs")
}


def test_the_study_runs_from_its_name_and_leaves_a_recording(run):
    code, told, folder = run("out", STUDY)
    assert code == 0, told
    assert "96 cycles (builtin) of 24 clips" in told
    metrics = json.loads((folder / "summary.json").read_text())["metrics"]
    assert metrics.keys() == METRICS | {"seconds"}
    assert np.isfinite(list(metrics.values())).all()
    # generated people walk and run alike: nothing is near the border
    assert metrics["activity_accuracy"] == metrics["activity_accuracy_2_legs"] == 1.0
    assert metrics["cycle_rate_hz_walk"] < metrics["cycle_rate_hz_run"]
    recorded = read(folder / "run.rrd")
    assert recorded.properties["metrics"] | recorded.properties["cost"] == metrics
    assert "Paper D" in recorded.note
    figures = {figure.name: figure for figure in recorded.figures}
    assert len(figures) == 11
    cloud = figures["model/first two components, whole body"]
    assert isinstance(cloud, Scatter)
    assert {label: points.shape for label, points in cloud.points.items()} == {"walk": (48, 2), "run": (48, 2)}
    knee = figures["eigenvectors/left knee flexion"], figures["eigenvectors/left knee flexion, derivative"]
    assert all(isinstance(figure, Curves) for figure in knee)
    for label, curve in knee[0].curves.items():
        slope = np.gradient(curve, knee[0].x)[1:-1]
        # central differences of 257 points: a third derivative of 6 waves, (2π 6)³ / 6 / 256², 14 % of the curve's size
        assert knee[1].curves[label][1:-1] == pytest.approx(slope, abs=0.14 * np.abs(curve).max())


@pytest.mark.slow
def test_the_same_command_gives_the_same_bits_at_any_number_of_threads(run):
    found = []
    for folder, override in (("a", "threads=1"), ("b", "seed=3")):
        code, told, out = run(folder, STUDY, override, "study.most_per_clip=1")
        assert code == 0, told
        found.append(read(out / "run.rrd"))
    assert found[0].properties["metrics"] == found[1].properties["metrics"]
    clouds = [recorded.figures[0].points for recorded in found]
    assert all(clouds[0][label].tobytes() == clouds[1][label].tobytes() for label in clouds[0])


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("dataset-2_run_active_017", "active"),
        ("dataset-1_walk_not-confident_001", "not-confident"),
        ("35_02", "35"),
        ("walker_03_straight", "walker_03"),
        ("mine", "mine"),
    ],
)
def test_styles_are_read_from_names(source, expected):
    assert style(source) == expected
