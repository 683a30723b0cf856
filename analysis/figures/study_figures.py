"""The papers' figures of studies, drawn from their recorded curves, bars and points."""

from collections.abc import Mapping
from dataclasses import replace

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.figures.readings import OURS, PaperFigure, Reading
from analysis.figures.studies import curves_named, figure_named, sticks
from analysis.figures.style import canvas, rows
from workbench.core.study import Bars, Curves, Sticks
from workbench.recording.read.reader import Run
from workbench.recording.study.drawing import draw, draw_bars, draw_curves

KNEE = "left knee flexion"
ALIGNED = ("left hip flexion", "left knee flexion", "left shoulder flexion")


def _draw_named(axes: Axes, run: Run, name: str, title: str | None = None) -> None:
    """Draw a study's figure; title: None for the name without its group."""
    draw(axes, figure_named(run, name))
    axes.set_title(name.partition("/")[2] if title is None else title)


def learned_walk(readings: Mapping[str, Reading]) -> Figure:
    """Draw cycles and mean; the first three eigencurves, each alone and times λ as in the paper's 3c; the variance
    explained."""
    run = readings["learn_walk"].ours
    result = run.result
    figure = canvas(
        "Paper A, fig. 3: learning a walking model",
        2.7,
        f"Ours: {result['n_components']:.0f} components explain 95 % of the variance of {result['n_cycles']:.0f} "
        f"cycles (five: {100 * result['explained_variance_5']:.0f} %), cut at gait events. "
        "The paper: five components, 13 cycles of 4 people, cut by hand.",
    )
    cycles, modes, shares = figure.subplots(1, 3)
    draw_curves(cycles, curves_named(run, f"cycles/{KNEE}"))
    cycles.set_title(f"(a, b) {KNEE}")
    draw_curves(modes, _alone(curves_named(run, f"eigencurves/{KNEE}")), dashed=True)
    modes.axhline(0.0, color="0.8", linewidth=0.6, zorder=0)
    modes.set_title("(c) eigencurves, times λ")
    draw_curves(shares, curves_named(run, "model/explained variance"), marks_at=0.5)
    shares.set_title("variance explained")
    shares.set_ylim(0.0, 1.02)
    return figure


def _alone(eigencurves: Curves) -> Curves:
    """Return λ_k times component k, of the recorded mean + 2 λ_k times component k."""
    mean = eigencurves.curves["mean"]
    modes = {f"{k}": 0.5 * (curve - mean) for k, curve in enumerate(list(eigencurves.curves.values())[1:], start=1)}
    return Curves(eigencurves.name, eigencurves.x, modes, eigencurves.x_name, eigencurves.y_name)


def periods(readings: Mapping[str, Reading]) -> Figure:
    """Draw the walk whose period was found best, all walks with white noise, and the deviations from hip events.

    The axis is logarithmic, where the paper's is linear: single angles differ by powers of ten.
    """
    run = readings["period_snr"].ours
    result = run.result
    figure = canvas(
        "Paper B, fig. 1 left: finding the period",
        2.9,
        f"Ours: {result['n_clips']:.0f} walks; periods differ from hip events by "
        f"{result['period_error_median_pct']:.2f} % (median) and {result['period_error_max_pct']:.1f} % at most; white "
        f"noise stays flat: its largest ratio is {result['white_noise_peak_ratio']:.2f} times its median. The paper: a "
        "peak at 126 samples; white noise about constant.",
    )
    names = [run.figures[k].name for k in (0, -2, -1)]
    for axes, name in zip(figure.subplots(1, 3), names, strict=True):
        _draw_named(axes, run, name)
    return figure


def alignment(readings: Mapping[str, Reading]) -> Figure:
    """Draw three angles of walks, each folded by its own period: before the alignment, above, and after, below."""
    run = readings["align_cycles"].ours
    result = run.result
    figure = canvas(
        "Paper B, fig. 1 right: aligning walks",
        4.4,
        f"Ours: {result['n_sequences']:.0f} walks (grey), their mean and, once aligned, their common spline (blue), "
        f"from which they deviate by {result['deviation_before']:.2f} standard deviations of the angles before and "
        f"{result['deviation_after']:.2f} after {result['n_passes']:.0f} passes. The paper shows eight walks and gives "
        "no number.",
    )
    for row, when in zip(figure.subplots(2, len(ALIGNED), sharex=True), ("before", "after"), strict=True):
        for axes, angle in zip(row, ALIGNED, strict=True):
            draw_curves(axes, curves_named(run, f"alignment/{angle} {when}"), labels=False)
            axes.set_title(f"{angle}, {when}")
    return figure


def gaps(readings: Mapping[str, Reading]) -> Figure:
    """Draw error over the part of the joint angles removed, in blocks and by markers, by method."""
    run = readings["impute_gaps"].ours
    result = run.result
    figure = canvas(
        "Paper B, section 2.2: filling in missing joint angles",
        3.0,
        f"At 20 % of the samples removed in blocks: ours {result['rmse_deg_20']:.2f}°, the paper's algorithm "
        f"{result['rmse_deg_20_paper']:.2f}°, a periodic spline {result['rmse_deg_20_periodic']:.2f}°, linear "
        f"interpolation {result['rmse_deg_20_linear']:.2f}° (root mean square). The paper gives no errors.",
    )
    for axes, name in zip(figure.subplots(1, 2), ("gaps/blocks removed", "gaps/markers removed"), strict=True):
        _draw_named(axes, run, name)
        axes.set_ylim(bottom=0.0)
    return figure


def temperatures(readings: Mapping[str, Reading]) -> Figure:
    """Draw the samples at rising temperatures, a row for each search; fidelity against temperature."""
    run = readings["temperature"].ours
    result = run.result
    draws = [figure for figure in run.figures if isinstance(figure, Sticks)]
    fidelity = [figure for figure in run.figures if isinstance(figure, Curves)]
    figure = canvas(
        "Paper C, fig. 3: sampling from the database",
        6.3,
        "Grey: ten poses drawn; blue: the pose that truly followed. Ours, at the prior's β: total variation to the "
        f"exact odds {result['tv_search']:.2g} by our search, which looks at {result['visited_pct']:.1f} % of the "
        f"database, {result['tv_sign_tree']:.2f} by the paper's tree. The paper shows cold draws alike and hot ones of "
        "any kind, without numbers.",
    )
    upper, lower = rows(figure, (3.6, 1.9), ("", ""))
    for axes, drawn in zip(upper.subplots(2, len(draws) // 2, sharex=True, sharey=True).flat, draws, strict=True):
        sticks(axes, drawn)
        axes.set_title(drawn.name.partition("/")[2])
    for axes, curves in zip(lower.subplots(1, len(fidelity)), fidelity, strict=True):
        marks = dict(zip(["prior"], curves.marks.values(), strict=False))  # whose longer name would cross curves
        draw_curves(axes, replace(curves, marks=marks), marks_at=0.72)
        axes.set_title(curves.name.partition("/")[2])
    return figure


def coefficients(readings: Mapping[str, Reading]) -> Figure:
    """Draw a row for each search, a column for each coefficient."""
    run = readings["coefficient_histograms"].ours
    histograms = [figure for figure in run.figures if isinstance(figure, Bars)]
    figure = canvas(
        "Paper C, fig. 4: coefficients of the windows drawn for one probe",
        3.9,
        "Solid: draws; dashed: the independent Gaussian about the probe; TV: total variation between them (drawing as "
        f"often from the Gaussian itself would give {run.result['tv_sampling']:.2f}). The paper's histograms, of the "
        "sign tree, follow the Gaussian roughly; no numbers given.",
    )
    for axes, histogram in zip(figure.subplots(2, len(histograms) // 2).flat, histograms, strict=True):
        draw_bars(axes, histogram)
        search, _, coefficient = histogram.name.partition("/")[2].rpartition(", ")
        metric = f"tv_{coefficient}_{'sign_tree' if search == 'sign tree' else 'search'}"
        axes.set_title(f"{search}, {coefficient}: TV {run.result[metric]:.2f}")
        axes.set_yticks([])
    return figure


def tree_balance(readings: Mapping[str, Reading]) -> Figure:
    """Draw leaves by size, in leaves and in entries; what every level leaves to search, and how it splits."""
    run = readings["tree_balance"].ours
    result, motions = run.result, run.settings["prior"].get("motions", "recorded")
    figure = canvas(
        "Paper C, section 4.1: leaves and balance of the sign tree",
        5.4,
        f"Ours: {result['n_entries']:.0f} windows ({motions}), {result['n_levels']:.0f} levels. Solid: "
        f"recorded, {result['empty_pct']:.0f} % of the leaves empty, the largest of {result['largest_leaf']:.0f}; the "
        f"mean window shares its leaf with {result['leaf_size'] - 1.0:.0f}; {result['bits']:.1f} bits tell its leaf. "
        f"Dashed: independent Gaussian coefficients, {result['empty_pct_gaussian']:.0f} % empty, largest "
        f"{result['largest_leaf_gaussian']:.0f}, {result['bits_gaussian']:.1f} bits. Shuffling every component gives "
        f"{result['bits_shuffled']:.1f} bits: balanced signs, but dependent ones (below right it "
        "lies behind recorded). The paper: about 50 000 windows, 16 levels, approximately balanced; zero to several "
        "hundred samples in a leaf; no distribution, no other tree.",
    )
    upper, lower = rows(figure, (1.0, 1.15), ("", ""))
    bars = [drawn for drawn in run.figures if isinstance(drawn, Bars)]
    for axes, drawn in zip(upper.subplots(1, len(bars)), bars, strict=True):
        draw_bars(axes, drawn)
        axes.set_ylabel(drawn.name.partition("/")[2])
        # of a class of leaf sizes, 0, 1, 2–3, 4–7 …, the least
        axes.set_xticks(drawn.x, [str(1 << k - 1) if k else "0" for k in map(int, drawn.x)])
        axes.set_xlabel("windows in a leaf, from this many on")
    curves = [drawn for drawn in run.figures if isinstance(drawn, Curves)]
    for k, (axes, drawn) in enumerate(zip(lower.subplots(1, len(curves)), curves, strict=True)):
        draw_curves(axes, drawn, labels=k == len(curves) - 1)
        axes.set_title(drawn.name.partition("/")[2])
    return figure


def motion_model(readings: Mapping[str, Reading]) -> Figure:
    """Draw the examples' first two coefficients, of the whole body and of the legs; the variance explained."""
    run = readings["learn_walk_run"].ours
    result = run.result
    figure = canvas(
        "Paper D, fig. 1: a motion model of walking and running",
        3.1,
        f"Ours: {result['n_examples']:.0f} cycles of {result['n_clips']:.0f} clips; 0.9 of the variance takes "
        f"{result['n_components_90']:.0f} components (legs: {result['n_components_90_legs']:.0f}); two components tell "
        f"the activity of {100 * result['activity_accuracy_2']:.1f} % of the examples (legs: "
        f"{100 * result['activity_accuracy_2_legs']:.1f} %) without their clip. The paper: 256 examples of 4 people "
        "on a treadmill; 5 components for 0.9; two separate clusters.",
    )
    titles = {
        "model/first two components, whole body": "(b) body", "model/first two components, legs": "(b) legs",
        "model/explained variance": "(c) variance explained",
    }  # fmt: skip
    for axes, (name, title) in zip(figure.subplots(1, 3), titles.items(), strict=True):
        _draw_named(axes, run, name, title)
    return figure


def eigenvectors(readings: Mapping[str, Reading]) -> Figure:
    """Draw the left knee's eigenvectors on the left, their derivatives on the right."""
    run = readings["learn_walk_run"].ours
    caption = (
        f"Each scaled by its standard deviation over {run.result['n_examples']:.0f} cycles. The paper draws five, in "
        "no stated unit."
    )
    figure = canvas("Paper D, fig. 4: eigenvectors of the left knee's flexion", 3.0, caption)
    titles = {f"eigenvectors/{KNEE}": "Θ", f"eigenvectors/{KNEE}, derivative": "∂Θ/∂μ"}
    for axes, (name, title) in zip(figure.subplots(1, 2), titles.items(), strict=True):
        _draw_named(axes, run, name, title)
    return figure


FIGURES = {
    "a_fig3_eigencurves": PaperFigure(("learn_walk",), OURS, learned_walk),
    "b_fig1_left_period": PaperFigure(("period_snr",), OURS, periods),
    "b_fig1_right_alignment": PaperFigure(("align_cycles",), OURS, alignment),
    "b_gaps": PaperFigure(("impute_gaps",), OURS, gaps),
    "c_fig3_temperature": PaperFigure(("temperature",), OURS, temperatures),
    "c_fig4_coefficients": PaperFigure(("coefficient_histograms",), OURS, coefficients),
    "c_tree_balance": PaperFigure(("tree_balance",), OURS, tree_balance),
    "d_fig1_motion_model": PaperFigure(("learn_walk_run",), OURS, motion_model),
    "d_fig4_eigenvectors": PaperFigure(("learn_walk_run",), OURS, eigenvectors),
}
