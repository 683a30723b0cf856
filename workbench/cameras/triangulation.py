"""Triangulation: points nearest to the rays of several cameras, and distances between rays."""

from collections.abc import Sequence

import numpy as np

from workbench.cameras.camera import Camera
from workbench.utils.arrays import FloatArray

_MIN_SINE = 0.05
"""Sine of the smallest angle between two rays, 3°, that determine a distance."""


def triangulate(cameras: Sequence[Camera], pixels: FloatArray) -> FloatArray:
    """Return the points (..., 3), m, with least mean squared distance to the cameras' rays through pixels.

    Parameters
    ----------
    cameras : V ≥ 1, with their distortion.
    pixels : (V, ..., 2), px; NaN where a camera does not see the point.

    Returns
    -------
    NaN where fewer than two cameras see the point, and where all rays are parallel.

    References
    ----------
    Hartley & Sturm, *Triangulation*, CVIU 1997, the midpoint method for any number of rays.
    """
    return triangulate_normalized(cameras, undistorted(cameras, pixels))


def triangulate_normalized(cameras: Sequence[Camera], places: FloatArray) -> FloatArray:
    """Return the points (..., 3), m, as `triangulate` does, of undistorted x/z, y/z (V, ..., 2) in the cameras' frames.

    The point nearest to rays of unit directions d through the origins o solves Σ (I − d dᵀ) x = Σ (I − d dᵀ) o.
    """
    rays = ray_directions(cameras, places)
    finite = np.asarray(np.isfinite(rays).all(axis=-1), bool)
    projections = np.where(finite[..., None, None], np.eye(3) - rays[..., :, None] * rays[..., None, :], 0.0)
    normal, moments = np.zeros(projections.shape[1:]), np.zeros(projections.shape[1:-1])
    for projection, camera in zip(projections, cameras, strict=True):
        normal += projection
        moments += projection @ camera.position
    points = np.full(moments.shape, np.nan)
    solvable = (finite.sum(axis=0) > 1) & (np.abs(np.linalg.det(normal)) > 1e-9)
    points[solvable] = np.linalg.solve(normal[solvable], moments[solvable, :, None])[..., 0]
    return points


def undistorted(cameras: Sequence[Camera], pixels: FloatArray) -> FloatArray:
    """Return x/z, y/z (V, ..., 2) in the cameras' frames of pixels (V, ..., 2); NaN at NaN."""
    return np.stack([camera.undistorted(one) for camera, one in zip(cameras, pixels, strict=True)])


def ray_directions(cameras: Sequence[Camera], places: FloatArray) -> FloatArray:
    """Return unit directions (V, ..., 3) in the world of the rays through x/z, y/z (V, ..., 2) in their frames."""
    return np.stack([camera.directions(one) for camera, one in zip(cameras, places, strict=True)])


def ray_distances(a: FloatArray, b: FloatArray, baseline: FloatArray) -> FloatArray:
    """Return the distances (...), m, between the lines of rays of unit directions a and b (..., 3); NaN for a missing
    ray, and below 3° between them. baseline: (3,) from the origin of the first to that of the second, m."""
    normal = np.cross(a, b)
    sine = np.linalg.norm(normal, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(sine > _MIN_SINE, np.abs(normal @ baseline) / sine, np.nan)
