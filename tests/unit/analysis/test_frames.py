"""The papers' figures: each has its script, which draws from recordings and says their numbers."""

import importlib
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from matplotlib.figure import Figure
from matplotlib.style import context
from matplotlib.text import Text
from recording_steps import BODY, CAMERA, steps

from analysis.figures.frames import activities, flexions, pictures, scenes
from analysis.figures.recordings import VARIANTS
from workbench.body.kinematics import joints
from workbench.core.state_space import StateSpace
from workbench.core.study import Bars, Curves, Scatter, Sticks, StudyResult
from workbench.errors import InputError
from workbench.recording.read.reader import Run, read
from workbench.recording.study.drawing import STYLE
from workbench.recording.study.recorder import record_study
from workbench.recording.write.file import RecordingFile
from workbench.recording.write.recorder import Recorder

ROOT = Path(__file__).parents[3]
SCRIPTS = sorted(path.stem for path in (ROOT / "analysis" / "figures").glob("[abcd]_*.py"))
FILES = {path.stem for path in (ROOT / "conf" / "experiment").glob("*.yaml")}
EXPERIMENTS = FILES | set(VARIANTS)
TRACKED = {
    "error_px": 12.3, "error_abs_mm": 45.6, "error_rel_mm": 23.4, "held": 1.0, "hip_deg": 3.4, "knee_deg": 5.6,
    "activity_accuracy": 0.5, "same_activity": 0.02,
}  # fmt: skip
ARM_ANGLES = ("shoulder_flexion", "shoulder_abduction", "shoulder_twist", "elbow_flexion")
ARM = StateSpace.of({"arm": (tuple(f"right_{angle}" for angle in ARM_ANGLES), "rad")})
CONFIG = """
dataset: {motion: builtin, rate_hz: 30.0, person_px: 175.0}
prior: {beta: 0.05, missing: 0.2}
inference: {n_particles: 40}
"""
X = np.linspace(0.0, 1.0, 9)


@pytest.fixture(autouse=True)
def from_the_root(monkeypatch):
    """`analysis` is not installed: it is imported from the repository."""
    monkeypatch.syspath_prepend(str(ROOT))


def script(name):
    return importlib.import_module(f"analysis.figures.{name}")


def labels(part: str) -> dict[str, str]:
    return {"run_id": part, "config_yaml": CONFIG}


def waves(name, *labels, marks=None):
    curves = {label: np.sin(6.0 * X + k) for k, label in enumerate(labels)}
    return Curves(name, X, curves, "cycle", "degrees", marks or {}, {"one": np.cos(X)})


def poses(name):
    return Sticks(
        name, np.random.default_rng(0).normal(size=(3, 3, 3)), np.array([-1, 0, 1]), np.array([0.2, 0.2, 1.0])
    )


def bars(name):
    return Bars(name, X, X, "σ", X[::-1])


HELD = ("12.3 px", "46 mm in space", "23 mm with pelvis on pelvis", "held", "40 particles")
FITTED = ("46 mm in space", "3.4°", "5.6°")
WORDS = {
    "a_fig1_body": ("frame 13", "48 points", "of 576 compared", "40 particles"),
    "a_fig2_planar_patch": ("42 px long", "7.0 px"),
    "a_fig3_eigencurves": ("13 components", "93 cycles", "five: 86 %"),
    "a_fig4_arm_marginals": HELD,
    "a_fig5_walk_straight": HELD,
    "a_fig6_walk_circle": HELD,
    "a_fig7_prior_only": HELD,
    "b_fig1_left_period": ("0.32 %", "3.7 %", "1.15 times"),
    "b_fig1_right_alignment": ("63 walks", "1.34", "1.12", "4 passes"),
    "b_fig2_walk_cyclic": (*HELD, "20 % of the samples missing"),
    "b_gaps": ("1.50°", "2.50°", "3.50°", "4.50°"),
    "c_dimension": ("3 seeds", "0.61 (0.59 to 0.64)", "exactly 0.59", "α = 0.25 an angle"),
    "c_fig3_arm": ("(e) exact", "12.3 px", "frame 16", "β = 0.05"),
    "c_fig3_temperature": ("0.001", "0.71", "2.2 %"),
    "c_fig4_coefficients": ("0.05", "TV 0.41", "TV 0.54"),
    "c_fig5_running": ("0.2 s", "β = 0.05", "2 % of the frames"),
    "c_fig6_arm": HELD,
    "c_fig7_body": HELD,
    "c_synthesis": ("walking: ", "after a walk, of runs alone: ", "m/s", "β = 0.05"),
    "c_tree_balance": ("82094 windows", "16 levels", "83 %", "largest of 484", "11.8 bits", "29 % empty"),
    "d_fig1_body": ("frame 10", "here 25"),
    "d_fig2_points": ("a generated walker, 7 frames",),
    "d_fig1_motion_model": ("1057 cycles of 391 clips", "7 components (legs: 5)", "93.1 %", "97.3 %"),
    "d_fig3_no_model": FITTED,
    "d_fig4_eigenvectors": ("1057 cycles",),
    "d_fig5_walk_steady": FITTED,
    "d_fig6_flexion": FITTED[1:],
    "d_fig7_run_steady": FITTED,
    "d_fig8_run_variable": FITTED,
    "d_fig9_walk_variable": FITTED,
    "d_fig10_transition": ("46 mm in space", "50 % of the frames", "walk", "run"),
    "d_methods": ("45.6", "5.6", "7.9"),
}
"""What each figure has to say of the made-up runs."""

MODEL = "eigenvectors/left knee flexion"
STUDIES = {
    "learn_walk": (
        {"n_components": 13.0, "n_cycles": 93.0, "explained_5": 0.861},
        [
            waves("cycles/left knee flexion", "mean"),
            waves("eigencurves/left knee flexion", "mean", "+2λ1", "+2λ2", "+2λ3"),
            waves("model/explained variance", "explained", "0.95", marks={"d =": 0.5}),
        ],
    ),
    "period_snr": (
        {
            "n_clips": 63.0, "period_error_median_pct": 0.32, "period_error_max_pct": 3.7,
            "white_noise_peak_ratio": 1.15,
        },
        [waves("period/a", "accumulated"), waves("period/all", "noise"), waves("period/deviation", "all samples")],
    ),
    "align_cycles": (
        {"n_sequences": 63.0, "passes": 4.0, "deviation_before": 1.34, "deviation_after": 1.12},
        [
            waves(f"alignment/{angle} flexion {when}", "mean")
            for angle in ("left hip", "left knee", "left shoulder")
            for when in ("before", "after")
        ],
    ),
    "impute_gaps": (
        {f"rmse_deg_20{method}": 1.5 + k for k, method in enumerate(("", "_paper", "_periodic", "_linear"))},
        [waves("gaps/blocks removed", "ours", "linear"), waves("gaps/markers removed", "ours", "linear")],
    ),
    "temperature": (
        {"tv_search": 0.001, "tv_sign_tree": 0.71, "visited_pct": 2.2},
        [poses("draws/sign tree, β = 1"), poses("draws/our search, β = 1"), *map(waves, ("f/tv", "f/visited"))],
    ),
    "temperature_arm": (
        {"tv_search": 0.001}, [poses("draws/sign tree, β = 0.05"), poses("draws/our search, β = 0.05")],
    ),
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
    "coefficient_histograms": (
        {"tv_sampling": 0.05, "tv_c3_sign_tree": 0.41, "tv_c3_search": 0.54},
        [bars(f"coefficients/{search}, c3") for search in ("sign tree", "our search")],
    ),
    "learn_walk_run": (
        {
            "n_examples": 1057.0, "n_clips": 391.0, "n_components_90": 7.0, "n_components_90_legs": 5.0,
            "activity_accuracy_2": 0.931, "activity_accuracy_2_legs": 0.973,
        },
        [
            *(
                Scatter(f"model/first two components, {part}", {"walk": X[:8].reshape(4, 2)}, "α₁", "α₂")
                for part in ("whole body", "legs")
            ),
            waves("model/explained variance", "whole body", "legs"), waves(MODEL, "σ1 Θ1"),
            waves(f"{MODEL}, derivative", "σ1 Θ1"),
        ],
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """By experiment: a tiny recording of its kind."""
    folder = tmp_path_factory.mktemp("runs")
    found = {}
    for name, (metrics, figures) in STUDIES.items():
        with RecordingFile(folder / name / "run.rrd", **labels(name), provenance={"experiment": name}) as recorder:
            record_study(recorder, StudyResult(metrics, tuple(figures), "note"))
        found[name] = read(folder / name / "run.rrd")
    images, points = tracked(folder / "images.rrd", False), tracked(folder / "points.rrd", True)
    others = EXPERIMENTS - STUDIES.keys()
    return found | {name: points if name.startswith("points") else images for name in others}


def tracked(path, with_points):
    """Seven frames of a walk with images, or with points and an activity; the particles' columns are an arm's."""
    with Recorder(path, BODY, ARM, **labels(path.stem), provenance={"experiment": "any"}) as recorder:
        for step in seven_steps(with_points):
            recorder.log(step, {"error_px": 0.1 * step.frame.index})
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


def rows_with_figures():
    """(paper, numbers of figures, experiments) of every row of the documents' table that names published figures."""
    table = (ROOT / ".docs" / "experiments.md").read_text(encoding="utf-8").partition("## The papers")[0]
    for row in table.splitlines():
        if figures := re.search(r"\((?:paper )?([ABCD]), figs?\. ([^)]+)\)", row):
            numbers = [int(number) for number in re.findall(r"\d+", figures[2])]
            yield figures[1].lower(), numbers, EXPERIMENTS & set(re.findall(r"\w+", row))


def test_every_published_figure_of_the_experiment_table_has_a_script():
    rows = list(rows_with_figures())
    assert len(rows) >= 15
    for paper, numbers, experiments in rows:
        used = {
            n: [script(name).EXPERIMENTS for name in SCRIPTS if name.startswith(f"{paper}_fig{n}_")] for n in numbers
        }
        assert all(experiments & set().union(*found) for found in used.values()), (paper, used)
        assert experiments <= {name for found in used.values() for names in found for name in names}, (paper, used)


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_scripts_docstring_names_the_figure_and_its_experiments(name):
    module = script(name)
    paper, number = re.match(r"([abcd])_(?:fig(\d+))?", name).groups()
    where = rf"fig\. {number}(?!\d)" if number else r"section \d"
    assert re.match(rf"Paper {paper.upper()}, {where}", module.__doc__)
    assert module.EXPERIMENTS
    assert set(module.EXPERIMENTS) <= EXPERIMENTS
    assert all(re.search(rf"\b{experiment}\b", module.__doc__) for experiment in module.EXPERIMENTS)


def reading_of(run, papers):
    """Recordings and made-up numbers of either reading, of which one run of the literal one is lost."""
    readings, replicates = script("readings"), script("replicates")
    numbers = {
        paper: replicates.Replicates(tuple({**run.result, "held": held} for held in (1.0, float(paper == "ours"))))
        for paper in papers
    }
    return readings.Reading(dict.fromkeys(papers, run), numbers if len(papers) > 1 else {})


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_draws_and_says_the_runs_numbers(recorded, name, tmp_path):
    module = script(name)
    with context(STYLE):
        figure = module.draw({name: reading_of(recorded[name], module.READINGS) for name in module.EXPERIMENTS})
        figure.savefig(tmp_path / "figure.png", dpi=40)
    assert all(axes.has_data() for axes in figure.get_axes())
    text = " ".join(" ".join(part.get_text() for part in figure.findobj(Text)).split())
    assert [word for word in WORDS[name] if word not in text] == []
    assert "The paper" in text
    if module.READINGS == script("readings").BOTH:  # both rows with their numbers over seeds, and what they leave out
        assert "1 of 2 seeds hold" in text
        assert "2 of 2 seeds hold" in text
        assert "Not " in text


def test_an_arms_picture_is_cut_to_the_arm_and_shows_what_was_recorded(recorded):
    panels, figure = script("panels"), Figure()
    run = recorded["walk_straight"]
    row = figure.subplots(1, 2)
    panels.images(row, run, panels.evenly(run, 2))
    for axes, frame in zip(row, (10, 16), strict=True):
        (estimate,) = [part for part in axes.collections if part.get_linewidth()[0] == panels._WIDTHS["estimate"]]
        drawn = np.concatenate(estimate.get_segments())
        step = next(step for step in seven_steps(False) if step.frame.index == frame)
        true = CAMERA.project(joints(BODY.skeleton, step.expected_pose[None]))[0]
        distances = np.linalg.norm(drawn[:, None] - true[None], axis=2)
        assert distances.min(axis=1).max() < 1e-3  # every corner is a joint, to float32
        assert distances.min(axis=0).max() < 1e-3  # and every joint a corner
        (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
        assert (drawn >= [left, top]).all()
        assert (drawn <= [right, bottom]).all()


def test_the_image_and_the_scene_are_those_of_the_frame(recorded):
    step = list(seven_steps(False))[3]
    (picture,) = pictures(recorded["walk_straight"], [step.frame.index])
    original = step.frame.views[0].image.astype(float)
    assert picture.image.shape == original.shape
    assert np.abs(picture.image - original).mean() < 4.0  # grey levels that a JPEG of quality 85 may lose
    (scene,) = scenes(recorded["points_walk_steady"], [step.frame.index])
    pointed = list(seven_steps(True))[3]
    np.testing.assert_allclose(scene.points, pointed.frame.points, atol=1e-6)
    np.testing.assert_allclose(scene.truth.min(axis=(0, 1)), pointed.frame.truth.joints.min(axis=0), atol=1e-6)
    assert len(scene.vertices) == 0
    with pytest.raises(InputError, match="99"):
        pictures(recorded["walk_straight"], [99])
    with pytest.raises(InputError, match="images"):
        pictures(recorded["points_walk_steady"], [10])
    with pytest.raises(InputError, match="99"):
        scenes(recorded["walk_straight"], [99])


def test_flexions_and_activities_are_read_back(recorded):
    run = recorded["points_walk_steady"]
    found = flexions(run)
    assert set(found) == {"left_hip", "right_hip", "left_knee", "right_knee"}
    frames, poses = run.poses
    column = BODY.skeleton.dof("left_knee_flexion")
    np.testing.assert_array_equal(found["left_knee"]["estimate"].frames, frames)
    np.testing.assert_allclose(found["left_knee"]["estimate"].values[:, 0], np.degrees(poses[:, column]))
    told = activities(run)
    assert told["estimate"] == dict.fromkeys(range(10, 17), "walk")
    assert told["truth"] == {frame: "walk" if frame < 13 else "run" for frame in range(10, 17)}
    assert flexions(recorded["walk_straight"]) == {}
    assert activities(recorded["walk_straight"]) == {}


def test_the_newest_complete_run_with_the_configuration_is_taken(monkeypatch, tmp_path):
    recordings = script("recordings")
    source = recordings.Source(tmp_path, None, quick=False)
    wanted = {"dataset": {"motion": "builtin", "data": "here"}, "inference": {"n_particles": 40}, "seed": 3}
    other = {**wanted, "inference": {"n_particles": 41}}

    def run(name, config, status="complete", experiment="walk_straight", age=0.0):
        path = tmp_path / f"{name}.rrd"
        path.write_bytes(b"")
        os.utime(path, (1e9 - age, 1e9 - age))
        properties = {
            "run": {"status": status}, "provenance": {"experiment": experiment},
            "config": {"TextDocument:text": yaml.safe_dump(config)},
        }  # fmt: skip
        return Run(path, properties, {})

    moved = {**wanted, "dataset": {"motion": "builtin", "data": "there"}, "seed": 0, "paths": {"cache": "/c"}}
    old, new = run("old", wanted, age=5.0), run("new", moved, age=2.0)
    useless = [
        run("other", other), run("cut", wanted, "running"), run("another", wanted, experiment="walk_circle"),
    ]  # fmt: skip
    monkeypatch.setattr(recordings, "_composed", lambda experiment, overrides: wanted)
    monkeypatch.setattr(recordings, "_made", lambda experiment, source, paper: "made")
    assert recordings.recording("walk_straight", source, [old, *useless, new]) is new
    assert recordings.recording("walk_straight", source, [*useless, old]) is old
    assert recordings.recording("walk_straight", source, useless) == "made"


def test_what_a_run_is_made_with():
    recordings = script("recordings")
    full = recordings.Source(Path(), None, quick=False)
    small = recordings.Source(Path(), None, quick=True)
    recorded = recordings.Source(Path(), "DATA", quick=True)
    assert full.variants("walk_circle") == [[]]
    assert small.variants("walk_circle") == [[], list(recordings.QUICK["walk_circle"])]
    assert small.variants("learn_walk") == [[]]
    assert full.variants("walk_circle", "literal") == [["paper=literal"]]
    assert small.variants("walk_circle", "literal")[-1] == ["paper=literal", *recordings.QUICK["walk_circle"]]
    assert recordings.Source(Path(), "DATA", quick=False).variants("walk_prior_only", "literal") == [
        ["paper=literal", "paths.data=DATA"]  # on the circle, and not a recorded walk
    ]
    assert recorded.variants("body_implicit")[0] == ["paths.data=DATA"]
    assert small.variants("body_implicit")[0] == list(recordings.GENERATED["body_implicit"])
    with pytest.raises(InputError, match=r"body_implicit.*--data"):
        full.variants("body_implicit")
    assert set(recordings.QUICK) | set(recordings.GENERATED) | set(recordings.RECORDED) <= EXPERIMENTS
    assert {experiment for experiment, *_ in VARIANTS.values()} <= FILES


def test_wrong_input_is_one_clear_sentence_and_what_cannot_be_made_is_named(monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("WORKBENCH_DATA", raising=False)
    for arguments, code, words in (
        (["a_fig99"], 2, "figures: a_fig99: expected a figure's name"),
        (["c_fig7"], 1, "not made: c_fig7_body: body_implicit: needs recorded motion"),
    ):
        monkeypatch.setattr(sys, "argv", ["figures", *arguments])
        assert script("__main__").main() == code
        assert words in capsys.readouterr().err


@pytest.mark.slow
def test_missing_runs_are_made_small_and_used_again(tmp_path):
    def command(*arguments):
        environment = {**os.environ, "WORKBENCH_CACHE": str(tmp_path / "cache"), "PYTHONPATH": str(ROOT)}
        environment.pop("WORKBENCH_DATA", None)
        return subprocess.run(
            [sys.executable, "-m", "analysis.figures", *arguments],
            cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300, check=False,
        )  # fmt: skip

    arguments = ("a_fig3", "d_fig5", "d_fig6", "--quick", "--runs", "runs", "-o", "out")
    done = command(*arguments)
    assert done.returncode == 0, done.stderr
    names = ("a_fig3_eigencurves", "d_fig5_walk_steady", "d_fig6_flexion")
    made = {f"{name}.{suffix}" for name in names for suffix in ("png", "pdf")}
    assert {path.name for path in (tmp_path / "out").iterdir()} == made
    assert done.stdout.count("workbench experiment=") == 3  # the fit as D writes it, too
    assert "dataset.n_frames=16" in done.stdout
    again = command(*arguments)
    assert again.returncode == 0, again.stderr
    assert "workbench experiment=" not in again.stdout
    assert len(list((tmp_path / "runs").rglob("run.rrd"))) == 3


def test_a_patch_is_exact_at_the_silhouette_and_off_by_the_radius_over_the_sine_in_the_middle():
    """At the limb's end, where nothing is interpolated along it; to first order in its size over the distance."""
    module = script("a_fig2_planar_patch")
    for alpha in (0.0, 0.5, 1.0):
        exact, patch = module.projections(alpha, np.zeros(2), np.array([np.pi / 2.0, 0.0]))
        first_order = 2.0 * module.RADIUS_M**2 / module.DISTANCE_M
        np.testing.assert_allclose(patch[0], exact[0], atol=first_order)
        off = np.linalg.norm(patch[1] - exact[1])
        np.testing.assert_allclose(off, module.RADIUS_M * np.sin(alpha), rtol=0.08, atol=2.0 * first_order)
