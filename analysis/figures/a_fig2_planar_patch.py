"""Paper A, fig. 2: the planar patch against the cylinder it stands for, measured.

At the scale of walk_straight: how far the patch puts a point of the surface from where it is seen.
"""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.figures.readings import OURS, PaperFigure, Reading
from analysis.figures.style import bare, canvas
from workbench.recording.study.drawing import ESTIMATE, INK, SERIES, TRUTH, label_ends
from workbench.utils.arrays import FloatArray

LENGTH_M, RADIUS_M, DISTANCE_M = 0.42, 0.07, 4.0
"""A thigh, and how far from the camera its middle is."""
ALPHAS_DEG = np.arange(0.0, 81.0, 2.0)
SHOWN_DEG = 40.0
EDGE_DEG = 85.0
"""Azimuth on the surface, from what faces the camera, up to which points count."""


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw a limb's surface and its patch as seen; the patch's error over the limb's angle; and that of a turn it
    misses."""
    px_per_m = readings["walk_straight"].ours.settings["dataset"]["person_px"] / 1.75
    errors = {
        share: np.array([np.quantile(px_per_m * off_m(alpha), share) for alpha in np.radians(ALPHAS_DEG)])
        for share in (0.5, 0.9)
    }
    twist = px_per_m * RADIUS_M * np.radians(5.0)
    at = {alpha: float(errors[0.9][np.searchsorted(ALPHAS_DEG, alpha)]) for alpha in (0.0, 60.0)}
    figure = canvas(
        "Paper A, fig. 2: exact and approximate projection of a limb",
        3.0,
        f"A thigh, {DISTANCE_M:.0f} m away, {px_per_m * LENGTH_M:.0f} px long. Left, α = {SHOWN_DEG:.0f}°, blue: the "
        "half of the cylinder that is seen; orange: the patch. Nine in ten points of the surface are put less than "
        f"{at[0.0]:.1f} px from where they are seen with the limb in the image plane, and {at[60.0]:.1f} px at α = "
        f"60°, of a radius of {px_per_m * RADIUS_M:.1f} px. What turns about the limb's axis the patch leaves where it "
        f"is: by 5° that is {twist:.1f} px in the middle. The paper shows both and gives no error.",
    )
    limb, curve = figure.subplots(1, 2, width_ratios=(1.0, 1.6))
    _grids(limb, np.radians(SHOWN_DEG))
    ends = []
    for share, colour in zip(errors, SERIES[2:], strict=False):
        curve.plot(ALPHAS_DEG, errors[share], color=colour)
        ends.append((f"{100 * share:.0f} % of the points", colour, float(ALPHAS_DEG[-1]), float(errors[share][-1])))
    curve.set_xlabel("angle α of the limb and the image plane (degrees)")
    curve.set_ylabel("off by (px)")
    curve.set_ylim(bottom=0.0)
    curve.margins(x=0.0)
    label_ends(curve, ends, gap=0.1)
    return figure


def projections(alpha: float, u: FloatArray, azimuth: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return where points of a cylinder are seen and where its patch puts them, (..., 2), m at DISTANCE_M.

    u: along the limb, 0..1. azimuth: rad, from the direction that faces the camera. alpha: rad, of the axis with the
    image plane. The camera looks along z. The patch's corners are projected, the points between them interpolated.
    """
    axis, across = np.array([0.0, np.cos(alpha), np.sin(alpha)]), np.array([1.0, 0.0, 0.0])
    facing = np.cross(axis, across)
    facing = facing if facing[2] < 0.0 else -facing
    middle = np.array([0.0, 0.0, DISTANCE_M])
    on_axis = middle + LENGTH_M * (u[..., None] - 0.5) * axis
    surface = on_axis + RADIUS_M * (np.sin(azimuth)[..., None] * across + np.cos(azimuth)[..., None] * facing)
    ends = [middle + LENGTH_M * (end - 0.5) * axis for end in (0.0, 1.0)]
    corners = _seen(np.array([[end + side * RADIUS_M * across for side in (-1.0, 1.0)] for end in ends]))
    v = np.sin(azimuth)
    weights = np.stack([(1 - u) * (1 - v), (1 - u) * (1 + v), u * (1 - v), u * (1 + v)], axis=-1) / 2.0
    return _seen(surface), weights @ corners.reshape(4, 2)


def off_m(alpha: float) -> FloatArray:
    """Return how far the patch is off, m at DISTANCE_M, at points spread evenly over the surface that is seen."""
    edge = np.radians(EDGE_DEG)
    u, azimuth = np.meshgrid(np.linspace(0.0, 1.0, 21), np.linspace(-edge, edge, 41))
    exact, patch = projections(alpha, u, azimuth)
    return np.linalg.norm(patch - exact, axis=-1)


def _seen(points: FloatArray) -> FloatArray:
    return DISTANCE_M * points[..., :2] / points[..., 2:]


def _grids(axes: Axes, alpha: float) -> None:
    """Draw lines along and around the surface, and the same lines of the patch."""
    u, azimuth = np.meshgrid(np.linspace(0.0, 1.0, 9), np.radians(np.linspace(-EDGE_DEG, EDGE_DEG, 9)))
    for points, colour in zip(projections(alpha, u, azimuth), (TRUTH, ESTIMATE), strict=True):
        axes.plot(*points.transpose(2, 0, 1), color=colour, linewidth=0.9)
        axes.plot(*points.transpose(2, 1, 0), color=colour, linewidth=0.9)
    axes.set_title("surface and patch", color=INK)
    bare(axes)


FIGURES = {"a_fig2_planar_patch": PaperFigure(("walk_straight",), OURS, draw)}
