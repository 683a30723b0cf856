"""One parameter's marginal over the frames with its axis' values and the truth (paper A, fig. 4)."""

import cv2
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from workbench.recording.write import colours
from workbench.recording.write.columns import Entities
from workbench.recording.write.marginals import LOWEST_LOG_MASS
from workbench.utils.arrays import Float32Array, FloatArray

PICTURES = "posterior/pictures"
_SIZE = np.array([320.0, 80.0])  # what a view's points are at 1500 × 950, so that labels fit beside the picture
_ABOVE = 13.0  # what the viewer writes a label below its point


def entities(
    name: str, unit: str, axis: tuple[float, float], log_mass: Float32Array, frames: list[int], truth: FloatArray
) -> Entities:
    """Yield a marginal to be logged static: log_mass (B, F) of bins between the axis' ends, in `unit`, by brightness
    upwards; truth (F,), NaN where it is not known; values of the axis on the left, of the frames below."""
    path, factor = f"{PICTURES}/{name}", np.degrees(1.0) if unit == "rad" else 1.0
    bright = np.rint(255.0 * (1.0 - log_mass[::-1] / LOWEST_LOG_MASS)).astype(np.uint8)
    _, png = cv2.imencode(".png", cv2.applyColorMap(bright, cv2.COLORMAP_INFERNO))
    yield f"{path}/mass", rr.EncodedImage(contents=png.tobytes(), media_type="image/png")
    yield f"{path}/mass", rr.Transform3D(scale=[*(_SIZE / bright.shape[::-1]), 1.0])  # of a view's origin none counts
    low, high = axis
    across, down = (np.arange(len(truth)) + 0.5) / len(truth), (high - truth) / (high - low)
    inside = np.isfinite(down) & (down >= 0.0) & (down <= 1.0)
    ends = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    places = (np.column_stack([across, down]) * _SIZE).astype(np.float32)
    strips = [places[a:b] for a, b in zip(ends[::2], ends[1::2], strict=True)]
    blue, line = [colours.TRUTH], rr.Radius.ui_points(1.25)
    yield f"{path}/truth", rr.LineStrips2D(strips, colors=blue, radii=line, draw_order=20.0)
    width, height = _SIZE
    spots = np.array([[-24.0, 0.0], [-24.0, height], [12.0, height + 14.0], [width - 12.0, height + 14.0]])
    labels = [f"{factor * high:.3g}", f"{factor * low:.3g}", f"#{frames[0]}", f"#{frames[-1]}"]
    none, grey = rr.Radius.ui_points(0.0), [colours.MODEL]
    yield f"{path}/values", rr.Points2D(spots - [0.0, _ABOVE], labels=labels, show_labels=True, colors=grey, radii=none)


def view(name: str, title: str) -> rrb.Spatial2DView:
    """Lay one out."""
    width, height = _SIZE
    bounds = rrb.VisualBounds2D(x_range=[-50.0, width + 8.0], y_range=[-10.0, height + 24.0])
    return rrb.Spatial2DView(origin=f"/{PICTURES}/{name}", name=title, visual_bounds=bounds)
