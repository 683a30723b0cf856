"""Approximation of further lens models by OpenCV's five coefficients."""

import logging

import cv2
import numpy as np

from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

log = logging.getLogger(__name__)

_GRID = 81
_WIDEST = 1.5
"""Largest radius of sampled rays over that of the image's corners without distortion."""
_MAX_ERROR_PX = 3.0
"""Largest error of a lens, of the order of a detector's noise."""


def five_coefficients(
    size: tuple[int, int], matrix: FloatArray, coefficients: FloatArray, fisheye: bool
) -> tuple[FloatArray, float]:
    """Return k1, k2, p1, p2, k3 nearest to another lens model over an image, and the largest error, px.

    The distorted places are linear in the coefficients, so that they are found by least squares over a grid of rays.

    Parameters
    ----------
    size : width and height of the image, px.
    matrix : (3, 3), px.
    coefficients : 4 of OpenCV's fisheye model, or 4, 5, 8, 12 or 14 of its rational model.
    fisheye : whether the coefficients are of the fisheye model.
    """
    focal, centre = matrix[[0, 1], [0, 1]], matrix[:2, 2]
    corners = (np.array([[0.0, 0.0], size, [0.0, size[1]], [size[0], 0.0]]) - centre) / focal
    reach = _WIDEST * float(np.linalg.norm(corners, axis=1).max())
    x, y = (axis.ravel() for axis in np.meshgrid(*2 * [np.linspace(-reach, reach, _GRID)]))
    rays, zero = np.stack([x, y, np.ones_like(x)], axis=1)[:, None], np.zeros(3)
    project = cv2.fisheye.projectPoints if fisheye else cv2.projectPoints
    pixels = np.asarray(project(rays, zero, zero, matrix, coefficients)[0], dtype=np.float64).reshape(-1, 2)
    inside = ((pixels >= 0.0) & (pixels <= np.array(size) - 1.0)).all(axis=1)
    return fitted_coefficients(np.stack([x[inside], y[inside]], axis=1), pixels[inside], focal, centre)


def fitted_coefficients(
    rays: FloatArray, pixels: FloatArray, focal: FloatArray, centre: FloatArray
) -> tuple[FloatArray, float]:
    """Return k1, k2, p1, p2, k3 that map rays x/z, y/z (N, 2) nearest to pixels (N, 2), and the largest error, px.

    focal, centre: (2,) focal lengths and principal point, px.
    """
    x, y = rays.T
    r2 = x * x + y * y
    across = [x * r2, x * r2**2, 2.0 * x * y, r2 + 2.0 * x * x, x * r2**3]
    down = [y * r2, y * r2**2, r2 + 2.0 * y * y, 2.0 * x * y, y * r2**3]
    shifts = pixels - rays * focal - centre
    system = np.concatenate([np.stack(across, axis=1) * focal[0], np.stack(down, axis=1) * focal[1]])
    fitted, *_ = np.linalg.lstsq(system, shifts.T.ravel(), rcond=None)
    return fitted, float(np.abs(system @ fitted - shifts.T.ravel()).max(initial=0.0))


def check_lens_error(place: str, error_px: float) -> None:
    """Report the error of a lens approximated by five coefficients; raises InputError where it is too large."""
    if not error_px <= _MAX_ERROR_PX:
        raise InputError(
            f"{place}: its lens differs by {error_px:.2g} px from five coefficients; "
            "undistort the images first, and set fisheye = false and distortions of 0"
        )
    log.warning("%s: its lens is approximated by five coefficients to %.2g px", place, error_px)
