"""One camera's image of one frame at several smoothings, and how well a pose agrees with it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from workbench.body.camera import Camera
from workbench.body.kinematics import JointFrames
from workbench.body.limbs import Body
from workbench.likelihoods.cues.limb_points import limb_points
from workbench.likelihoods.cues.outlines import CORNERS, covered
from workbench.likelihoods.dense.kernels import add_normal, sample
from workbench.likelihoods.dense.surface_elements import Placed, PointMotion, beside, inside
from workbench.utils.arrays import BoolArray, Float32Array, FloatArray, IntArray
from workbench.utils.parallel import parallel_for


def interpolated(image: Float32Array, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return values (K,) and gradients (K, 2), 1/px, of an image between the centres of pixels (K, 2), which lie at
    least 2 px inside: half the differences of what is a pixel to either side."""
    values, gradients = np.empty(len(pixels)), np.empty((len(pixels), 2))
    sample(image, pixels, values, gradients)
    return values, gradients


def picture(image: Float32Array, blur_px: float) -> Float32Array:
    """Smooth an image (height, width)."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), blur_px), dtype=np.float32)


def pictures(images: Sequence[Float32Array], blurs_px: Sequence[float]) -> list[tuple[Float32Array, ...]]:
    """Return every image at every smoothing."""
    wanted = [(image, blur) for image in images for blur in blurs_px]
    found: dict[int, Float32Array] = {}

    def smooth(first: int, last: int) -> None:
        found.update({k: picture(*wanted[k]) for k in range(first, last)})

    parallel_for(smooth, len(wanted), 1)
    return [tuple(found[k * len(blurs_px) + level] for level in range(len(blurs_px))) for k in range(len(images))]


TEXTURE_BEND, OUTLINE_BEND = 2.0, 10.0
"""Where the losses bend, in deviations: anything may lie on a person, but hardly anything is as dark as a scene."""
THIN = 2
"""Of every so many rows and columns one is looked at where poses far apart are compared."""
BESIDE = (0.7, 1.6)
"""Distances beside the limbs at which outlines are compared, in parts of the smoothing."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """How far K points are from what they should show, in deviations. misses: (K,). gradients: (K, 2), their
    derivatives by the point's pixel. points: (K, 3), m. joints: (K,) they hang on. counts: (K,), 0 where nothing is
    known. bend: of the loss."""

    misses: FloatArray
    gradients: FloatArray
    points: FloatArray
    joints: IntArray
    counts: FloatArray
    bend: float

    @property
    def losses(self) -> FloatArray:
        """½ c² r² / (c² + r²) of every point (K,) that counts."""
        squares = self.misses**2
        return np.asarray(self.counts * 0.5 * self.bend**2 * squares / (self.bend**2 + squares))

    @property
    def loss(self) -> float:
        """Their sum."""
        return float(self.losses.sum())

    def normal(self, motion: PointMotion, camera: Camera) -> tuple[FloatArray, FloatArray]:
        """Gradient (P,) and Gauss–Newton curvature (P, P) of the loss."""
        gradient, curvature = np.zeros(len(motion.axes)), np.zeros((len(motion.axes), len(motion.axes)))
        add_normal(
            self.misses, self.gradients, self.points, self.joints, self.counts, self.bend, camera.row,
            motion.axes, motion.moments, motion.moves, gradient, curvature,
        )  # fmt: skip
        return gradient, curvature


@dataclass(frozen=True, eq=False)
class Sight:
    """What one camera shows. levels, foreground: its grey levels and where it shows no scene (0..1), by smoothing.
    known: (height, width), where the scene is known; free: where nothing passes before the person. ratio: log
    ratio of a person of any grey level to the scene."""

    camera: Camera
    levels: tuple[Float32Array, ...]
    foreground: tuple[Float32Array, ...]
    known: BoolArray
    free: BoolArray
    ratio: Float32Array

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width, px."""
        height, width = self.free.shape
        return height, width

    @cached_property
    def thinned(self) -> tuple[Camera, Float32Array, Float32Array, BoolArray]:
        """Every THIN-th row and column of the image, least smoothed, of the ratio and of what is free, and the camera
        that sees these."""
        matrix = np.diag([1.0 / THIN, 1.0 / THIN, 1.0]) @ self.camera.matrix
        image, ratio = (np.ascontiguousarray(each[::THIN, ::THIN]) for each in (self.levels[-1], self.ratio))
        height, width = image.shape
        camera = replace(self.camera, width=width, height=height, matrix=matrix)
        return camera, image, ratio, np.ascontiguousarray(self.free[::THIN, ::THIN])

    def texture(
        self, level: int, cells: Placed, shown: IntArray, joints: IntArray, means: FloatArray, sigma: FloatArray
    ) -> Residuals:
        """Compare grey levels at cells `shown` (K,) on joints (K,) with means (K,) and deviations (K,)."""
        values, gradients = interpolated(self.levels[level], cells.pixels[shown])
        free = at(self.free, cells.pixels[shown])
        misses, slopes = (values - means) / sigma, gradients / sigma[:, None]
        return Residuals(misses, slopes, cells.points[shown], joints, free, TEXTURE_BEND)

    def outline(
        self, level: int, blur_px: float, body: Body, frames: JointFrames,
        cells: Placed, shown: IntArray, joints: IntArray, deviation: float,
    ) -> Residuals:  # fmt: skip
        """Compare where the person is in the pose with where the image shows no scene, at visible cells and beside."""
        near, hang_on, near_pixels = beside(body.limbs, frames, self.camera, tuple(part * blur_px for part in BESIDE))
        kept = inside(near_pixels, self.shape)
        pixels = np.concatenate([cells.pixels[shown], near_pixels[kept]])
        values, gradients = interpolated(self.foreground[level], pixels)
        own, own_gradients = self._expected(body, frames, pixels, blur_px)
        return Residuals(
            (values - own) / deviation, 0.5 * (gradients + own_gradients) / deviation,
            np.concatenate([cells.points[shown], near[kept]]), np.concatenate([joints, hang_on[kept]]),
            at(self.known & self.free, pixels), OUTLINE_BEND,
        )  # fmt: skip

    def _expected(
        self, body: Body, frames: JointFrames, pixels: FloatArray, blur_px: float
    ) -> tuple[FloatArray, FloatArray]:
        """Values (K,) and gradients (K, 2) of the smoothed outline at pixels (K, 2); it is drawn only about these."""
        if not len(pixels):
            return np.zeros(0), np.zeros((0, 2))
        margin = int(np.ceil(5.0 * blur_px)) + 2  # beyond the reach of OpenCV's Gaussians
        x, y = pixels.T  # by themselves, as NumPy takes 20 times as long for both at once
        low = np.maximum(np.floor([x.min(), y.min()]).astype(np.int64) - margin, 0)
        high = np.minimum(np.ceil([x.max(), y.max()]).astype(np.int64) + margin + 1, self.shape[::-1])
        corners = limb_points(body, CORNERS, self.camera, frames).pixels[0] - low.astype(np.float32)
        drawn = covered(corners, body.limbs.spheres, (int(high[1] - low[1]), int(high[0] - low[0])))
        return interpolated(picture(drawn.astype(np.float32), blur_px), pixels - low)


def person_mask(body: Body, camera: Camera, frames: JointFrames, shape: tuple[int, int]) -> BoolArray:
    """Return which pixels (height, width) the person covers in the first of some poses, by the limbs' planar
    patches."""
    corners = limb_points(body, CORNERS, camera, frames).pixels[0]
    return covered(corners, body.limbs.spheres, shape)


def at(mask: BoolArray, pixels: FloatArray) -> FloatArray:
    """Look a mask up at pixels (K, 2): 1 or 0."""
    x, y = np.rint(pixels).astype(np.int64).T
    return mask[y, x].astype(np.float64)
