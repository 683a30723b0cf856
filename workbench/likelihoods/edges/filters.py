"""Responses of edge and ridge filters, steered along the limbs (Sidenbladh & Black, IJCV 54, 2003, section 4).

An edge is the derivative of the image across a limb's side; a ridge the second derivative across its axis less that
along it, at the scale of the limb's width. Both are divided by the image's local contrast.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from workbench.arrays import AnyArray, BoolArray, Float32Array, FloatArray
from workbench.core.frame import View
from workbench.likelihoods import image_levels
from workbench.likelihoods.image_motion.reference import grey_levels
from workbench.likelihoods.limb_points import LimbPoints, patch_grid

EDGE_SCALE_PX = 1.0
RIDGE_SCALES_PX = (2.0, 4.0, 8.0)  # standard deviations of the Gaussians whose derivatives the filters are
RIDGE_PER_HALF_WIDTH = 0.6  # the scale at which a bar answers most, over half its width: 1/√3
LOG_WIDTHS = np.log(np.array(RIDGE_SCALES_PX) / RIDGE_PER_HALF_WIDTH)  # of half the limbs, px, that the scales are for
CONTRAST_WINDOW_PX, CONTRAST_FLOOR = 31, 4.0
"""Contrast is the standard deviation in a square window, plus this many grey levels, about the sensor's noise."""
ALONG = 8  # places along a limb; at each, one point on either side and one on the axis
POINTS = patch_grid((np.arange(ALONG) + 0.5) / ALONG, np.array([-1.0, 0.0, 1.0]))
"""The points (3 ALONG, 2) of every patch: (u, v), v running fastest."""
LEAST_PX = 2.0  # a limb that is shorter than this in the image has no direction


@dataclass(frozen=True, eq=False)
class Filtered:
    """Derivatives of an image. gradient: (2, height, width), d/dx and d/dy. ridges: (S, 3, height, width), d²/dx²,
    d²/dxdy and d²/dy² at S scales."""

    gradient: Float32Array
    ridges: Float32Array


def filtered(view: View) -> Filtered:
    """The view's derivatives, over its local contrast."""
    grey = image_levels.grey_levels(view, 0.0)
    window = (CONTRAST_WINDOW_PX, CONTRAST_WINDOW_PX)
    variance = cv2.blur(grey * grey, window) - cv2.blur(grey, window) ** 2
    contrast = np.sqrt(np.maximum(variance, 0.0)) + CONTRAST_FLOOR
    fine = cv2.GaussianBlur(grey, (0, 0), EDGE_SCALE_PX)
    gradient = np.stack([_derivative(fine, 1, 0), _derivative(fine, 0, 1)]) / contrast
    ridges = np.empty((len(RIDGE_SCALES_PX), 3, *grey.shape), dtype=np.float32)
    for found, scale in zip(ridges, RIDGE_SCALES_PX, strict=True):
        coarse = cv2.GaussianBlur(grey, (0, 0), scale)
        dx, dy = _derivative(coarse, 1, 0), _derivative(coarse, 0, 1)
        found[:] = scale**2 * np.stack([_derivative(dx, 1, 0), _derivative(dx, 0, 1), _derivative(dy, 0, 1)]) / contrast
    return Filtered(np.ascontiguousarray(gradient, dtype=np.float32), ridges)


def _derivative(image: AnyArray, x: int, y: int) -> Float32Array:
    """Central differences, per pixel."""
    return np.asarray(cv2.Sobel(image, cv2.CV_32F, x, y, ksize=1, scale=0.5), dtype=np.float32)


def responses(images: Filtered, points: LimbPoints) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Edges (N, L, ALONG, 2) at both sides, ridges (N, L, ALONG) on the axis, and which of POINTS (N, L, ALONG, 3) to
    look at, none of limbs too short in the image. The definition that the kernel is tested against."""
    n, limbs = points.counts.shape[:2]
    pixels = points.pixels.astype(np.float64).reshape(n, limbs, ALONG, 3, 2)
    way = pixels[:, :, -1] - pixels[:, :, 0]  # (N, L, 3, 2) along the limb, at its sides and on its axis
    length = np.linalg.norm(way, axis=-1)
    tangent = way / np.maximum(length, 1e-9)[..., None]
    normal = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)
    counts = points.counts.reshape(n, limbs, ALONG, 3) & (length > LEAST_PX)[:, :, None]

    gradient = np.stack([grey_levels(image, pixels) for image in images.gradient], axis=-1)
    edges = np.abs((gradient * normal[:, :, None]).sum(axis=-1))[..., [0, 2]]

    half_width = np.linalg.norm(pixels[:, :, ALONG // 2, 2] - pixels[:, :, ALONG // 2, 0], axis=-1) / 2.0
    at_scale = np.log(RIDGE_PER_HALF_WIDTH * np.maximum(half_width, 1e-9))[..., None] - np.log(RIDGE_SCALES_PX)
    scale = np.argmin(np.abs(at_scale), axis=-1)
    curvature = np.stack([[grey_levels(image, pixels[:, :, :, 1]) for image in three] for three in images.ridges])
    xx, xy, yy = np.moveaxis(np.take_along_axis(curvature, scale[None, None, ..., None], axis=0)[0], 0, 0)
    (tx, ty), (nx, ny) = np.moveaxis(tangent[:, :, 1], -1, 0)[..., None], np.moveaxis(normal[:, :, 1], -1, 0)[..., None]
    across = nx * nx * xx + 2.0 * nx * ny * xy + ny * ny * yy
    along = tx * tx * xx + 2.0 * tx * ty * xy + ty * ty * yy
    return edges, np.abs(across) - np.abs(along), counts
