"""Approximation of further lens models by OpenCV's five coefficients."""

import logging

import cv2
import numpy as np

from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

log = logging.getLogger(__name__)

_N_RADII, _N_ON_SIDE = 192, 8
"""Of the sampled rays: their distances from the optical axis, and directions towards each side of the image."""
_WIDEST = 3.0
"""Largest radius of sampled rays over that of the image's corners without distortion."""
_MAX_ERROR_PX = 3.0
"""Largest error of a lens, of the order of a detector's noise."""
_TINY_PX = 1e-9
"""Added to errors, so that no weight is zero."""
_LARGEST_RAY = 1e3
"""Of x/z and y/z: 89.9° from the optical axis."""
_N_REWEIGHTINGS = 40
"""Of Lawson's algorithm, after which the largest errors of wide lenses change by less than 1 %."""


def five_coefficients(
    size: tuple[int, int], matrix: FloatArray, coefficients: FloatArray, fisheye: bool
) -> tuple[FloatArray, FloatArray, float]:
    """Return k1, k2, p1, p2, k3 nearest to another lens model over an image, their matrix (3, 3), and the largest
    error, px; see `fitted_coefficients`.

    Parameters
    ----------
    size : width and height of the image, px.
    matrix : (3, 3), px.
    coefficients : 4 of OpenCV's fisheye model, or 4, 5, 8, 12 or 14 of its rational model.
    fisheye : whether the coefficients are of the fisheye model.
    """
    focal, centre = matrix[[0, 1], [0, 1]], matrix[:2, 2]
    corners = np.array([[0.0, 0.0], [size[0] - 1.0, 0.0], np.array(size) - 1.0, [0.0, size[1] - 1.0]])
    sides = np.roll(corners, -1, axis=0) - corners
    border = corners[:, None] + np.arange(_N_ON_SIDE)[:, None] / _N_ON_SIDE * sides[:, None]
    directions = (border.reshape(-1, 2) - centre) / focal
    distances = np.linalg.norm(directions, axis=1, keepdims=True)
    radii = _WIDEST * distances.max() * np.arange(1, _N_RADII + 1) / _N_RADII
    rays = radii[:, None, None] * (directions / np.maximum(distances, _TINY_PX))
    points, zero = np.insert(rays.reshape(-1, 1, 2), 2, 1.0, axis=-1), np.zeros(3)
    project = cv2.fisheye.projectPoints if fisheye else cv2.projectPoints
    pixels = np.asarray(project(points, zero, zero, matrix, coefficients)[0], dtype=np.float64).reshape(rays.shape)
    # beyond its range, a polynomial maps rays back into the image
    rises = np.diff(np.linalg.norm(pixels - centre, axis=-1), axis=0, prepend=0.0) > 0.0
    in_image = ((pixels >= 0.0) & (pixels <= np.array(size) - 1.0)).all(axis=-1)
    inside = np.logical_and.accumulate(rises & in_image, axis=0)
    return fitted_coefficients(rays[inside], pixels[inside], matrix)


def fitted_coefficients(
    rays: FloatArray, pixels: FloatArray, matrix: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Return k1, k2, p1, p2, k3 and the matrix (3, 3), with another focal length, that map rays x/z, y/z (N, 2) nearest
    to pixels (N, 2), and the largest error, px, which is made as small as possible; infinite for no rays, and for rays
    beyond _LARGEST_RAY.

    The distorted places are linear in the coefficients and the focal length. The least largest error is that of least
    squares whose weights are multiplied by the errors again and again (Lawson 1961; Rice & Usow, Math. Comp. 22, 1968).

    matrix: (3, 3) of the lens, px.
    """
    if not len(rays) or not np.abs(rays).max() <= _LARGEST_RAY:
        return np.zeros(5), matrix, np.inf
    focal, centre = matrix[[0, 1], [0, 1]], matrix[:2, 2]
    x, y = rays.T
    r2 = x * x + y * y
    across = [x * r2, x * r2**2, 2.0 * x * y, r2 + 2.0 * x * x, x * r2**3, x]
    down = [y * r2, y * r2**2, r2 + 2.0 * y * y, 2.0 * x * y, y * r2**3, y]
    system = np.stack([np.stack(across, axis=1) * focal[0], np.stack(down, axis=1) * focal[1]], axis=1)  # (N, 2, 6)
    shifts, weights = pixels - rays * focal - centre, np.ones(len(rays))
    for _ in range(_N_REWEIGHTINGS):
        weighted = (system * weights[:, None, None]).reshape(-1, 6).T
        fitted, *_ = np.linalg.lstsq(weighted @ system.reshape(-1, 6), weighted @ shifts.ravel(), rcond=None)
        errors_px = np.linalg.norm(system @ fitted - shifts, axis=1)
        weights = weights * (errors_px + _TINY_PX)
        weights /= weights.max()
    scale = 1.0 + fitted[5]
    scaled = matrix * np.array([[scale, scale, 1.0], [scale, scale, 1.0], [1.0, 1.0, 1.0]])
    return fitted[:5] / scale, scaled, float(errors_px.max())


def check_lens_error(place: str, error_px: float) -> None:
    """Report the error of a lens approximated by five coefficients; raises InputError where it is too large."""
    if not error_px <= _MAX_ERROR_PX:
        raise InputError(
            f"{place}: its lens differs by {error_px:.2g} px from five coefficients; "
            "undistort the images first, and set fisheye = false and distortions of 0"
        )
    log.warning("%s: its lens is approximated by five coefficients to %.2g px", place, error_px)
