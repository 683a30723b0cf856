"""Where a body went: stick figures along the way and the paths of both hands (paper C, fig. 5)."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from workbench.recording.write import colours, verdict_view
from workbench.recording.write import series_styles as styles
from workbench.recording.write.blueprint import no_legend, page
from workbench.recording.write.columns import Entities
from workbench.recording.write.posterior import DEGREES
from workbench.recording.write.scene import ESTIMATE, Figure
from workbench.utils.arrays import FloatArray

EVERY = 4
"""Frames from one stick figure to the next."""
HANDS = (("left_wrist", colours.ESTIMATE), ("right_wrist", (60, 180, 90)))


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

    def layout(self, metrics: Sequence[str], warned: bool = False) -> rrb.Blueprint:
        """Lay out the verdict, the whole way from its right-hand side, and below it curves of the legs' angles, in
        which left and right have their hands' colours, and of the metrics."""
        plots = [
            rrb.TimeSeriesView(origin=f"/metrics/{name}", name=styles.title(name), plot_legend=no_legend())
            for name in metrics
        ]
        plots += [plot for joint in ("hip", "knee") if (plot := self._legs(joint)) is not None]
        below = rrb.Tabs(
            rrb.Horizontal(*plots, name="curves"),
            *[rrb.TextLogView(origin="/log", name="warnings")] * warned,
            rrb.TextDocumentView(origin="/__properties/config", name="config"),
        )
        name = "world: the whole way grey, left wrist orange, right wrist green, as the legs below"
        world = rrb.Spatial3DView(origin="/world", name=name, eye_controls=self._eye())
        return page(rrb.Vertical(verdict_view.view(), world, below, row_shares=[0.25, 2.2, 1.0]))

    def _legs(self, joint: str) -> rrb.TimeSeriesView | None:
        paths: dict[Any, rr.SeriesLines] = {
            f"/{DEGREES}/{side}_{joint}_flexion/mean": rr.SeriesLines(colors=[colour], widths=[2.0], names=[side])
            for side, (_, colour) in zip(("left", "right"), HANDS, strict=True)
            if f"{side}_{joint}_flexion" in self._drawn.skeleton.dof_names
        }
        title = f"flexion of the {joint}s (degrees)"
        return rrb.TimeSeriesView(
            origin=f"/{DEGREES}", contents=list(paths), name=title, plot_legend=no_legend(), overrides=paths
        ) if paths else None  # fmt: skip

    def _eye(self) -> rrb.EyeControls3D:
        places = np.stack(self._places)
        lowest, highest = places.min(axis=(0, 1)), places.max(axis=(0, 1))
        middle, reach = 0.5 * (lowest + highest), float(np.linalg.norm(highest - lowest))
        way = places[-1, 0, :2] - places[0, 0, :2]
        way = way / np.linalg.norm(way) if np.linalg.norm(way) > 0.1 else np.array([1.0, 0.0])
        eye = middle + max(0.48 * reach, 2.2) * np.array([way[1], -way[0], 0.12])
        return rrb.EyeControls3D(position=eye, look_target=middle, eye_up=[0.0, 0.0, 1.0])
