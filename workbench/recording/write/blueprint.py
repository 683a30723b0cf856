"""How the viewer lays a recording out for a person who opens it."""

from collections.abc import Sequence
from dataclasses import dataclass

import rerun as rr
import rerun.blueprint as rrb

from workbench.arrays import FloatArray
from workbench.recording.write import point_fit_views as fit
from workbench.recording.write import series_styles as styles
from workbench.recording.write import verdict_view
from workbench.recording.write.images import OVERLAYS, Picture
from workbench.recording.write.posterior import ranks_view
from workbench.recording.write.scene import ESTIMATE

MOST_BESIDE = 4
"""Cameras whose images are shown beside each other; of more, one at a time."""
_NO_LEGEND = rrb.PlotLegend(visible=False)


@dataclass(frozen=True, eq=False)
class Shown:
    """What there is to show of a run.

    person: (3,), where the person is first, m. towards: (2,), horizontally from the person to where to look from.
    parameters, units: along the first axis of the marginals' tensor; pictured: the parameters with a picture of their
    own. metrics: names under metrics/. n_particles: of a step. flexions: names under flexion/, of a fit to points.
    activity: what the person does is told. surface: its mesh is drawn. warned: there are warnings. constant: metrics
    that say nothing. lanes: there are states over time, such as held.
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
    lanes: bool = False


def layout(shown: Shown) -> rrb.Blueprint:
    """Lay out where the person is, on the left; on the right how wrong the estimate is, how sure, and the posterior.

    A fit to points has flexion against the truth and the activity told before the errors.
    """
    truth = ["truth blue"] if any(name.startswith("error") for name in shown.metrics) else []
    key = ", ".join(["estimate orange", *truth, "particles purple"])
    images = [
        rrb.Spatial2DView(origin=f"{picture.path}/image", name=f"image ({picture.camera.name}): {key}")
        for picture in shown.cameras
    ]
    left = [rrb.Horizontal(*images) if len(images) <= MOST_BESIDE else rrb.Tabs(*images)] if images else []
    shares = [*[1.0] * len(left), 1.5 if shown.flexions else 1.0]  # points are seen in the world only
    content = rrb.Horizontal(rrb.Vertical(*left, _world(shown, key), row_shares=shares), _numbers(shown))
    return page(rrb.Vertical(verdict_view.view(), content, row_shares=[1.0, 12.0]))


def page(content: rrb.Container, fps: float | None = 15.0) -> rrb.Blueprint:
    """Return a layout of nothing but the content and, below it, the time line."""
    panel = rrb.TimePanel(timeline="frame", state="collapsed", fps=fps)
    return rrb.Blueprint(content, panel, auto_views=False, collapse_panels=True)


def _numbers(shown: Shown) -> rrb.Vertical:
    """Errors, certainty, and the posterior in four ways with other numbers and where the run came from."""
    errors, details = _errors(shown), _details(shown)
    coverage = [_metric("coverage_90", (0.0, 1.0))] if "coverage_90" in shown.metrics else []
    above: list[rrb.View | rrb.Container]
    if shown.flexions:
        above = [fit.views(shown.flexions), *[fit.timeline()] * shown.activity]
        first = [rrb.Horizontal(*errors, *coverage, name="errors and certainty")] if errors or coverage else []
        below = rrb.Tabs(*first, *details)
        return rrb.Vertical(*above, below, row_shares=[2.4, *[0.8] * shown.activity, 1.4])
    title = f"effective sample size (of {shown.n_particles})"
    ess = [] if "ess" in shown.constant else [_metric("ess", (0.0, float(shown.n_particles)), title)]
    above = [rrb.Horizontal(*errors, name="errors")] if errors else []
    certainty = [*ess, *coverage, *_doubts(shown)]
    above += [rrb.Horizontal(*certainty, name="certainty")] if certainty else []
    above += [verdict_view.lanes()] if shown.lanes else []
    shares = [*[1.3] * bool(errors), *[0.8] * bool(certainty), *[0.6] * shown.lanes, 2.0]
    return rrb.Vertical(*above, rrb.Tabs(*details), row_shares=shares)


def _world(shown: Shown, key: str) -> rrb.Spatial3DView:
    """The person from three metres away, without what is drawn over the images; the eye follows the person."""
    followed = "surface" if shown.surface else "body"  # where the surface is, the solid limbs are not
    controls = rrb.EyeControls3D(
        position=[*(shown.person[:2] + shown.towards), shown.person[2] + 0.6], look_target=shown.person,
        eye_up=[0.0, 0.0, 1.0], tracking_entity=f"/{ESTIMATE}/{followed}",
    )  # fmt: skip
    overlays = [f"- {picture.path}/image/{name}" for picture in shown.cameras for name in OVERLAYS]
    contents = ["$origin/**", *overlays, *[f"- /{ESTIMATE}/body"] * shown.surface]
    return rrb.Spatial3DView(origin="/world", contents=contents, name=f"world: {key}", eye_controls=controls)


def _errors(shown: Shown) -> list[rrb.View]:
    """Distances from the true joints in the world, and in the image.

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
        views += [_curves(styles.title(first), drawn)] if drawn else []
    return views


def _doubts(shown: Shown) -> list[rrb.View]:
    """Which joints not to trust, as the posterior itself says; thin beside it, where there is truth, their errors."""
    names = styles.doubts(shown.metrics)
    return [_curves("do not trust what is high: stated error by joints (mm)", names)] if names else []


def _details(shown: Shown) -> list[rrb.View | rrb.Container]:
    warnings = [rrb.TextLogView(origin="/log", name="warnings")] if shown.warned else []
    config = rrb.TextDocumentView(origin="/__properties/config", name="config")
    ranked = [ranks_view()] if "log_score" in shown.metrics else []
    coefficients = [  # samples, and the model as thin bars before them
        rrb.BarChartView(origin=f"/coefficients/{k}", name=f"coefficient {k}, model white", plot_legend=_NO_LEGEND)
        for k in range(1, shown.n_coefficients + 1)
    ]
    row = [rrb.Horizontal(*coefficients, name="coefficients")] if coefficients else []
    return [_bands(shown), _marginals(shown), *row, *ranked, *_others(shown), *warnings, config]


def _bands(shown: Shown) -> rrb.Grid:
    views = [
        rrb.TimeSeriesView(
            origin=f"/posterior/parameters/{name}",
            name=styles.title(name, shown.units[shown.parameters.index(name)]),
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=k == 0),
        )
        for k, name in enumerate(shown.pictured)
    ]
    return rrb.Grid(*views, grid_columns=2, name="5–95 % bands")


def _marginals(shown: Shown) -> rrb.Tabs:
    pictures = [_marginal(name, shown.parameters.index(name)) for name in shown.pictured]
    return rrb.Tabs(
        rrb.Grid(*pictures, grid_columns=2, name="brightness"),
        _marginal("any parameter", 0),
        rrb.TextDocumentView(origin="/posterior/legend", name="values of the axes"),
        name="log posterior over frames",
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
    together = [_curves("shares of the cues in what tells particles apart", shares)] if shares else []
    views = [*together, *(_metric(name) for name in shown.metrics if name not in elsewhere)]
    return [rrb.Grid(*views, name="more numbers")] if views else []


def _curves(title: str, metrics: Sequence[str]) -> rrb.TimeSeriesView:
    """Several metrics in one plot."""
    legend, paths = rrb.PlotLegend(corner=rrb.Corner2D.LeftTop), [f"/metrics/{name}" for name in metrics]
    return rrb.TimeSeriesView(origin="/metrics", contents=paths, name=title, plot_legend=legend)


def _metric(name: str, span: tuple[float, float] | None = None, title: str | None = None) -> rrb.TimeSeriesView:
    axis, title = None if span is None else rrb.ScalarAxis(range=span), title or styles.title(name)
    return rrb.TimeSeriesView(origin=f"/metrics/{name}", name=title, plot_legend=_NO_LEGEND, axis_y=axis)
