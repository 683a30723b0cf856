"""Where a body went: stick figures along the way and the paths of both hands (paper C, fig. 5)."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from workbench.arrays import FloatArray
from workbench.recording.write import colours
from workbench.recording.write.blueprint import page
from workbench.recording.write.columns import Entities
from workbench.recording.write.scene import ESTIMATE, Figure

EVERY = 4
"""Frames from one stick figure to the next."""
HANDS = (("left_wrist", colours.ESTIMATE), ("right_wrist", (120, 220, 130)))
_LEGS = tuple(f"{side}_{joint}_flexion" for joint in ("hip", "knee") for side in ("left", "right"))
_HIDDEN = rrb.PlotLegend(visible=False)


class Trails:
    """Collects the joints of a run without images, frame by frame."""

    def __init__(self, drawn: Figure) -> None:
        self._drawn = drawn
        self._places: list[FloatArray] = []

    def __len__(self) -> int:
        return len(self._places)

    def add(self, places: FloatArray) -> None:
        """Take in one more frame: joints (J, 3), m."""
        self._places.append(places)

    def pictures(self) -> Entities:
        """Yield everything so far, to be logged static, so that every frame shows the whole way."""
        places = np.stack(self._places).astype(np.float32)
        chains = self._drawn.chains
        strips = places[::EVERY][:, chains].reshape(-1, chains.shape[1], 3)
        thin = rr.Radius.ui_points(0.75)
        yield f"{ESTIMATE}/trails/figures", rr.LineStrips3D(strips, colors=[colours.TRAIL], radii=thin)
        for name, colour in HANDS:
            path, thick = places[:, self._drawn.skeleton.joint(name)], rr.Radius.ui_points(1.75)
            drawn = rr.LineStrips3D([path], colors=[colour], radii=thick, labels=[name], show_labels=False)
            yield f"{ESTIMATE}/trails/{name}", drawn

    def layout(self, metrics: Sequence[str]) -> rrb.Blueprint:
        """Lay out the whole way from its right-hand side, with curves of the legs' angles and of the metrics below."""
        legs = [f"/posterior/parameters/{name}/mean" for name in _LEGS if name in self._drawn.skeleton.dof_names]
        plots = [rrb.TimeSeriesView(origin=f"/metrics/{name}", name=name, plot_legend=_HIDDEN) for name in metrics]
        title, origin = "flexion of hips and knees (rad)", "/posterior/parameters"
        plots.append(rrb.TimeSeriesView(origin=origin, contents=legs, name=title, plot_legend=_HIDDEN))
        below = rrb.Tabs(
            rrb.Horizontal(*plots, name="curves"),
            rrb.TextLogView(origin="/log", name="warnings"),
            rrb.TextDocumentView(origin="/__properties/config", name="config"),
        )
        world = rrb.Spatial3DView(origin="/world", name="world", eye_controls=self._eye())
        return page(rrb.Vertical(world, below, row_shares=[2.2, 1.0]))

    def _eye(self) -> rrb.EyeControls3D:
        places = np.stack(self._places)
        lowest, highest = places.min(axis=(0, 1)), places.max(axis=(0, 1))
        middle, reach = 0.5 * (lowest + highest), float(np.linalg.norm(highest - lowest))
        way = places[-1, 0, :2] - places[0, 0, :2]
        way = way / np.linalg.norm(way) if np.linalg.norm(way) > 0.1 else np.array([1.0, 0.0])
        eye = middle + max(0.48 * reach, 2.2) * np.array([way[1], -way[0], 0.12])
        return rrb.EyeControls3D(position=eye, look_target=middle, eye_up=[0.0, 0.0, 1.0])
