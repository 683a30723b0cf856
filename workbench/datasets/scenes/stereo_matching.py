"""From a stereo pair to points: OpenCV's semi-global block matching (Hirschmüller, PAMI 30, 2008), and what is nearer
than the empty scene."""

import cv2
import numpy as np

from workbench.arrays import ByteArray, FloatArray
from workbench.body.camera import Camera

BLOCK_PX = 5
NEARER_PX = 2.0
"""By how much of disparity a point must be nearer than the empty scene to be taken for someone's."""
PATCH_SHARE = 0.05
"""Patches of such points with less than this share of the largest one's pixels are taken for wrong matches."""


def disparities(left: ByteArray, right: ByteArray, n_disparities: int) -> FloatArray:
    """Tell how much further left, px, what the left image (height, width) shows is in the right one; NaN where unknown.

    n_disparities: a multiple of 16; larger ones are not searched. The smoothness penalties are those that OpenCV's
    documentation recommends, 8 and 32 times the block's area; patches of less than 100 px are taken for speckle.
    """
    matcher = cv2.StereoSGBM.create(
        minDisparity=0, numDisparities=n_disparities, blockSize=BLOCK_PX, P1=8 * BLOCK_PX**2, P2=32 * BLOCK_PX**2,
        disp12MaxDiff=1, uniquenessRatio=10, speckleWindowSize=100, speckleRange=2,
    )  # fmt: skip
    # the matcher leaves out a strip of n_disparities columns on the left, where a match might lie outside
    wide = [cv2.copyMakeBorder(image, 0, 0, n_disparities, 0, cv2.BORDER_REPLICATE) for image in (left, right)]
    found = matcher.compute(*wide)[:, n_disparities:] / 16.0
    return np.where((found > 0.0) & (found <= np.arange(left.shape[1])), found, np.nan)  # else the match is outside


def empty_disparity(pairs: FloatArray) -> FloatArray:
    """The largest disparity (height, width) in (n, height, width) of an empty room, NaN where few of them know it."""
    known = np.isfinite(pairs)
    largest = np.where(known, pairs, 0.0).max(axis=0)
    return np.where(2 * known.sum(axis=0) > len(pairs), largest, np.nan)


def nearer_points(seen: FloatArray, empty: FloatArray, camera: Camera, baseline_m: float) -> FloatArray:
    """The points (K, 3), m, in the world, of the pixels whose disparity (height, width) shows something before `empty`.

    Where either is unknown, and in patches that are small beside the largest, there is no point. camera: the left one,
    without distortion; the right one stands baseline_m along its x axis. A point of disparity d is at the depth
    f · baseline / d.
    """
    with np.errstate(invalid="ignore"):
        nearer = (seen >= empty + NEARER_PX).astype(np.uint8)
    _, patches, statistics, _ = cv2.connectedComponentsWithStats(nearer)
    sizes = np.where(np.arange(len(statistics)) > 0, statistics[:, cv2.CC_STAT_AREA], 0)  # the first one is the rest
    rows, columns = np.nonzero((nearer > 0) & (sizes >= PATCH_SHARE * sizes.max())[patches])
    depth = camera.matrix[0, 0] * baseline_m / seen[rows, columns]
    x = (columns - camera.matrix[0, 2]) / camera.matrix[0, 0]
    y = (rows - camera.matrix[1, 2]) / camera.matrix[1, 1]
    in_camera = np.stack([x, y, np.ones(len(x))], axis=1) * depth[:, None]
    return (in_camera - camera.translation) @ camera.rotation
