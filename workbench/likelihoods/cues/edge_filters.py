"""Responses of edge and ridge filters, steered along the limbs (Sidenbladh & Black, IJCV 54, 2003, section 4).

An edge is the derivative of the image across a limb's side. A ridge is the second derivative across its axis minus that
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
RIDGE_SCALES_PX = (2.0, 4.0, 8.0)  # standard deviations of the filters' Gaussians
RIDGE_PER_HALF_WIDTH = 0.6  # scale of the largest response to a bar, over half its width: 1/√3
LOG_WIDTHS = np.log(np.array(RIDGE_SCALES_PX) / RIDGE_PER_HALF_WIDTH)  # of the limbs' half widths, px, by scale
CONTRAST_WINDOW_PX, CONTRAST_FLOOR = 31, 4.0
"""Contrast is the standard deviation in a square window, plus this many grey levels, about the sensor's noise."""
ALONG = 8  # positions along a limb; each has a point on both sides and one on the axis
POINTS = patch_grid((np.arange(ALONG) + 0.5) / ALONG, np.array([-1.0, 0.0, 1.0]))
"""The points (3 ALONG, 2) of every patch: (u, v), v varying fastest."""
MIN_LENGTH_PX = 2.0  # a limb shorter than this in the image has no direction


_ROWS = 32  # minimum rows of the image per thread
_DERIVATIVE_MARGIN_PX = 2  # support of a second difference
_SMOOTHING_MARGIN_PX = 32  # support of the widest Gaussian in OpenCV; the contrast's window is smaller
_COLUMNS = 32  # boxes begin at multiples of it, so that vector sums of a pixel are bitwise identical


@dataclass(frozen=True, eq=False)
class SmoothedBox:
    """A box of an image at 1 + S scales, those of the edges and of the ridges, (1 + S, height, width), and its local
    contrast (height, width)."""

    levels: Float32Array
    contrast: Float32Array
    box: Box


@dataclass(frozen=True, eq=False)
class FilteredBox:
    """Derivatives of a box of an image, over the contrast. gradient: (height, width, 2), d/dx and d/dy. ridges: (S,
    height, width, 3), d²/dx², d²/dxdy and d²/dy² at S scales, times the square of the scale. corner: (x, y) of the
    box's first pixel."""

    gradient: Float32Array
    ridges: Float32Array
    corner: tuple[int, int] = (0, 0)


class SmoothedView:
    """A view that is smoothed on demand, in boxes, with a cache."""

    def __init__(self, view: View) -> None:
        """Read the view's grey levels; raises InputError if the image's size is not the camera's."""
        self._grey = image_levels.grey_levels(view, 0.0)
        self._cached: SmoothedBox | None = None

    def smoothed_around(self, box: Box) -> SmoothedBox:
        """Return all that the filters need within a box."""
        part = _padded_box(box, self._grey, _DERIVATIVE_MARGIN_PX)
        if self._cached is not None:
            part = _joint_box(part, self._cached.box)
        if self._cached is None or part != self._cached.box:
            self._cached = _smoothed(self._grey, part)
        return self._cached


def smoothed(view: View) -> SmoothedBox:
    """Return the smoothed view; raises as `SmoothedView`."""
    return SmoothedView(view).smoothed_around((0, 0, view.image.shape[1], view.image.shape[0]))


def _smoothed(grey: Float32Array, part: Box) -> SmoothedBox:
    """Return a box of an image, smoothed as in the whole image."""
    left, top, right, bottom = source = _padded_box(part, grey, _SMOOTHING_MARGIN_PX)
    pixels, scales = np.ascontiguousarray(grey[top:bottom, left:right]), (EDGE_SCALE_PX, *RIDGE_SCALES_PX)
    within = (slice(part[1] - source[1], part[3] - source[1]), slice(part[0] - source[0], part[2] - source[0]))
    levels = np.empty((len(scales), part[3] - part[1], part[2] - part[0]), dtype=np.float32)
    contrast = np.empty_like(levels[0])

    def smooth(first: int, last: int) -> None:
        for k in range(first, last):
            if k == len(scales):
                contrast[:] = _contrast(pixels)[within]
            else:
                levels[-1 - k] = cv2.GaussianBlur(pixels, (0, 0), scales[-1 - k])[
                    within
                ]  # the widest first, as it takes longest

    parallel_for(smooth, len(scales) + 1, 1)
    return SmoothedBox(levels, contrast, part)


def _padded_box(box: Box, image: Float32Array, margin_px: int) -> Box:
    """Return the box enlarged by at least margin_px on all sides, within the image, in whole `_COLUMNS`."""
    (height, width), (left, top, right, bottom) = image.shape, box
    first, last = (left - margin_px) // _COLUMNS * _COLUMNS, -(-(right + margin_px) // _COLUMNS) * _COLUMNS
    return max(first, 0), max(top - margin_px, 0), min(last, width), min(bottom + margin_px, height)


def _joint_box(one: Box, other: Box) -> Box:
    """Return the smallest box around two."""
    return min(one[0], other[0]), min(one[1], other[1]), max(one[2], other[2]), max(one[3], other[3])


def _contrast(grey: Float32Array) -> Float32Array:
    window = (CONTRAST_WINDOW_PX, CONTRAST_WINDOW_PX)
    variance = cv2.blur(grey * grey, window) - cv2.blur(grey, window) ** 2
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)) + CONTRAST_FLOOR, dtype=np.float32)


def filtered(images: SmoothedBox, box: Box | None = None) -> FilteredBox:
    """Return the derivatives within a box of the image, which `images` contains; None: of all of `images`."""
    left, top, right, bottom = box or images.box
    shape = (bottom - top, right - left)
    gradient, ridges = np.empty((*shape, 2), np.float32), np.empty((len(RIDGE_SCALES_PX), *shape, 3), np.float32)
    squares = np.square(np.array(RIDGE_SCALES_PX, dtype=np.float32))
    arguments = (images.levels, images.contrast, squares, left - images.box[0], top - images.box[1], gradient, ridges)
    parallel_for(lambda first, last: _differentiate(first, last, *arguments), shape[0], _ROWS)
    return FilteredBox(gradient, ridges, (left, top))


def responses(images: FilteredBox, points: LimbPoints) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return edges (N, L, ALONG, 2) at both sides, ridges (N, L, ALONG) on the axis, and which POINTS (N, L, ALONG, 3)
    are valid: none of limbs too short in the image. The training responses of `edges.EdgeModel`."""
    n, limbs = points.valid.shape[:2]
    pixels = points.pixels.astype(np.float64).reshape(n, limbs, ALONG, 3, 2)
    direction = pixels[:, :, -1] - pixels[:, :, 0]  # (N, L, 3, 2) along the limb, at its sides and on its axis
    length = np.linalg.norm(direction, axis=-1)
    tangent = direction / np.maximum(length, 1e-9)[..., None]
    normal = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)
    valid = points.valid.reshape(n, limbs, ALONG, 3) & (length > MIN_LENGTH_PX)[:, :, None]

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
    return edges, np.abs(across) - np.abs(along), valid


@kernel(error_model="numpy")
def _differentiate(
    first: int, last: int, levels: Any, contrast: Any, squares: Any, left: int, top: int, gradient: Any, ridges: Any
) -> None:
    """Compute rows `first` to `last` of the box, in float32 and in OpenCV's order: first and second differences."""
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
            contrast_at = contrast[y, x]
            gradient[row, column, 0] = _half(levels[0, y, after], levels[0, y, before]) / contrast_at
            gradient[row, column, 1] = _half(levels[0, down, x], levels[0, up, x]) / contrast_at
            for s in range(squares.shape[0]):
                level, derivatives = levels[1 + s], ridges[s, row, column]
                xx = _half(_half(level[y, far_after], level[y, forth]), _half(level[y, back], level[y, far_before]))
                xy = _half(_half(level[down, after], level[down, before]), _half(level[up, after], level[up, before]))
                yy = _half(_half(level[down_down, x], level[down_up, x]), _half(level[up_down, x], level[up_up, x]))
                derivatives[0], derivatives[1], derivatives[2] = (
                    squares[s] * xx / contrast_at, squares[s] * xy / contrast_at, squares[s] * yy / contrast_at,
                )  # fmt: skip


@inlined_exactly
def _half(later: Any, earlier: Any) -> Any:
    return np.float32(0.5) * (later - earlier)


@inlined_exactly
def _mirrored(i: int, n: int) -> Any:
    """Return the index of a pixel up to one beyond the image, whose border is a mirror, as in OpenCV."""
    return np.uint32(min(abs(i), abs(2 * (n - 1) - i), n - 1))
