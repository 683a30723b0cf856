"""Paper D's figures of points and bodies in space, besides those of fitted sequences."""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.frames import activities, flexions
from analysis.figures.panels import activity_lanes, around, bodies, evenly, flexion, points
from analysis.figures.readings import BOTH, DIFFERENCES, OURS, PaperFigure, Reading
from analysis.figures.run_descriptions import legs, setup
from analysis.figures.sequences import words
from analysis.figures.style import canvas, rows
from workbench.recording.study.drawing import ESTIMATE

N_SIDES = 6
VIEWS_DEG = {"from where they were seen": 0.0, "from the side": 90.0}
JOINTS = ("right_hip", "left_hip", "right_knee", "left_knee")
METHODS = {
    "points_particle_filter": "particle filter",
    "points_hybrid": "particle filter about the fit",
    "points_walk_steady": "fit, one style",
    "points_walk_variable": "fit, a style per frame",
}


def body(readings: Mapping[str, Reading]) -> Figure:
    """Draw the surface fitted in one frame, the sum of ellipsoids' fields, and its skeleton, from several sides."""
    run = readings["points_walk_steady"].ours
    (frame,) = evenly(run, 1)
    figure = canvas(
        "Paper D, fig. 1: the body",
        2.3,
        f"Surface and skeleton fitted in frame {frame}, seen from around. The paper: 28 joints, about 80 degrees of "
        f"freedom; here {run.poses[1].shape[1]}.",
    )
    around(figure.subplots(1, N_SIDES), run, frame)
    return figure


def observed_points(readings: Mapping[str, Reading]) -> Figure:
    """Draw a row from the front, where the points look dense, and one from the side, which shows how they err in
    depth."""
    run = readings["points_run_steady"].ours
    figure = canvas(
        "Paper D, fig. 2: noisy points of one side of the body",
        3.9,
        f"Black: points; blue: true skeleton. Ours: {setup(run)}; simulated. The paper: Digiclops, 640 × 480 at 14 Hz; "
        "very noisy and without depth; no number.",
    )
    frames = evenly(run, 7)
    parts = rows(figure, [1.0] * len(VIEWS_DEG), list(VIEWS_DEG))
    for part, turned in zip(parts, VIEWS_DEG.values(), strict=True):
        points(part.subplots(1, len(frames)), run, frames, turned)
    return figure


def leg_flexions(readings: Mapping[str, Reading]) -> Figure:
    """Draw a row for either reading: hips, then knees, each right leg first.

    The paper's reference is integrated gyroscopes; ours is the true pose.
    """
    walk = readings["points_walk_steady"]
    descriptions = "; ".join(f"{reading}: {legs(run)}" for reading, run in walk.runs.items())
    figure = canvas(
        "Paper D, fig. 6: flexion of hips and knees",
        1.7 * len(walk.runs) + 1.7,
        f"Orange: fit; blue, thick: truth. {words({'': walk})} Flexion, {descriptions}. The paper: “very close” to the "
        f"gyroscopes, even though the left leg is mostly hidden; no errors given. {DIFFERENCES}",
    )
    parts = rows(figure, [1.0] * len(walk.runs), [walk.row(reading) for reading in walk.runs])
    for part, run in zip(parts, walk.runs.values(), strict=True):
        angles = flexions(run)
        for axes, joint in zip(part.subplots(1, len(JOINTS), sharey=True), JOINTS, strict=True):
            flexion(axes, angles[joint], joint.replace("_", " "))
            axes.label_outer()
    return figure


def transition(readings: Mapping[str, Reading]) -> Figure:
    """Draw for either reading the fit of two concatenated clips in frames from the first to the last, with the
    estimated and the true activity."""
    both = readings["points_transition"]
    accuracies = {reading: run.result["activity_accuracy"] for reading, run in both.runs.items()}
    shares = ", ".join(f"{reading} {100 * accuracy:.0f} %" for reading, accuracy in accuracies.items())
    figure = canvas(
        "Paper D, fig. 10: from walking to running",
        2.5 * len(both.runs) + 1.6,
        f"Black: observed points; blue: true skeleton; solid: fit. {words({'': both})} The activity is correct in "
        f"{shares} of the frames. The paper: four frames of walking, three of transition, then running; it gives no "
        f"activities. {DIFFERENCES}",
    )
    titles = [line for reading in both.runs for line in (both.row(reading), "")]
    parts = rows(figure, (1.7, 0.75) * len(both.runs), titles)
    for above, below, run in zip(parts[0::2], parts[1::2], both.runs.values(), strict=True):
        frames = evenly(run, 8)
        bodies(above.subplots(1, len(frames)), run, frames)
        activity_lanes(below.subplots(), run, activities(run))
    return figure


def methods(readings: Mapping[str, Reading]) -> Figure:
    """Draw errors in space and of the knees, and milliseconds a frame, a row for each method."""
    figure = canvas(
        "Paper D, section 4: fitting and filtering the same points",
        2.6,
        f"Ours: {setup(readings['points_walk_steady'].ours)}; times are those of the machine that ran them. The paper "
        "gives no errors; it expects fitting to cost less than filtering (section 4.4) and suggests to combine both "
        "(section 1).",
    )
    columns = figure.subplots(1, 3, sharey=True)
    runs = [readings[experiment].ours for experiment in METHODS]
    values = {
        "joints off by (mm)": [run.result["mpjpe_abs_mm"] for run in runs],
        "knees off by (degrees)": [run.result["knee_flexion_rmse_deg"] for run in runs],
        "time (ms a frame)": [run.properties.get("cost", {}).get("ms_per_frame", float("nan")) for run in runs],
    }
    for axes, (name, row) in zip(columns, values.items(), strict=True):
        bars = axes.barh(list(METHODS.values()), row, color=ESTIMATE, height=0.6)
        axes.bar_label(bars, [f"{value:.{0 if value >= 100 else 1}f}" for value in row], padding=3.0, fontsize=7.5)
        axes.set_xlabel(name)
        axes.margins(x=0.18)
    columns[0].invert_yaxis()
    return figure


FIGURES = {
    "d_fig1_body": PaperFigure(("points_walk_steady",), OURS, body),
    "d_fig2_points": PaperFigure(("points_run_steady",), OURS, observed_points),
    "d_fig6_flexion": PaperFigure(("points_walk_steady",), BOTH, leg_flexions),
    "d_fig10_transition": PaperFigure(("points_transition",), BOTH, transition),
    "d_methods": PaperFigure(tuple(METHODS), OURS, methods),
}
