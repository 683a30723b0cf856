"""Points that cameras' rays meet in, and people who stand upright before one camera."""

from collections.abc import Sequence

import cv2
import numpy as np

from workbench.arrays import FloatArray
from workbench.body.camera import Camera

LEAST_WEIGHT = 0.3
"""Detected joints that are less sure than this are not looked at."""
UP = np.array([0.0, 0.0, 1.0])


def places(camera: Camera, pixels: FloatArray) -> FloatArray:
    """Return x/z, y/z (..., 2) in the camera's frame of pixels (..., 2), without distortion; NaN stays NaN."""
    found = np.full(pixels.shape, np.nan)
    known = np.isfinite(pixels).all(axis=-1)
    if known.any():
        found[known] = cv2.undistortPoints(pixels[known][:, None], camera.matrix, camera.distortion)[:, 0]
    return found


def rays(camera: Camera, pixels: FloatArray) -> FloatArray:
    """Return directions (..., 3) in the world of what is seen at pixels (..., 2), one unit deep."""
    flat = places(camera, pixels)
    return np.concatenate([flat, np.ones_like(flat[..., :1])], axis=-1) @ camera.rotation


def triangulated(cameras: Sequence[Camera], marks: FloatArray) -> FloatArray:
    """Return points (..., 3), m, that marks (V, ..., 3), [u, v, weight], of as many cameras show; NaN where fewer than
    two do, by the direct linear transform (Hartley & Zisserman, *Multiple View Geometry*, 2nd ed., section 12.2)."""
    sure = np.nan_to_num(marks[..., 2]) >= LEAST_WEIGHT
    rows = []
    for camera, seen, known in zip(cameras, marks, sure, strict=True):
        flat, pose = places(camera, seen[..., :2]), np.column_stack([camera.rotation, camera.translation])
        equations = flat[..., None] * pose[2] - pose[:2]  # (..., 2, 4)
        rows.append(np.where(known[..., None, None], np.nan_to_num(equations), 0.0))
    *_, axes = np.linalg.svd(np.concatenate(rows, axis=-2), full_matrices=True)
    point = axes[..., -1, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where((sure.sum(axis=0) > 1)[..., None], point[..., :3] / point[..., 3:], np.nan)


def upright(camera: Camera, feet: FloatArray, heads: FloatArray, length_m: float) -> FloatArray:
    """Return where feet are in the world, (F, 3), m, that are seen at pixels (F, 2) with heads (F, 2) length_m straight
    above them. With the rays a to the feet and b to the head, s a + length up = t b in the sense of least squares."""
    a, b = rays(camera, feet), rays(camera, heads)
    found = np.full(a.shape, np.nan)
    for k in np.flatnonzero(np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)):
        (s, _), *_ = np.linalg.lstsq(np.column_stack([a[k], -b[k]]), -length_m * UP, rcond=None)
        found[k] = camera.position + s * a[k]
    return found
