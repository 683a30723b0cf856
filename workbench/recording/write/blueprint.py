"""How the viewer lays a recording out for a person who opens it."""

from collections.abc import Sequence
from dataclasses import dataclass

import rerun as rr
import rerun.blueprint as rrb

from workbench.arrays import FloatArray
from workbench.recording.write import point_fit_views as fit
from workbench.recording.write import ranks
from workbench.recording.write import series_styles as looks
from workbench.recording.write.images import OVERLAYS, Picture
from workbench.recording.write.scene import ESTIMATE

MOST_BESIDE = 4
"""Cameras whose images are shown beside each other; of more, one at a time."""


@dataclass(frozen=True, eq=False)
class Shown:
    """What there is to show of a run.

    person: (3,), where the person is first, m. towards: (2,), horizontally from the person to where to look from.
    parameters, units: along the first axis of the marginals' tensor; pictured: the parameters with a picture of their
    own. metrics: names under metrics/. n_particles: of a step. flexions: names under flexion/, of a fit to points.
    activity: what the person does is told. surface: its mesh is drawn. warned: there are warnings.
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


def layout(shown: Shown) -> rrb.Blueprint:
    """Find where the person is, on the left; on the right how wrong the estimate is, how sure, and the posterior.

    A fit to points has flexion against the truth and the activity told before the errors.
    """
    errors, details = _errors(shown), _details(shown)
    above: list[rrb.View | rrb.Container]
    if shown.flexions:
        judged = rrb.Horizontal(*errors, *_coverage(shown), name="errors and certainty")
        above = [fit.views(shown.flexions), *[fit.timeline()] * shown.activity]
        below = rrb.Tabs(judged, *details)
        return _page(shown, rrb.Vertical(*above, below, row_shares=[2.4, *[0.8] * shown.activity, 1.4]))
    above = [rrb.Horizontal(*errors, name="errors")] if errors else []
    sure = rrb.Horizontal(_ess(shown), *_coverage(shown), name="certainty")
    return _page(shown, rrb.Vertical(*above, sure, rrb.Tabs(*details), row_shares=[*[1.3] * len(above), 0.8, 2.0]))


def _page(shown: Shown, right: rrb.Vertical) -> rrb.Blueprint:
    images = [
        rrb.Spatial2DView(origin=f"{picture.path}/image", name=f"image ({picture.camera.name}): {_key(shown)}")
        for picture in shown.cameras
    ]
    left = [rrb.Horizontal(*images) if len(images) <= MOST_BESIDE else rrb.Tabs(*images)] if images else []
    shares = [*[1.0] * len(left), 1.5 if shown.flexions else 1.0]  # points are seen in the world only
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Vertical(*left, _world(shown), row_shares=shares), right),
        rrb.TimePanel(timeline="frame", state="collapsed", fps=15.0),
        auto_views=False,
        collapse_panels=True,
    )


def _key(shown: Shown) -> str:
    """Tell what the colours mean."""
    truth = ["truth blue"] if any(name.startswith("error") for name in shown.metrics) else []
    return ", ".join(["estimate orange", *truth, "particles purple"])


def _world(shown: Shown) -> rrb.Spatial3DView:
    """The person from three metres away; the eye follows the person."""
    eye = [*(shown.person[:2] + shown.towards), shown.person[2] + 0.6]
    followed = "surface" if shown.surface else "body"
    controls = rrb.EyeControls3D(
        position=eye, look_target=shown.person, eye_up=[0.0, 0.0, 1.0], tracking_entity=f"/{ESTIMATE}/{followed}"
    )
    contents, name = _in_the_world(shown), f"world: {_key(shown)}"
    return rrb.Spatial3DView(origin="/world", contents=contents, name=name, eye_controls=controls)


def _in_the_world(shown: Shown) -> list[str]:
    """All but what is drawn over the images, and the solid limbs where the surface is."""
    overlays = [f"- {picture.path}/image/{name}" for picture in shown.cameras for name in OVERLAYS]
    return ["$origin/**", *overlays, *[f"- /{ESTIMATE}/body"] * shown.surface]


def _errors(shown: Shown) -> list[rrb.View]:
    """Tell how wrong: distances from the true joints in the world, and in the image."""
    plots = {
        looks.title("error_abs_mm"): looks.errors_mm(shown.metrics),
        looks.title("error_px"): looks.errors_px(shown.metrics),
    }
    kept = {title: [name for name in names if _is_plotted(shown, name)] for title, names in plots.items()}
    return [_curves(title, names) for title, names in kept.items() if names]


def _is_plotted(shown: Shown, error: str) -> bool:
    """The heaviest particle once, and not of a fit, where it is the expected pose."""
    return not error.endswith("_map") or not (shown.flexions or error == "error_rel_mm_map")


def _ess(shown: Shown) -> rrb.View:
    """Tell how many particles count."""
    axis = rrb.ScalarAxis(range=(0.0, float(shown.n_particles)))
    return _metric("ess", f"effective sample size (of {shown.n_particles})", axis)


def _coverage(shown: Shown) -> list[rrb.View]:
    """Tell whether the estimate is as sure as it may be."""
    axis = rrb.ScalarAxis(range=(0.0, 1.0))
    return [_metric("coverage_90", looks.title("coverage_90"), axis)] if "coverage_90" in shown.metrics else []


def _details(shown: Shown) -> list[rrb.View | rrb.Container]:
    """The posterior in four ways, other numbers, and where the run came from."""
    said = [rrb.TextLogView(origin="/log", name="warnings")] if shown.warned else []
    config = rrb.TextDocumentView(origin="/__properties/config", name="config")
    ranked = [ranks.view()] if "log_score" in shown.metrics else []
    return [_bands(shown), _marginals(shown), *_coefficients(shown), *ranked, *_others(shown), *said, config]


def _bands(shown: Shown) -> rrb.Grid:
    views = [
        rrb.TimeSeriesView(
            origin=f"/posterior/parameters/{name}",
            name=looks.title(name, shown.units[shown.parameters.index(name)]),
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
    return rrb.TensorView(
        origin="/posterior/marginals",
        name=looks.title(name),
        view_fit="fill",
        scalar_mapping=rrb.TensorScalarMapping(colormap="inferno", mag_filter="nearest"),
        slice_selection=rrb.TensorSliceSelection(
            width=2,
            height=rr.TensorDimensionSelection(dimension=1, invert=True),
            indices=[rr.TensorDimensionIndexSelection(dimension=0, index=index)],
        ),
    )


def _coefficients(shown: Shown) -> list[rrb.Horizontal]:
    views = [_coefficient(k) for k in range(1, shown.n_coefficients + 1)]
    return [rrb.Horizontal(*views, name="coefficients")] if views else []


def _coefficient(k: int) -> rrb.BarChartView:
    """Samples, and the model as thin bars before them."""
    hidden = rrb.PlotLegend(visible=False)
    return rrb.BarChartView(origin=f"/coefficients/{k}", name=f"coefficient {k}, model white", plot_legend=hidden)


def _others(shown: Shown) -> list[rrb.Grid]:
    taken = {"coverage_90", *looks.errors_mm(shown.metrics), *looks.errors_px(shown.metrics)}
    taken |= set() if shown.flexions else {"ess"}
    shares = looks.shares(shown.metrics)
    views = [_metric(name, looks.title(name)) for name in shown.metrics if name not in {*taken, *shares}]
    together = [_curves("shares of the cues in what tells particles apart", shares)] if shares else []
    return [rrb.Grid(*together, *views, name="more numbers")] if views or together else []


def _curves(title: str, metrics: Sequence[str]) -> rrb.TimeSeriesView:
    """Several metrics in one plot."""
    legend = rrb.PlotLegend(corner=rrb.Corner2D.LeftTop)
    paths = [f"/metrics/{name}" for name in metrics]
    return rrb.TimeSeriesView(origin="/metrics", contents=paths, name=title, plot_legend=legend)


def _metric(name: str, title: str, axis: rrb.ScalarAxis | None = None) -> rrb.TimeSeriesView:
    hidden = rrb.PlotLegend(visible=False)
    return rrb.TimeSeriesView(origin=f"/metrics/{name}", name=title, plot_legend=hidden, axis_y=axis)
