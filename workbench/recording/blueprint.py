"""How the viewer lays a recording out for a person who opens it."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from workbench.arrays import FloatArray
from workbench.recording.images import OVERLAYS, Picture
from workbench.recording.scene import ESTIMATE


def layout(
    cameras: Sequence[Picture],
    person: FloatArray,
    parameters: Sequence[str],
    pictured: Sequence[str],
    metrics: Sequence[str],
    n_coefficients: int,
) -> rrb.Blueprint:
    """Images and the world on the left; marginals, coefficients and curves on the right.

    person: (3,), where the person is at first, m. parameters: names along the first axis of the marginals' tensor;
    pictured: those of them with a picture of their own. metrics: names under metrics/.
    """
    images = [rrb.Spatial2DView(origin=f"{shown.path}/image", name=shown.camera.name) for shown in cameras]
    left = [rrb.Tabs(*images)] if images else []
    middle = [rrb.Horizontal(*map(_coefficient, range(1, n_coefficients + 1)))] if n_coefficients else []
    right = (_marginals(parameters, pictured), *middle, _curves(pictured, metrics))
    heights = [1.8, *[1.0] * len(middle), 1.2]
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Vertical(*left, _world(cameras, person)), rrb.Vertical(*right, row_shares=heights)),
        rrb.TimePanel(timeline="frame", state="collapsed", fps=15.0),
        auto_views=False,
        collapse_panels=True,
    )


def _world(cameras: Sequence[Picture], person: FloatArray) -> rrb.Spatial3DView:
    """The person from three metres away, with the first camera in the background; the eye follows the person."""
    sideways = np.array([2.1, -2.1])
    if cameras:
        away = person[:2] - cameras[0].camera.position[:2]
        turn = np.radians(-40.0)
        rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        sideways = 3.0 * rotation @ away / max(float(np.linalg.norm(away)), 1e-6)
    eye = [*(person[:2] + sideways), person[2] + 0.6]
    controls = rrb.EyeControls3D(
        position=eye, look_target=person, eye_up=[0.0, 0.0, 1.0], tracking_entity=f"/{ESTIMATE}/body"
    )
    return rrb.Spatial3DView(origin="/world", contents=_in_the_world(cameras), name="world", eye_controls=controls)


def _in_the_world(cameras: Sequence[Picture]) -> list[str]:
    """All but what is drawn over the images."""
    return ["$origin/**", *(f"- {picture.path}/image/{name}" for picture in cameras for name in OVERLAYS)]


def _marginals(parameters: Sequence[str], pictured: Sequence[str]) -> rrb.Tabs:
    pictures = [_marginal(name, parameters.index(name)) for name in pictured]
    return rrb.Tabs(
        rrb.Grid(*pictures, grid_columns=2, name="log posterior over frames"),
        _marginal("any parameter", 0),
        rrb.TextDocumentView(origin="/posterior/legend", name="legend"),
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


def _curves(pictured: Sequence[str], metrics: Sequence[str]) -> rrb.Tabs:
    others = [name for name in metrics if not name.startswith("error")]
    bands = [_curve(f"/posterior/parameters/{name}", name) for name in pictured]
    return rrb.Tabs(
        _errors([name for name in metrics if name.startswith("error")], others),
        rrb.Grid(*(_curve(f"/metrics/{name}", name) for name in others), name="filter"),
        rrb.Grid(*bands, grid_columns=2, name="5–95 % bands"),
        rrb.TextLogView(origin="/log", name="warnings"),
        rrb.TextDocumentView(origin="/__properties/config", name="config"),
    )


def _errors(errors: Sequence[str], others: Sequence[str]) -> rrb.Horizontal:
    """Errors in pixels apart from the rest, which an error that is first known later in the run joins."""
    pixels = [name for name in errors if "px" in name.split("_")]
    contents = {}
    if len(pixels) < len(errors) or not errors:
        contents["errors"] = ["$origin/**", *(f"- /metrics/{name}" for name in (*others, *pixels))]
    if pixels:
        contents["errors in pixels"] = [f"/metrics/{name}" for name in pixels]
    legend = rrb.PlotLegend(corner=rrb.Corner2D.LeftTop)
    views = [
        rrb.TimeSeriesView(origin="/metrics", contents=paths, name=name, plot_legend=legend)
        for name, paths in contents.items()
    ]
    return rrb.Horizontal(*views, name="errors")


def _curve(origin: str, name: str) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(origin=origin, name=name, plot_legend=rrb.PlotLegend(visible=False))
