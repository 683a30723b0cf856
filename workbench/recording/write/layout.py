"""The viewer's layout of a recording."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from workbench.body.angles import FLEXIONS
from workbench.evaluation.metrics import CALIBRATED, CALIBRATION, row_of
from workbench.evaluation.verdict.joint_states import JOINT_GROUPS
from workbench.recording.write import styles
from workbench.recording.write.images import OVERLAYS, RecordedCamera
from workbench.recording.write.outcome import REPROJECTION_ERRORS, STATE, VERDICT
from workbench.recording.write.posterior import DEGREES, PARAMETERS, PICTURE_SIZE, PICTURES, RANKS, Posterior
from workbench.recording.write.scene import ACTIVITY, ESTIMATE, FLEXION
from workbench.recording.write.styles import title
from workbench.utils.arrays import FloatArray

_MAX_IN_ROW = 4
"""Cameras whose images are shown in one row; more are shown one at a time."""
KEY = {
    "truth": "truth blue", "annotations": "annotations blue", "particles": "particles purple",
    "keypoints": "keypoints green",
}  # fmt: skip
"""Overlays that may be drawn with the estimate, and their titles; annotations and keypoints in images only."""
_LANES = {
    "tracking": "tracked, doubtful or lost", "large_expected_error": "large expected error", "foot_left": "stance",
    "foot_right": "stance", **dict.fromkeys(JOINT_GROUPS, "parts of the body"),
}  # fmt: skip
_EXPECTED, _TRUE, _CUES = "expected_error_<group>_mm", "mpjpe_abs_<group>_mm", "variance_fraction_<cue>"
"""Families of metrics, each in one plot."""
_LANE_SHARE = 0.08
"""Height of a lane of states over that of images and world, and of its axis as well."""
_LINE_CHARACTERS = 190  # of the verdict

_LEGEND = rrb.PlotLegend(corner=rrb.Corner2D.LeftTop)

_Part = rrb.View | rrb.Container


@dataclass(frozen=True, eq=False)
class LayoutInput:
    """The contents of a recording that the layout shows.

    person: (3,), m, first position of the person. towards: (2,), m, horizontally from the person to the viewpoint.
    metrics: names under metrics/. n_particles: of a step. flexions: names under flexion/, of a fit to points.
    activity: the activity is estimated. surface: its mesh is drawn. warned: there are warnings. uninformative: metrics
    equal in all runs of such components. drawn: keys of KEY.
    Of a run that ended: lanes: of states over time; sparse: metrics of less than half of the frames, drawn as points;
    reprojection_errors: their paths; n_characters: of the verdict.
    """

    cameras: Sequence[RecordedCamera]
    person: FloatArray
    towards: FloatArray
    posterior: Posterior
    metrics: Sequence[str]
    n_particles: int
    flexions: Sequence[str] = ()
    activity: bool = False
    surface: bool = False
    warned: bool = False
    uninformative: frozenset[str] = frozenset()
    drawn: frozenset[str] = frozenset()
    lanes: Sequence[str] = ()
    sparse: frozenset[str] = frozenset()
    reprojection_errors: Sequence[str] = ()
    n_characters: int = 0

    def key(self, *names: str) -> str:
        """Return the colours of the estimate and of the drawn overlays among `names`, in words."""
        return ", ".join(["estimate orange", *(KEY[name] for name in names if name in self.drawn)])


def layout(data: LayoutInput) -> rrb.Blueprint:
    """Return the layout: images and world on the left; errors, uncertainty and posterior on the right.

    A fit to points has flexion and the estimated activity before the errors.
    """
    left: list[tuple[float, _Part]] = [(1.0, _images(data))] if data.cameras else []
    left.append((1.5 if data.flexions else 1.0, _world(data)))  # points are drawn in the world only
    if data.lanes:
        name, share = ", ".join(dict.fromkeys(_LANES[lane] for lane in data.lanes)), _LANE_SHARE * (1 + len(data.lanes))
        lanes = rrb.StateTimelineView(origin=f"/{STATE}", name=f"states: {name}")
        left.append((share * sum(fraction for fraction, _ in left), lanes))
    content = rrb.Horizontal(_stack(*left), _stack(*(_fit(data) if data.flexions else _numbers(data))))
    lines = -(-data.n_characters // _LINE_CHARACTERS)
    return page(_stack((1.0 + 0.3 * max(lines - 1, 0), _verdict()), (12.0, content)))


def page(content: rrb.Container, fps: float | None = 15.0) -> rrb.Blueprint:
    """Return a layout of the content with the timeline below it."""
    panel = rrb.TimePanel(timeline="frame", state="collapsed", fps=fps)
    return rrb.Blueprint(content, panel, auto_views=False, collapse_panels=True)


def trails_layout(
    places: FloatArray, dof_names: Sequence[str], metrics: Sequence[str], warned: bool = False
) -> rrb.Blueprint:
    """Return the layout of a run without images: the verdict, the person's path from its right side, and curves.

    Parameters
    ----------
    places : (F, J, 3), m, the joints so far.
    dof_names : of the pose; hips and knees have curves, left and right in the colours of the hands.
    metrics : each has a plot.
    warned : there are warnings.
    """
    plots = [_plot(row_of(name).heading, f"/metrics/{name}") for name in metrics]
    for joint in ("hip", "knee"):
        sides = {"left": styles.ESTIMATE, "right": styles.RIGHT_HAND}
        curves: dict[Any, Any] = {
            f"/{DEGREES}/{side}_{joint}_flexion/mean": styles.line(side, colour, 2.0)
            for side, colour in sides.items() if f"{side}_{joint}_flexion" in dof_names
        }  # fmt: skip
        if curves:
            plots.append(_plot(f"flexion of the {joint}s (degrees)", f"/{DEGREES}", [*curves], overrides=curves))
    lower, upper = places.min(axis=(0, 1)), places.max(axis=(0, 1))
    center, diagonal = 0.5 * (lower + upper), float(np.linalg.norm(upper - lower))
    heading = places[-1, 0, :2] - places[0, 0, :2]
    heading = heading / np.linalg.norm(heading) if np.linalg.norm(heading) > 0.1 else np.array([1.0, 0.0])
    eye = center + max(0.48 * diagonal, 2.2) * np.array([heading[1], -heading[0], 0.12])
    name = "world: path grey, left wrist orange, right wrist green, as the legs below"
    controls = rrb.EyeControls3D(position=eye, look_target=center, eye_up=[0.0, 0.0, 1.0])
    world = rrb.Spatial3DView(origin="/world", name=name, eye_controls=controls)
    below = rrb.Tabs(rrb.Horizontal(*plots, name="curves"), *_texts(warned))
    return page(_stack((0.25, _verdict()), (2.2, world), (1.0, below)))


def _stack(*parts: tuple[float, _Part]) -> rrb.Vertical:
    """Return a vertical layout of (fraction of the height, part)."""
    return rrb.Vertical(*(part for _, part in parts), row_shares=[height for height, _ in parts])


def _verdict() -> rrb.TextDocumentView:
    return rrb.TextDocumentView(origin=f"/{VERDICT}", name="verdict")


def _texts(warned: bool) -> list[_Part]:
    config = rrb.TextDocumentView(origin="/__properties/config", name="config")
    return [*[rrb.TextLogView(origin="/log", name="warnings")] * warned, config]


def _numbers(data: LayoutInput) -> list[tuple[float, _Part]]:
    """Return errors, uncertainty, and the posterior in tabs."""
    errors, rows = _errors(data), list[tuple[float, _Part]]()
    name = f"{row_of('ess').title} (of {data.n_particles})"
    ess = [] if "ess" in data.uninformative else [_metric("ess", data, float(data.n_particles), name)]
    if errors:
        rows.append((1.4, rrb.Horizontal(*errors, name="errors")))
    if uncertainty := [*ess, *_coverage(data)]:
        rows.append((0.8, rrb.Horizontal(*uncertainty, name="uncertainty")))
    return [*rows, (2.0, rrb.Tabs(*_details(data)))]


def _fit(data: LayoutInput) -> list[tuple[float, _Part]]:
    """Return flexions of both sides, the activity, and errors and posterior in tabs."""
    plots = [
        _plot(f"{name.replace('_', ' ')} flexion (degrees)", f"/{FLEXION}/{name}")
        for name in FLEXIONS if name in data.flexions
    ]  # fmt: skip
    rows: list[tuple[float, _Part]] = [(2.4, rrb.Grid(*plots, grid_columns=2, name="flexion"))]
    if data.activity:
        rows.append((0.8, rrb.StateTimelineView(origin=f"/{ACTIVITY}", name="activity")))
    views = [*_errors(data), *_coverage(data)][:2]  # of three in a row the titles would be cut
    errors = [rrb.Horizontal(*views, name="errors")] if views else []
    return [*rows, (1.4, rrb.Tabs(*errors, *_details(data)))]


def _images(data: LayoutInput) -> rrb.Container:
    """Return the cameras' images; several have their names as short titles."""
    name, several = f"image: {data.key(*KEY)}", len(data.cameras) > 1
    images = [
        rrb.Spatial2DView(origin=f"{each.path}/image", name=each.camera.name if several else name)
        for each in data.cameras
    ]
    return rrb.Horizontal(*images) if len(images) <= _MAX_IN_ROW else rrb.Tabs(*images)


def _world(data: LayoutInput) -> rrb.Spatial3DView:
    """Return a view of the person from the viewpoint, without overlays on images; the eye follows the person."""
    followed = "surface" if data.surface else "body"  # the surface replaces the solid limbs
    controls = rrb.EyeControls3D(
        position=[*(data.person[:2] + data.towards), data.person[2] + 0.6], look_target=data.person,
        eye_up=[0.0, 0.0, 1.0], tracking_entity=f"/{ESTIMATE}/{followed}",
    )  # fmt: skip
    overlays = [f"- {each.path}/image/{name}" for each in data.cameras for name in OVERLAYS]
    contents = ["$origin/**", *overlays, *[f"- /{ESTIMATE}/body"] * data.surface]
    flat = [KEY[name] for name in ("annotations", "keypoints") if name in data.drawn]
    also = f"; in the images {', '.join(flat)}" if flat and len(data.cameras) > 1 else ""
    points = "; points by body part, grey unassigned" if data.flexions else ""
    name = f"world: {data.key('truth', 'particles')}{also}{points}"
    return rrb.Spatial3DView(origin="/world", contents=contents, name=name, eye_controls=controls)


def _errors(data: LayoutInput) -> list[rrb.View]:
    """Return plots of joint errors in the world and in the image, or of reprojection errors without a ground truth.

    Errors of the particle of largest weight are not drawn in a fit, where it equals the expected pose.
    """
    views: list[rrb.View] = []
    for plot in ("mpjpe_abs_mm", "mpjpe_px"):
        drawn = [
            name for name in _in_plot(plot, data.metrics)
            if name not in data.uninformative and not (data.flexions and name.endswith("_max_weight"))
        ]  # fmt: skip
        views += [_metrics(row_of(plot).heading, drawn, data)] if drawn else []
    if data.reprojection_errors and "mpjpe_abs_mm" not in data.metrics:
        name, paths = "reprojection error by camera (px)", [f"/{path}" for path in data.reprojection_errors]
        views.append(_plot(name, f"/{REPROJECTION_ERRORS}", paths, legend=_LEGEND))
    return views


def _coverage(data: LayoutInput) -> list[rrb.View]:
    return [_metric(name, data, 1.0) for name in data.metrics if name in CALIBRATED]


def _details(data: LayoutInput) -> list[_Part]:
    units = {name: data.posterior.unit(name) for name in data.posterior.shown_parameters}
    places = {name: f"{DEGREES if unit == 'rad' else PARAMETERS}/{name}" for name, unit in units.items()}
    intervals = [_plot(title(name, units[name]), f"/{place}") for name, place in places.items()]
    tabs: list[_Part] = [rrb.Grid(*intervals, grid_columns=2, name="90 % intervals"), _posterior(units, data)]
    drawn = {plot: _in_plot(plot, data.metrics) for plot in (_EXPECTED, _TRUE)}
    if by_group := [_metrics(row_of(plot).heading, names, data) for plot, names in drawn.items() if names]:
        tabs.insert(1, rrb.Horizontal(*by_group, name="errors by group"))
    elsewhere = {*data.uninformative, *(() if data.flexions else ("ess", *CALIBRATED))}
    others = [name for name in data.metrics if row_of(name).plot == "" and name not in elsewhere]
    calibration = [_metric(name, data) for name in others if row_of(name).section == CALIBRATION]
    numbers = [_metric(name, data) for name in others if row_of(name).section != CALIBRATION]
    if fractions := _in_plot(_CUES, data.metrics):
        numbers.insert(0, _metrics(row_of(_CUES).heading, fractions, data))
    ranks = _bars("ranks of the truth (uniform: calibrated, U: overconfident)", f"/{RANKS}")
    if calibration:
        grid = rrb.Grid(*calibration, grid_columns=3, name="coverage and scores")
        tabs.append(rrb.Tabs(*[ranks] * ("nll" in data.metrics), grid, name="calibration"))
    tabs += [rrb.Grid(*numbers, grid_columns=3, name="numbers")] if numbers else []
    return [*tabs, *_texts(data.warned)]


def _posterior(units: Mapping[str, str], data: LayoutInput) -> rrb.Tabs:
    """Return pictures of marginals, the tensor of all, and the coefficients' histograms.

    Marginals have frames to the right and values upwards (paper A, fig. 4).
    """
    width, height = PICTURE_SIZE
    bounds = rrb.VisualBounds2D(x_range=[-50.0, width + 8.0], y_range=[-10.0, height + 24.0])
    pictures = [
        rrb.Spatial2DView(origin=f"/{PICTURES}/{name}", name=title(name, unit), visual_bounds=bounds)
        for name, unit in units.items()
    ]
    slices = rrb.TensorSliceSelection(
        width=2,
        height=rr.TensorDimensionSelection(dimension=1, invert=True),
        indices=[rr.TensorDimensionIndexSelection(dimension=0, index=0)],
    )
    tensor = rrb.TensorView(
        origin="/posterior/marginals", name="any parameter", view_fit="fill", slice_selection=slices,
        scalar_mapping=rrb.TensorScalarMapping(colormap="inferno", mag_filter="nearest"),
    )  # fmt: skip
    axes = rrb.TextDocumentView(origin="/posterior/legend", name="values of the axes")
    bars = [_bars(f"c{k}, model grey", f"/coefficients/{k}") for k in range(1, len(data.posterior.coefficients) + 1)]
    coefficients = [rrb.Horizontal(*bars, name="coefficients")] if bars else []
    brightness = rrb.Grid(*pictures, grid_columns=2, name="log marginals")
    return rrb.Tabs(brightness, tensor, axes, *coefficients, name="posterior")


def _metrics(name: str, metrics: Sequence[str], data: LayoutInput) -> rrb.TimeSeriesView:
    """Return a plot of metrics, with a legend if there are several."""
    paths = [f"/metrics/{each}" for each in metrics]
    return _plot(name, "/metrics", paths, legend=_LEGEND if len(metrics) > 1 else None, overrides=_dots(metrics, data))


def _metric(metric: str, data: LayoutInput, maximum: float | None = None, name: str = "") -> rrb.TimeSeriesView:
    """Return a plot of one metric with its reference value; its axis is from 0 to a maximum, or the metric's."""
    contents = [f"/{path}" for path in (f"metrics/{metric}", *styles.guides([metric]))]
    margin = 0.06 * (maximum or 0.0)  # else the viewer cuts the labels at the ends
    axis = None if maximum is None else rrb.ScalarAxis(range=(-margin, maximum + margin))
    return _plot(name or row_of(metric).heading, contents[0], contents, axis=axis, overrides=_dots([metric], data))


def _plot(
    name: str, origin: str, contents: Sequence[str] | str = "$origin/**", *, legend: rrb.PlotLegend | None = None,
    axis: rrb.ScalarAxis | None = None, overrides: Mapping[Any, Any] | None = None,
) -> rrb.TimeSeriesView:  # fmt: skip
    """Return a plot of curves; legend: hidden by default."""
    return rrb.TimeSeriesView(
        origin=origin, contents=contents, name=name, plot_legend=legend or rrb.PlotLegend(visible=False), axis_y=axis,
        overrides=overrides,
    )  # fmt: skip


def _bars(name: str, origin: str) -> rrb.BarChartView:
    """Return a bar chart; its reference is drawn as thin bars in front of it."""
    return rrb.BarChartView(origin=origin, name=name, plot_legend=rrb.PlotLegend(visible=False))


def _dots(metrics: Sequence[str], data: LayoutInput) -> dict[Any, rr.SeriesPoints]:
    """Return points as the style of sparse metrics; a threshold stays a line."""
    sparse = [name for name in metrics if name in data.sparse and name != "forearm_width_px"]
    return {f"/metrics/{name}": styles.dots(*styles.metric_style(name, data.metrics)) for name in sparse}


def _in_plot(plot: str, metrics: Sequence[str]) -> list[str]:
    """Return the metrics that are drawn in a shared plot; none if the only one is a threshold."""
    drawn = [name for name in metrics if row_of(name).plot == plot]
    return drawn if drawn != ["forearm_width_px"] else []
