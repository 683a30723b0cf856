"""How the viewer lays a recording out for a person who opens it."""

from collections.abc import Sequence
from dataclasses import dataclass

import rerun as rr
import rerun.blueprint as rrb

from workbench.arrays import FloatArray
from workbench.recording import fit
from workbench.recording.images import OVERLAYS, Picture
from workbench.recording.scene import ESTIMATE

MOST_BESIDE = 4
"""Cameras whose images are shown beside each other; of more, one at a time."""


@dataclass(frozen=True, eq=False)
class Shown:
    """What a run's first step finds to show.

    person: (3,), where the person is, m. towards: (2,), horizontally from the person to where to look from.
    parameters: names along the first axis of the marginals' tensor; pictured: those of them with a picture of their
    own. metrics: names under metrics/. flexions: names under flexion/, of a fit to points. activity: what the person
    does is told. surface: its mesh is drawn.
    """

    cameras: Sequence[Picture]
    person: FloatArray
    towards: FloatArray
    parameters: Sequence[str]
    pictured: Sequence[str]
    metrics: Sequence[str]
    n_coefficients: int
    flexions: Sequence[str] = ()
    activity: bool = False
    surface: bool = False


def layout(shown: Shown) -> rrb.Blueprint:
    """Images and the world on the left; marginals, coefficients and curves on the right."""
    middle = _coefficients(shown)
    right = (_marginals(shown), *middle, rrb.Tabs(_errors(shown), *_others(shown)))
    return _page(shown, rrb.Vertical(*right, row_shares=[1.8, *[1.0] * len(middle), 1.2]))


def fit_layout(shown: Shown) -> rrb.Blueprint:
    """Images and the world on the left; on the right flexion against the truth, the activity told, errors."""
    middle = [fit.timeline()] if shown.activity else []
    below = rrb.Tabs(_errors(shown), _marginals(shown), *_coefficients(shown), *_others(shown))
    flexion = fit.views(shown.flexions)
    return _page(shown, rrb.Vertical(flexion, *middle, below, row_shares=[2.4, *[0.8] * len(middle), 1.4]))


def _page(shown: Shown, right: rrb.Vertical) -> rrb.Blueprint:
    images = [rrb.Spatial2DView(origin=f"{picture.path}/image", name=picture.camera.name) for picture in shown.cameras]
    left = [rrb.Horizontal(*images) if len(images) <= MOST_BESIDE else rrb.Tabs(*images)] if images else []
    shares = [*[1.0] * len(left), 1.5 if shown.flexions else 1.0]  # points are seen in the world only
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Vertical(*left, _world(shown), row_shares=shares), right),
        rrb.TimePanel(timeline="frame", state="collapsed", fps=15.0),
        auto_views=False,
        collapse_panels=True,
    )


def _world(shown: Shown) -> rrb.Spatial3DView:
    """The person from three metres away; the eye follows the person."""
    eye = [*(shown.person[:2] + shown.towards), shown.person[2] + 0.6]
    followed = "surface" if shown.surface else "body"
    controls = rrb.EyeControls3D(
        position=eye, look_target=shown.person, eye_up=[0.0, 0.0, 1.0], tracking_entity=f"/{ESTIMATE}/{followed}"
    )
    return rrb.Spatial3DView(origin="/world", contents=_in_the_world(shown), name="world", eye_controls=controls)


def _in_the_world(shown: Shown) -> list[str]:
    """All but what is drawn over the images, and the solid limbs where the surface is."""
    overlays = [f"- {picture.path}/image/{name}" for picture in shown.cameras for name in OVERLAYS]
    return ["$origin/**", *overlays, *[f"- /{ESTIMATE}/body"] * shown.surface]


def _coefficients(shown: Shown) -> list[rrb.Horizontal]:
    numbers = range(1, shown.n_coefficients + 1)
    return [rrb.Horizontal(*map(_coefficient, numbers), name="coefficients")] if numbers else []


def _marginals(shown: Shown) -> rrb.Tabs:
    pictures = [_marginal(name, shown.parameters.index(name)) for name in shown.pictured]
    return rrb.Tabs(
        rrb.Grid(*pictures, grid_columns=2, name="log posterior over frames"),
        _marginal("any parameter", 0),
        rrb.TextDocumentView(origin="/posterior/legend", name="legend"),
        name="posterior",
    )


def _marginal(name: str, index: int) -> rrb.TensorView:
    """One parameter's marginal: frames to the right, values upwards, brightness the log posterior (paper A, fig. 4)."""
    return rrb.TensorView(
        origin="/posterior/marginals",
        name=name,
        view_fit="fill",
        scalar_mapping=rrb.TensorScalarMapping(colormap="inferno", mag_filter="nearest"),
        slice_selection=rrb.TensorSliceSelection(
            width=2,
            height=rr.TensorDimensionSelection(dimension=1, invert=True),
            indices=[rr.TensorDimensionIndexSelection(dimension=0, index=index)],
        ),
    )


def _coefficient(k: int) -> rrb.BarChartView:
    """Samples, and the model as thin bars before them."""
    hidden = rrb.PlotLegend(visible=False)
    return rrb.BarChartView(origin=f"/coefficients/{k}", name=f"coefficient {k}", plot_legend=hidden)


def _others(shown: Shown) -> list[rrb.View | rrb.Container]:
    bands = [_curve(f"/posterior/parameters/{name}", name) for name in shown.pictured]
    return [
        rrb.Grid(*(_curve(f"/metrics/{name}", name) for name in shown.metrics if not _is_error(name)), name="filter"),
        rrb.Grid(*bands, grid_columns=2, name="5–95 % bands"),
        rrb.TextLogView(origin="/log", name="warnings"),
        rrb.TextDocumentView(origin="/__properties/config", name="config"),
    ]


def _is_error(metric: str) -> bool:
    return metric.startswith("error")


def _errors(shown: Shown) -> rrb.Horizontal:
    """Errors in pixels apart from the rest, which an error that is first known later in the run joins."""
    errors, others = (tuple(name for name in shown.metrics if _is_error(name) is kind) for kind in (True, False))
    pixels = [name for name in errors if "px" in name.split("_")]
    heaviest = [name for name in errors if shown.flexions and name.endswith("_map")]  # a fit's is the expected pose
    contents = {}
    if len(pixels) < len(errors) or not errors:
        contents["errors"] = ["$origin/**", *(f"- /metrics/{name}" for name in (*others, *pixels, *heaviest))]
    if pixels:
        contents["errors in pixels"] = [f"/metrics/{name}" for name in pixels if name not in heaviest]
    legend = rrb.PlotLegend(corner=rrb.Corner2D.LeftTop)
    views = [
        rrb.TimeSeriesView(origin="/metrics", contents=paths, name=name, plot_legend=legend)
        for name, paths in contents.items()
    ]
    return rrb.Horizontal(*views, name="errors")


def _curve(origin: str, name: str) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(origin=origin, name=name, plot_legend=rrb.PlotLegend(visible=False))
