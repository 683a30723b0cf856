"""Sums of an image over unions of outlines in plain NumPy, for `workbench.likelihoods.cues.outlines`."""

import numpy as np

from workbench.likelihoods.cues.outlines import OUTWARDS
from workbench.utils.arrays import BoolArray, Float32Array, FloatArray


def outline_sums(
    image: Float32Array, corners: Float32Array, spheres: BoolArray, dilation_px: float = 0.0
) -> FloatArray:
    """Sum an image over the union of L outlines, (N,); a pixel counts by the fraction of its row that is covered.

    corners : (N, L, 4, 2), px, in the order of `cues.outlines.CORNERS`; all equal for a limb that is not visible.
    spheres : (L,), whether an outline is the circle through its corners. dilation_px : on all sides.
    """
    height, width = image.shape
    edges = np.arange(width + 1) - 0.5
    sums = np.zeros(len(corners))
    for i, outlines in enumerate(corners.astype(np.float64)):
        for y in range(height):
            candidates = (_span(one, bool(spheres[k]), dilation_px, float(y)) for k, one in enumerate(outlines))
            spans = sorted(span for span in candidates if span)
            end = -np.inf
            for left, right in spans:
                covered = np.clip(edges, max(left, end), max(right, end))
                sums[i] += float(image[y] @ np.diff(covered))
                end = max(end, right)
    return sums


def _span(corners: FloatArray, sphere: bool, dilation_px: float, y: float) -> tuple[float, float] | None:
    """Return the interval (left, right), px, in which the row at height y, px, crosses an outline (4, 2), or None."""
    axes = OUTWARDS.T @ corners  # along the limb and across it
    lengths = np.linalg.norm(axes, axis=1)
    if not lengths.min() > 0.0:
        return None
    if sphere:
        centre, radius = corners.mean(axis=0), float(np.linalg.norm(corners[2] - corners[0])) / 2.0 + dilation_px
        half = radius**2 - (y - centre[1]) ** 2
        return (centre[0] - np.sqrt(half), centre[0] + np.sqrt(half)) if half > 0.0 else None
    corners = corners + dilation_px * OUTWARDS @ (axes / lengths[:, None])
    crossings = []
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if min(y0, y1) <= y < max(y0, y1):
            crossings.append(float(x0 + (y - y0) / (y1 - y0) * (x1 - x0)))
    return (min(crossings), max(crossings)) if len(crossings) > 1 else None
