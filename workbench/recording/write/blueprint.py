"""How the viewer lays a recording out for a person who opens it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from workbench.recording.write import marginal_pictures, verdict_view
from workbench.recording.write import point_fit_views as fit
from workbench.recording.write import series_styles as styles
from workbench.recording.write.images import OVERLAYS, Picture
from workbench.recording.write.posterior import DEGREES, PARAMETERS, ranks_view
from workbench.recording.write.scene import ESTIMATE
from workbench.utils.arrays import FloatArray

MOST_BESIDE = 4
"""Cameras whose images are shown beside each other; of more, one at a time."""
KEY = {
    "truth": "truth blue", "marks": "marks blue", "particles": "particles purple", "keypoints": "keypoints green",
}  # fmt: skip
"""What may be drawn beside the estimate, and how titles call it; marks and keypoints in images only."""
# of a window of 1500 × 950, the least one that is looked at: heights, and a legend's row and frame
HEIGHT, CURVES_HEIGHT, ROW, FRAME = 815.0, 170.0, 23.0, 14.0
_AXIS, _LANE = 54.0, 40.0
_LETTERS = 190  # of the verdict in one line


@dataclass(frozen=True, eq=False)
class Shown:
    """What there is to show of a run.

    person: (3,), where the person is first, m. towards: (2,), horizontally from the person to where to look from.
    parameters, units: along the first axis of the marginals' tensor; pictured: the parameters with a picture of their
    own. metrics: names under metrics/. n_particles: of a step. flexions: names under flexion/, of a fit to points.
    activity: what the person does is told. surface: its mesh is drawn. warned: there are warnings. constant: metrics
    that say nothing. drawn: keys of KEY. Of a run that is over, lanes: those of states over time, such as whether it
    is held; sparse: metrics of less than half of the frames, shown as marks; spans: by path the least and largest
    value of curves, above which legends find room; residuals: of these, what cameras tell; letters: of the verdict.
    """

    cameras: Sequence[Picture]
    person: FloatArray
    towards: FloatArray
    parameters: Sequence[str]
    units: Sequence[str]
    pictured: Sequence[str]
    metrics: Sequence[str]
    n_coefficients: int
    n_particles: int
    flexions: Sequence[str] = ()
    activity: bool = False
    surface: bool = False
    warned: bool = False
    constant: frozenset[str] = frozenset()
    drawn: frozenset[str] = frozenset()
    lanes: Sequence[str] = ()
    sparse: frozenset[str] = frozenset()
    spans: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    residuals: Sequence[str] = ()
    letters: int = 0

    def key(self, *names: str) -> str:
        """Say which colour is what, of the estimate and those of `names` that are drawn."""
        return ", ".join(["estimate orange", *(KEY[name] for name in names if name in self.drawn)])


@cache
def no_legend() -> rrb.PlotLegend:
    """Return a plot's hidden legend; made on first use, as making it takes Rerun a quarter of a second."""
    return rrb.PlotLegend(visible=False)


def layout(shown: Shown) -> rrb.Blueprint:
    """Lay out where the person is, on the left; on the right how wrong the estimate is, how sure, and the posterior.

    A fit to points has flexion against the truth and the activity told before the errors.
    """
    left: list[rrb.View | rrb.Container] = [_images(shown)] if shown.cameras else []
    shares = [*[1.0] * len(left), 1.5 if shown.flexions else 1.0]  # points are seen in the world only
    left.append(_world(shown))
    if shown.lanes:
        height = _AXIS + _LANE * len(shown.lanes)
        left.append(verdict_view.lanes(shown.lanes))
        shares.append(sum(shares) * height / (HEIGHT - height))
    content = rrb.Horizontal(rrb.Vertical(*left, row_shares=shares), _numbers(shown))
    lines = -(-shown.letters // _LETTERS)
    return page(rrb.Vertical(verdict_view.view(), content, row_shares=[1.0 + 0.3 * max(lines - 1, 0), 12.0]))


def page(content: rrb.Container, fps: float | None = 15.0) -> rrb.Blueprint:
    """Return a layout of nothing but the content and, below it, the time line."""
    panel = rrb.TimePanel(timeline="frame", state="collapsed", fps=fps)
    return rrb.Blueprint(content, panel, auto_views=False, collapse_panels=True)


def _numbers(shown: Shown) -> rrb.Vertical:
    """Errors, certainty, and the posterior in four ways with other numbers and where the run came from."""
    errors, details = _errors(shown), _details(shown)
    coverage = [_metric("coverage_90", shown, (0.0, 1.0))] if "coverage_90" in shown.metrics else []
    above: list[rrb.View | rrb.Container]
    if shown.flexions:
        above = [fit.views(shown.flexions), *[fit.timeline()] * shown.activity]
        beside = [*errors, *coverage]
        pairs = [rrb.Horizontal(*beside[k : k + 2], name="coverage" if k else "errors") for k in (0, 2) if beside[k:]]
        below = rrb.Tabs(*pairs, *details)  # of three the titles would be cut
        return rrb.Vertical(*above, below, row_shares=[2.4, *[0.8] * shown.activity, 1.4])
    title = f"effective sample size (of {shown.n_particles})"
    ess = [] if "ess" in shown.constant else [_metric("ess", shown, (0.0, float(shown.n_particles)), title)]
    doubts = _doubts(shown)
    above = [rrb.Horizontal(*errors, name="errors")] if errors else []
    above += [rrb.Horizontal(*ess, *coverage, name="certainty")] if ess or coverage else []
    shares = [*[1.4] * bool(errors), *[0.8] * bool(ess or coverage), *[0.8] * len(doubts), 2.0]
    return rrb.Vertical(*above, *doubts, rrb.Tabs(*details), row_shares=shares)


def _images(shown: Shown) -> rrb.Container:
    """What the cameras saw; of several only their names, since there is no room for more."""
    title = f"image: {shown.key(*KEY)}"
    several = len(shown.cameras) > 1
    images = [
        rrb.Spatial2DView(origin=f"{picture.path}/image", name=picture.camera.name if several else title)
        for picture in shown.cameras
    ]
    return rrb.Horizontal(*images) if len(images) <= MOST_BESIDE else rrb.Tabs(*images)


def _world(shown: Shown) -> rrb.Spatial3DView:
    """The person from three metres away, without what is drawn over the images; the eye follows the person."""
    followed = "surface" if shown.surface else "body"  # where the surface is, the solid limbs are not
    controls = rrb.EyeControls3D(
        position=[*(shown.person[:2] + shown.towards), shown.person[2] + 0.6], look_target=shown.person,
        eye_up=[0.0, 0.0, 1.0], tracking_entity=f"/{ESTIMATE}/{followed}",
    )  # fmt: skip
    overlays = [f"- {picture.path}/image/{name}" for picture in shown.cameras for name in OVERLAYS]
    contents = ["$origin/**", *overlays, *[f"- /{ESTIMATE}/body"] * shown.surface]
    flat = [KEY[name] for name in ("marks", "keypoints") if name in shown.drawn]
    also = f"; in the images {', '.join(flat)}" if flat and len(shown.cameras) > 1 else ""
    name = f"world: {shown.key('truth', 'particles')}{also}"
    return rrb.Spatial3DView(origin="/world", contents=contents, name=name, eye_controls=controls)


def _errors(shown: Shown) -> list[rrb.View]:
    """Distances from the true joints in the world, and in the image; without truth, from each camera's keypoints.

    The heaviest particle is drawn once, and not where it is the expected pose.
    """
    groups = {"error_abs_mm": styles.errors_mm(shown.metrics), "error_px": styles.errors_px(shown.metrics)}
    views: list[rrb.View] = []
    for first, names in groups.items():
        drawn = [
            name for name in names
            if name not in shown.constant
            and (not name.endswith("_map") or not (shown.flexions or name == "error_rel_mm_map"))
        ]  # fmt: skip
        views += [_curves(styles.title(first), drawn, shown)] if drawn else []
    if shown.residuals and "error_abs_mm" not in shown.metrics:
        legend, axis = _legend(shown.residuals, shown)
        name, paths = "joints from each camera's keypoints (pixels)", [f"/{path}" for path in shown.residuals]
        views.append(
            rrb.TimeSeriesView(origin="/residual_px", contents=paths, name=name, plot_legend=legend, axis_y=axis)
        )
    return views


def _doubts(shown: Shown) -> list[rrb.View]:
    """Which joints not to trust, as the posterior itself says; thin beside it, where there is truth, their errors."""
    names = styles.doubts(shown.metrics)
    groups = [f"{each} {colour}" for each, (colour, _) in styles.DOUBTS.items() if f"doubt_{each}_mm" in names]
    thin = ", thin the true one" if any(name.startswith("missed_") for name in names) else ""
    title = f"do not trust what is high: stated error (mm){thin}; {', '.join(groups)}"
    return [_curves(title, names, shown, named=True)] if names else []


def _details(shown: Shown) -> list[rrb.View | rrb.Container]:
    warnings = [rrb.TextLogView(origin="/log", name="warnings")] if shown.warned else []
    config = rrb.TextDocumentView(origin="/__properties/config", name="config")
    ranked = [rrb.Horizontal(ranks_view(), name="ranks")] if "log_score" in shown.metrics else []
    coefficients = [  # samples, and the model as thin bars before them
        rrb.BarChartView(origin=f"/coefficients/{k}", name=f"c{k}, model grey", plot_legend=no_legend())
        for k in range(1, shown.n_coefficients + 1)
    ]
    row = [rrb.Horizontal(*coefficients, name="coefficients")] if coefficients else []
    return [_bands(shown), _marginals(shown), *row, *ranked, *_others(shown), *warnings, config]


def _unit(shown: Shown, name: str) -> str:
    return shown.units[shown.parameters.index(name)]


def _bands(shown: Shown) -> rrb.Grid:
    """Of the estimate, orange, with the truth, blue; angles in degrees."""
    views = [
        rrb.TimeSeriesView(
            origin=f"/{DEGREES if _unit(shown, name) == 'rad' else PARAMETERS}/{name}",
            name=styles.title(name, _unit(shown, name)),
            plot_legend=no_legend(),
        )
        for name in shown.pictured
    ]
    return rrb.Grid(*views, grid_columns=2, name="5–95 % bands")


def _marginals(shown: Shown) -> rrb.Tabs:
    pictures = [marginal_pictures.view(name, styles.title(name, _unit(shown, name))) for name in shown.pictured]
    return rrb.Tabs(
        rrb.Grid(*pictures, grid_columns=2, name="brightness"),
        _marginal("any parameter", 0),
        rrb.TextDocumentView(origin="/posterior/legend", name="values of the axes"),
        name="log posterior",
    )


def _marginal(name: str, index: int) -> rrb.TensorView:
    """One parameter's marginal: frames to the right, values upwards, brightness the log posterior (paper A, fig. 4)."""
    slices = rrb.TensorSliceSelection(
        width=2,
        height=rr.TensorDimensionSelection(dimension=1, invert=True),
        indices=[rr.TensorDimensionIndexSelection(dimension=0, index=index)],
    )
    mapping = rrb.TensorScalarMapping(colormap="inferno", mag_filter="nearest")
    return rrb.TensorView(
        origin="/posterior/marginals", name=styles.title(name), view_fit="fill", scalar_mapping=mapping,
        slice_selection=slices,
    )  # fmt: skip


def _others(shown: Shown) -> list[rrb.Grid]:
    """The metrics that are shown nowhere else, and the shares of the cues in one plot."""
    shares = styles.shares(shown.metrics)
    elsewhere = {"coverage_90", *styles.errors_mm(shown.metrics), *styles.errors_px(shown.metrics), *shares}
    elsewhere |= shown.constant | (set() if shown.flexions else {"ess", *styles.doubts(shown.metrics)})
    together = [_curves("shares of the cues in what tells particles apart", shares, shown)] if shares else []
    views = [*together, *(_metric(name, shown) for name in shown.metrics if name not in elsewhere)]
    return [rrb.Grid(*views, name="numbers")] if views else []


def _curves(title: str, metrics: Sequence[str], shown: Shown, named: bool = False) -> rrb.TimeSeriesView:
    """Several metrics in one plot. named: by the title, so that no legend is needed."""
    paths = [f"metrics/{name}" for name in metrics]
    legend, axis = (no_legend(), None) if named or len(metrics) == 1 else _legend(paths, shown)
    return rrb.TimeSeriesView(
        origin="/metrics", contents=[f"/{path}" for path in paths], name=title, plot_legend=legend, axis_y=axis,
        overrides=_marks(metrics, shown),
    )  # fmt: skip


def _metric(
    name: str, shown: Shown, span: tuple[float, float] | None = None, title: str | None = None
) -> rrb.TimeSeriesView:
    """One metric, with what it should be."""
    axis, title = None if span is None else rrb.ScalarAxis(range=span), title or styles.title(name)
    paths = [f"/metrics/{name}", *[f"/{path}" for path in styles.guides([name])]]
    return rrb.TimeSeriesView(
        origin=paths[0], contents=paths, name=title, plot_legend=no_legend(), axis_y=axis,
        overrides=_marks([name], shown),
    )  # fmt: skip


def _marks(metrics: Sequence[str], shown: Shown) -> dict[Any, rr.SeriesPoints]:
    """Those of the metrics that few frames have, as marks; a threshold stays a line."""
    found = [name for name in metrics if name in shown.sparse and name != "forearm_px"]
    return {f"/metrics/{name}": styles.marks(name, shown.metrics) for name in found}


def _legend(paths: Sequence[str], shown: Shown) -> tuple[rrb.PlotLegend, rrb.ScalarAxis | None]:
    """A legend of as many curves, and an axis that leaves room for it above them once their spans are known."""
    legend = rrb.PlotLegend(corner=rrb.Corner2D.LeftTop)
    if not paths or not set(paths) <= shown.spans.keys():
        return legend, None
    low, high = min(shown.spans[path][0] for path in paths), max(shown.spans[path][1] for path in paths)
    spread = max(high - low, 1e-3 * max(abs(high), 1e-6))
    room = min((FRAME + ROW * len(paths)) / CURVES_HEIGHT, 0.65)
    return legend, rrb.ScalarAxis(range=(low - 0.05 * spread, high + 0.03 * spread + spread * room / (1.0 - room)))
