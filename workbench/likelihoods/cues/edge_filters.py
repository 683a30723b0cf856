"""Responses of edge and ridge filters, steered along the limbs (Sidenbladh & Black, IJCV 54, 2003, section 4).

An edge is the derivative of the image across a limb's side; a ridge the second derivative across its axis less that
along it, at the scale of the limb's width. Both are divided by the image's local contrast.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from workbench.body.simd_kinematics import inlined_exactly
from workbench.core.frame import View
from workbench.likelihoods.cues import image_levels
from workbench.likelihoods.cues.image_levels import bilinear
from workbench.likelihoods.cues.limb_points import Box, LimbPoints, patch_grid
from workbench.utils.arrays import BoolArray, Float32Array, FloatArray
from workbench.utils.kernel_cache import kernel
from workbench.utils.parallel import parallel_for

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


_ROWS = 32  # of the image at least that one thread takes
_NEXT_PX = 2  # how far differences of differences reach
_REACH_PX = 32  # how far the widest Gaussian reaches, as OpenCV cuts it off; the contrast's window reaches less far
_COLUMNS = 32  # parts of an image begin at multiples of it, so that processors sum a pixel alike in each


@dataclass(frozen=True, eq=False)
class Smoothed:
    """A part of an image at 1 + S scales, those of the edges and of the ridges, (1 + S, height, width), and its local
    contrast (height, width). box: of the image, that it is."""

    levels: Float32Array
    contrast: Float32Array
    box: Box


@dataclass(frozen=True, eq=False)
class Filtered:
    """Derivatives of a box of an image, over the contrast. gradient: (height, width, 2), d/dx and d/dy. ridges: (S,
    height, width, 3), d²/dx², d²/dxdy and d²/dy² at S scales, times the square of the scale. corner: (x, y) of the
    box's first pixel."""

    gradient: Float32Array
    ridges: Float32Array
    corner: tuple[int, int] = (0, 0)


class SmoothedView:
    """A view, smoothed where it is looked at; what was smoothed is kept."""

    def __init__(self, view: View) -> None:
        """Raises InputError when the image has not the size that its camera states."""
        self._grey = image_levels.grey_levels(view, 0.0)
        self._kept: Smoothed | None = None

    def about(self, box: Box) -> Smoothed:
        """Smooth all that the filters need within a box."""
        part = _grown(box, self._grey, _NEXT_PX)
        if self._kept is not None:
            part = _around(part, self._kept.box)
        if self._kept is None or part != self._kept.box:
            self._kept = _smoothed(self._grey, part)
        return self._kept


def smoothed(view: View) -> Smoothed:
    """All of a view, smoothed; raises as `SmoothedView`."""
    return SmoothedView(view).about((0, 0, view.image.shape[1], view.image.shape[0]))


def _smoothed(grey: Float32Array, part: Box) -> Smoothed:
    """A part of an image, smoothed as in the whole."""
    left, top, right, bottom = source = _grown(part, grey, _REACH_PX)
    pixels, scales = np.ascontiguousarray(grey[top:bottom, left:right]), (EDGE_SCALE_PX, *RIDGE_SCALES_PX)
    within = (slice(part[1] - source[1], part[3] - source[1]), slice(part[0] - source[0], part[2] - source[0]))
    levels = np.empty((len(scales), part[3] - part[1], part[2] - part[0]), dtype=np.float32)
    contrast = np.empty_like(levels[0])

    def smooth(first: int, last: int) -> None:
        for k in range(first, last):
            if k == len(scales):
                contrast[:] = _contrast(pixels)[within]
            else:
                levels[-1 - k] = cv2.GaussianBlur(pixels, (0, 0), scales[-1 - k])[within]  # the widest first

    parallel_for(smooth, len(scales) + 1, 1)
    return Smoothed(levels, contrast, part)


def _grown(box: Box, image: Float32Array, by: int) -> Box:
    """The box with at least so many pixels more on all sides, as far as the image has them, in whole `_COLUMNS`."""
    (height, width), (left, top, right, bottom) = image.shape, box
    first, last = (left - by) // _COLUMNS * _COLUMNS, -(-(right + by) // _COLUMNS) * _COLUMNS
    return max(first, 0), max(top - by, 0), min(last, width), min(bottom + by, height)


def _around(one: Box, other: Box) -> Box:
    """The least box around two."""
    return min(one[0], other[0]), min(one[1], other[1]), max(one[2], other[2]), max(one[3], other[3])


def _contrast(grey: Float32Array) -> Float32Array:
    window = (CONTRAST_WINDOW_PX, CONTRAST_WINDOW_PX)
    variance = cv2.blur(grey * grey, window) - cv2.blur(grey, window) ** 2
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)) + CONTRAST_FLOOR, dtype=np.float32)


def filtered(images: Smoothed, box: Box | None = None) -> Filtered:
    """The derivatives within a box of the image, about which it was smoothed; None: of all that was."""
    left, top, right, bottom = box or images.box
    shape = (bottom - top, right - left)
    gradient, ridges = np.empty((*shape, 2), np.float32), np.empty((len(RIDGE_SCALES_PX), *shape, 3), np.float32)
    squares = np.square(np.array(RIDGE_SCALES_PX, dtype=np.float32))
    arguments = (images.levels, images.contrast, squares, left - images.box[0], top - images.box[1], gradient, ridges)
    parallel_for(lambda first, last: _differentiate(first, last, *arguments), shape[0], _ROWS)
    return Filtered(gradient, ridges, (left, top))


def responses(images: Filtered, points: LimbPoints) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Edges (N, L, ALONG, 2) at both sides, ridges (N, L, ALONG) on the axis, and which of POINTS (N, L, ALONG, 3) to
    look at, none of limbs too short in the image. What `edges.model` learns from."""
    n, limbs = points.counts.shape[:2]
    pixels = points.pixels.astype(np.float64).reshape(n, limbs, ALONG, 3, 2)
    way = pixels[:, :, -1] - pixels[:, :, 0]  # (N, L, 3, 2) along the limb, at its sides and on its axis
    length = np.linalg.norm(way, axis=-1)
    tangent = way / np.maximum(length, 1e-9)[..., None]
    normal = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)
    counts = points.counts.reshape(n, limbs, ALONG, 3) & (length > LEAST_PX)[:, :, None]

    pixels = pixels - images.corner
    gradient = np.stack([bilinear(image, pixels) for image in np.moveaxis(images.gradient, -1, 0)], axis=-1)
    edges = np.abs((gradient * normal[:, :, None]).sum(axis=-1))[..., [0, 2]]

    half_width = np.linalg.norm(pixels[:, :, ALONG // 2, 2] - pixels[:, :, ALONG // 2, 0], axis=-1) / 2.0
    at_scale = np.log(RIDGE_PER_HALF_WIDTH * np.maximum(half_width, 1e-9))[..., None] - np.log(RIDGE_SCALES_PX)
    scale = np.argmin(np.abs(at_scale), axis=-1)
    three = np.moveaxis(images.ridges, -1, 1)
    curvature = np.stack([[bilinear(image, pixels[:, :, :, 1]) for image in each] for each in three])
    xx, xy, yy = np.moveaxis(np.take_along_axis(curvature, scale[None, None, ..., None], axis=0)[0], 0, 0)
    (tx, ty), (nx, ny) = np.moveaxis(tangent[:, :, 1], -1, 0)[..., None], np.moveaxis(normal[:, :, 1], -1, 0)[..., None]
    across = nx * nx * xx + 2.0 * nx * ny * xy + ny * ny * yy
    along = tx * tx * xx + 2.0 * tx * ty * xy + ty * ty * yy
    return edges, np.abs(across) - np.abs(along), counts


@kernel(error_model="numpy")
def _differentiate(
    first: int, last: int, levels: Any, contrast: Any, squares: Any, left: int, top: int, gradient: Any, ridges: Any
) -> None:
    """Rows `first` to `last` of the box, in float32 and in OpenCV's order: differences, and differences of these."""
    height, width = contrast.shape
    for row in range(first, last):
        y = top + row
        up, down = _mirrored(y - 1, height), _mirrored(y + 1, height)
        up_up, up_down = _mirrored(up - 1, height), _mirrored(up + 1, height)
        down_up, down_down = _mirrored(down - 1, height), _mirrored(down + 1, height)
        for column in range(gradient.shape[1]):
            x = left + column
            before, after = _mirrored(x - 1, width), _mirrored(x + 1, width)
            far_before, back = _mirrored(before - 1, width), _mirrored(before + 1, width)
            forth, far_after = _mirrored(after - 1, width), _mirrored(after + 1, width)
            per = contrast[y, x]
            gradient[row, column, 0] = _half(levels[0, y, after], levels[0, y, before]) / per
            gradient[row, column, 1] = _half(levels[0, down, x], levels[0, up, x]) / per
            for s in range(squares.shape[0]):
                level, found = levels[1 + s], ridges[s, row, column]
                xx = _half(_half(level[y, far_after], level[y, forth]), _half(level[y, back], level[y, far_before]))
                xy = _half(_half(level[down, after], level[down, before]), _half(level[up, after], level[up, before]))
                yy = _half(_half(level[down_down, x], level[down_up, x]), _half(level[up_down, x], level[up_up, x]))
                found[0], found[1], found[2] = squares[s] * xx / per, squares[s] * xy / per, squares[s] * yy / per


@inlined_exactly
def _half(later: Any, earlier: Any) -> Any:
    return np.float32(0.5) * (later - earlier)


@inlined_exactly
def _mirrored(i: int, n: int) -> Any:
    """The index of a pixel that may be one beyond the image, whose border is a mirror, as for OpenCV."""
    return np.uint32(min(abs(i), abs(2 * (n - 1) - i), n - 1))
