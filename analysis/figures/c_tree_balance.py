"""Paper C, section 4.1: how the binary tree fills, in leaf sizes and level after level.

From tree_balance. The paper says it in words: approximately balanced, zero to several hundred samples in a leaf.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.readings import OURS, Reading
from analysis.figures.style import canvas, rows
from workbench.core.study import Bars, Curves
from workbench.recording.read.reader import Run
from workbench.recording.study.drawing import draw_bars, draw_curves

EXPERIMENTS = ("tree_balance",)
READINGS = OURS


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw leaves by size, in leaves and in entries; what every level leaves to search, and how it splits."""
    run = readings["tree_balance"].ours
    result = run.result
    figure = canvas(
        "Paper C, section 4.1: leaves and balance of the sign tree",
        5.4,
        f"Ours: {result['n_entries']:.0f} windows ({_motions(run)}), {result['n_levels']:.0f} levels. Solid: "
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
        axes.set_xticks(drawn.x, [_size(int(k)) for k in drawn.x])
        axes.set_xlabel("windows in a leaf, from this many on")
    curves = [drawn for drawn in run.figures if isinstance(drawn, Curves)]
    for k, (axes, drawn) in enumerate(zip(lower.subplots(1, len(curves)), curves, strict=True)):
        draw_curves(axes, drawn, labels=k == len(curves) - 1)
        axes.set_title(drawn.name.partition("/")[2])
    return figure


def _motions(run: Run) -> str:
    return str(run.settings["prior"].get("motions", "recorded"))


def _size(size_class: int) -> str:
    """Name a class of leaf sizes, 0, 1, 2–3, 4–7 …, by its least."""
    return str(1 << size_class - 1) if size_class else "0"
