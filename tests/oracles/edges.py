"""The edge and ridge likelihood in OpenCV and plain NumPy, for `workbench.likelihoods.cues.edges`."""

import cv2
import numpy as np

from workbench.likelihoods.cues.edge_filters import POINTS, RIDGE_SCALES_PX, FilteredBox, SmoothedBox, responses
from workbench.likelihoods.cues.edges import BINS, EDGE_RANGE, RIDGE_RANGE
from workbench.likelihoods.cues.limb_points import LimbPoints
from workbench.utils.arrays import AnyArray, Float32Array, FloatArray, IntArray


def filtered(images: SmoothedBox) -> FilteredBox:
    """Return gradient (height, width, 2) and ridges (S, height, width, 3) of an image over its contrast, by OpenCV."""
    fine, *coarser = images.levels
    contrast = images.contrast[..., None]
    gradient = np.stack([_derivative(fine, 1, 0), _derivative(fine, 0, 1)], axis=-1) / contrast
    ridges = []
    for coarse, scale in zip(coarser, RIDGE_SCALES_PX, strict=True):
        dx, dy = _derivative(coarse, 1, 0), _derivative(coarse, 0, 1)
        curvature = np.stack([_derivative(dx, 1, 0), _derivative(dx, 0, 1), _derivative(dy, 0, 1)], axis=-1)
        ridges.append(scale**2 * curvature / contrast)
    return FilteredBox(gradient, np.stack(ridges))


def _derivative(image: AnyArray, x: int, y: int) -> Float32Array:
    """Return central differences (height, width), 1/px, of order x and y."""
    return np.asarray(cv2.Sobel(image, cv2.CV_32F, x, y, ksize=1, scale=0.5), dtype=np.float32)


def response_log_ratio(images: FilteredBox, points: LimbPoints, table: Float32Array) -> FloatArray:
    """Return the sums of the log ratios of all filter responses of each limb, (N, L), over the number of its points.

    table : (2, L, BINS), log ratios of edges and of ridges.
    """
    edges, ridges, counts = responses(images, points)
    limb = np.arange(len(table[0]))[:, None]
    on_axis = np.where(counts[..., 1], table[1][limb, _bins(ridges, *RIDGE_RANGE)], 0.0).sum(axis=-1)
    at_sides = np.where(counts[..., [0, 2]], table[0][limb[..., None], _bins(edges, *EDGE_RANGE)], 0.0)
    return (on_axis + at_sides.sum(axis=(-1, -2))) / len(POINTS)


def _bins(values: FloatArray, low: float, high: float) -> IntArray:
    """Return the bins of values, 0 to BINS − 1; values out of range are in the first or the last bin."""
    return np.clip((values - low) / (high - low) * BINS, 0, BINS - 1).astype(np.int64)
