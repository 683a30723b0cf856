"""The papers' figures are drawn from recordings."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.style import context
from recording_steps import BODY, steps

from analysis.figures import __main__ as command
from analysis.figures import a_fig2_planar_patch
from analysis.figures.readings import Reading
from analysis.figures.recordings import VARIANTS
from analysis.figures.replicates import Replicates
from workbench.core.state_space import StateSpace
from workbench.core.study import Bars, Curves, Sticks, StudyResult
from workbench.recording.read.reader import read
from workbench.recording.study.drawing import STYLE
from workbench.recording.study.study_recorder import record_study
from workbench.recording.write.file import RecordingFile
from workbench.recording.write.recorder import Recorder

ROOT = Path(__file__).parents[3]
FILES = {path.stem for path in (ROOT / "conf" / "experiment").glob("*.yaml")}
EXPERIMENTS = FILES | set(VARIANTS)
FAST = ("a_fig4_arm_marginals", "a_fig5_walk_straight", "b_fig1_left_period", "d_fig5_walk_steady")
"""One figure of each kind; the slow tests draw the others."""
TRACKED = {
    "mpjpe_px": 12.3, "mpjpe_abs_mm": 45.6, "mpjpe_mm": 23.4, "tracked": 1.0,
    "hip_flexion_rmse_deg": 3.4, "knee_flexion_rmse_deg": 5.6,
    "activity_accuracy": 0.5, "same_activity": 0.02,
}  # fmt: skip
ARM_ANGLES = ("shoulder_flexion", "shoulder_abduction", "shoulder_twist", "elbow_flexion")
ARM = StateSpace.of({"arm": (tuple(f"right_{angle}" for angle in ARM_ANGLES), "rad")})
CONFIG = """
dataset: {motion: builtin, rate_hz: 30.0, person_px: 175.0}
prior: {beta: 0.05, missing_fraction: 0.2}
inference: {n_particles: 40}
"""
X = np.linspace(0.0, 1.0, 9)


def labels(name: str) -> dict[str, str]:
    return {"run_id": name, "config_yaml": CONFIG}


def waves(name, *labels):
    return Curves(name, X, {label: np.sin(6.0 * X + k) for k, label in enumerate(labels)}, "cycle", "degrees")


def bars(name):
    return Bars(name, X, X, "σ", X[::-1])


BASELINES = ROOT / "recordings" / "baselines"
RECORDED = (
    "align_cycles", "coefficient_histograms", "impute_gaps", "learn_walk", "learn_walk_run", "period_snr",
    "temperature",
)  # fmt: skip
"""Studies with a baseline; the others are synthetic."""
POSES = np.random.default_rng(0).normal(size=(3, 3, 3)), np.array([-1, 0, 1]), np.array([0.2, 0.2, 1.0])
STUDIES = {
    "temperature_arm": ({}, [Sticks(f"draws/{search}, β = 0.05", *POSES) for search in ("sign tree", "our search")]),
    "tree_balance": (
        {
            "n_entries": 82094.0, "n_levels": 16.0, "empty_pct": 83.3, "largest_leaf": 484.0, "leaf_size": 63.6,
            "bits": 11.76, "empty_pct_gaussian": 28.7, "largest_leaf_gaussian": 8.0, "bits_gaussian": 15.3,
            "bits_shuffled": 15.3,
        },
        [
            bars("leaves/% of the leaves"), bars("leaves/% of the entries"),
            *(waves(f"levels/{name}", "recorded") for name in ("left to search", "nodes with one child")),
        ],
    ),
    "particles_by_dimension": (
        {"alpha_exact": 0.594, "alpha_paper": 0.253} | {
            f"alpha_{name}{end}": 0.61 + off
            for name in ("independent", "one_frame", "error", "body", "body_arms", "body_legs")
            for end, off in (("", 0.0), ("_low", -0.02), ("_high", 0.03))
        },
        [
            Curves(
                "particles/needed", X, {"body": X, "exact": 2.0 * X}, "d", "log₁₀ N", {},
                {f"body, seed {k}": X + 0.1 * k for k in range(3)},
            )
        ],
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Return a small recording of each experiment's kind."""
    folder = tmp_path_factory.mktemp("runs")
    recordings = {}
    for name, (metrics, figures) in STUDIES.items():
        with RecordingFile(folder / name / "run.rrd", **labels(name), provenance={"experiment": name}) as recorder:
            record_study(recorder, StudyResult(metrics, tuple(figures), "note"))
        recordings[name] = read(folder / name / "run.rrd")
    images, points = tracked(folder / "images.rrd", False), tracked(folder / "points.rrd", True)
    recordings |= {name: read(BASELINES / f"{name}.rrd") for name in RECORDED}
    others = EXPERIMENTS - recordings.keys()
    return recordings | {name: points if name.startswith("points") else images for name in others}


def tracked(path, with_points):
    """Record seven frames of a walk with images, or with points and an activity; the state is that of an arm."""
    with Recorder(path, BODY, ARM, **labels(path.stem), provenance={"experiment": "any"}) as recorder:
        for step in seven_steps(with_points):
            recorder.log(step, {"mpjpe_px": 0.1 * step.frame.index})
        recorder.set_result(TRACKED)
        recorder.set_cost({"ms_per_frame": 7.89})
    return read(path)


def seven_steps(with_points):
    columns = [BODY.skeleton.dof(name) for name in ARM.names]
    for step in steps(7, n_particles=40):
        step = replace(step, space=ARM, particles=step.poses[:, columns])
        if with_points:
            points = step.poses[:30, :3] + np.random.default_rng(0).normal(0.0, 0.3, (30, 3))
            truth = replace(step.frame.truth, activity="walk" if step.frame.index < 13 else "run")
            frame = replace(step.frame, views=(), points=points, truth=truth)
            step = replace(step, frame=frame, attachment=np.zeros(30, dtype=np.int64), activity="walk")
        yield step


def reading_of(run, papers):
    """Return recordings and synthetic results of the readings; one literal run has lost track."""
    numbers = {
        paper: Replicates(tuple({**run.result, "tracked": value} for value in (1.0, float(paper == "ours"))))
        for paper in papers
    }
    return Reading(dict.fromkeys(papers, run), numbers if len(papers) > 1 else {})


@pytest.mark.parametrize(
    "name", [name if name in FAST else pytest.param(name, marks=pytest.mark.slow) for name in command.paper_figures()]
)
def test_a_figure_draws_data_of_its_experiments(recorded, name, tmp_path):
    figure = command.paper_figures()[name]
    assert set(figure.experiments) <= EXPERIMENTS
    with context(STYLE):
        drawn = figure.draw({name: reading_of(recorded[name], figure.readings) for name in figure.experiments})
        drawn.savefig(tmp_path / "figure.png", dpi=40)
    assert all(axes.has_data() for axes in drawn.get_axes())


@pytest.mark.slow
def test_missing_runs_are_made_with_quick_settings_and_reused(tmp_path, cache, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("WORKBENCH_CACHE", str(cache))
    monkeypatch.delenv("WORKBENCH_DATA", raising=False)
    monkeypatch.setattr(sys, "argv", ["figures", "d_fig6", "--quick", "--runs", "runs", "-o", "out"])
    assert command.main() == 0
    output = capsys.readouterr().out
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"d_fig6_flexion.png", "d_fig6_flexion.pdf"}
    assert output.count("workbench run experiment=") == 2  # the fit has two readings
    assert "dataset.n_frames=16" in output
    assert command.main() == 0
    assert "workbench run experiment=" not in capsys.readouterr().out
    assert len(list((tmp_path / "runs").rglob("run.rrd"))) == 2


def test_a_patch_is_exact_at_the_outline_and_its_error_on_the_axis_is_the_radius_times_the_sine():
    """At the limb's end, to first order in the limb's size over the distance."""
    module = a_fig2_planar_patch
    for alpha in (0.0, 0.5, 1.0):
        exact, patch = module.projections(alpha, np.zeros(2), np.array([np.pi / 2.0, 0.0]))
        first_order = 2.0 * module.RADIUS_M**2 / module.DISTANCE_M
        np.testing.assert_allclose(patch[0], exact[0], atol=first_order)
        error = np.linalg.norm(patch[1] - exact[1])
        np.testing.assert_allclose(error, module.RADIUS_M * np.sin(alpha), rtol=0.08, atol=2.0 * first_order)
