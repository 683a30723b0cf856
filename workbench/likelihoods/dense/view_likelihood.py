"""The dense likelihood of one camera's image, at several levels of smoothing."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from workbench.body.kinematics import JointFrames
from workbench.body.limbs import Body
from workbench.cameras.camera import Camera
from workbench.likelihoods.cues.limb_points import limb_points
from workbench.likelihoods.cues.outlines import CORNERS, outline_mask
from workbench.likelihoods.dense.kernels import add_normal_equations, interpolate_rows
from workbench.likelihoods.dense.surface_elements import PointMotion, ProjectedElements, contour_samples, inside
from workbench.utils.arrays import BoolArray, Float32Array, FloatArray, IntArray
from workbench.utils.parallel import parallel_for


def interpolate(image: Float32Array, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return values (K,) and gradients (K, 2), 1/px, of an image at pixels (K, 2), which are at least 2 px inside.
    Values are bilinear; gradients are half the differences of the values one pixel to either side."""
    values, gradients = np.empty(len(pixels)), np.empty((len(pixels), 2))
    interpolate_rows(image, pixels, values, gradients)
    return values, gradients


def smoothed_image(image: Float32Array, blur_px: float) -> Float32Array:
    """Return an image (height, width) smoothed by a Gaussian."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), blur_px), dtype=np.float32)


def smoothing_pyramids(images: Sequence[Float32Array], blurs_px: Sequence[float]) -> list[tuple[Float32Array, ...]]:
    """Return every image at every level of smoothing."""
    pairs = [(image, blur) for image in images for blur in blurs_px]
    smoothed: dict[int, Float32Array] = {}

    def smooth(first: int, last: int) -> None:
        smoothed.update({k: smoothed_image(*pairs[k]) for k in range(first, last)})

    parallel_for(smooth, len(pairs), 1)
    return [tuple(smoothed[k * len(blurs_px) + level] for level in range(len(blurs_px))) for k in range(len(images))]


TEXTURE_LOSS_SCALE, OUTLINE_LOSS_SCALE = 2.0, 10.0
"""Loss scales, in standard deviations: outliers are frequent on a person, but rare outside."""
SUBSAMPLING = 2
"""Step of the rows and columns at which distant poses are compared."""
CONTOUR_DISTANCES = (0.7, 1.6)
"""Distances from the limbs' contours at which outlines are compared, in units of the smoothing."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of K points, in standard deviations. values: (K,). gradients: (K, 2), their derivatives with respect to
    the point's pixel. points: (K, 3), m. joints: (K,), which carry the points. weights: (K,), 0 where nothing is known.
    loss_scale: of the robust loss."""

    values: FloatArray
    gradients: FloatArray
    points: FloatArray
    joints: IntArray
    weights: FloatArray
    loss_scale: float

    @property
    def losses(self) -> FloatArray:
        """The loss ½ c² r² / (c² + r²) of every point (K,), times its weight."""
        squares = self.values**2
        return np.asarray(self.weights * 0.5 * self.loss_scale**2 * squares / (self.loss_scale**2 + squares))

    @property
    def loss(self) -> float:
        """The sum of the losses."""
        return float(self.losses.sum())

    def normal_equations(self, motion: PointMotion, camera: Camera) -> tuple[FloatArray, FloatArray]:
        """Return the gradient (P,) and the Gauss–Newton curvature (P, P) of the loss."""
        gradient, curvature = np.zeros(len(motion.axes)), np.zeros((len(motion.axes), len(motion.axes)))
        add_normal_equations(
            self.values, self.gradients, self.points, self.joints, self.weights, self.loss_scale, camera.row,
            motion.axes, motion.moments, motion.dof_mask, gradient, curvature,
        )  # fmt: skip
        return gradient, curvature


@dataclass(frozen=True, eq=False)
class ViewLikelihood:
    """One camera's image and background. pyramid, foreground: grey levels and foreground probability (0..1), by level
    of smoothing. background_known: (height, width), whether the background is known. unoccluded: (height, width),
    pixels without an occluder. log_ratio: of a person of uniformly distributed grey level to the background."""

    camera: Camera
    pyramid: tuple[Float32Array, ...]
    foreground: tuple[Float32Array, ...]
    background_known: BoolArray
    unoccluded: BoolArray
    log_ratio: Float32Array

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width, px."""
        height, width = self.unoccluded.shape
        return height, width

    @cached_property
    def subsampled(self) -> tuple[Camera, Float32Array, Float32Array, BoolArray]:
        """The camera, the least smoothed image, its log ratio and its unoccluded pixels, at every SUBSAMPLING-th row
        and column."""
        matrix = np.diag([1.0 / SUBSAMPLING, 1.0 / SUBSAMPLING, 1.0]) @ self.camera.matrix
        image, log_ratio = (
            np.ascontiguousarray(each[::SUBSAMPLING, ::SUBSAMPLING]) for each in (self.pyramid[-1], self.log_ratio)
        )
        height, width = image.shape
        camera = replace(self.camera, width=width, height=height, matrix=matrix)
        return camera, image, log_ratio, np.ascontiguousarray(self.unoccluded[::SUBSAMPLING, ::SUBSAMPLING])

    def texture_residuals(
        self, level: int, elements: ProjectedElements, visible: IntArray, joints: IntArray, means: FloatArray,
        sigma: FloatArray,
    ) -> Residuals:  # fmt: skip
        """Return the residuals of grey levels at visible elements (K,) on joints (K,), given means (K,) and standard
        deviations (K,)."""
        values, gradients = interpolate(self.pyramid[level], elements.pixels[visible])
        unoccluded = mask_at(self.unoccluded, elements.pixels[visible])
        residuals, derivatives = (values - means) / sigma, gradients / sigma[:, None]
        return Residuals(residuals, derivatives, elements.points[visible], joints, unoccluded, TEXTURE_LOSS_SCALE)

    def outline_residuals(
        self, level: int, blur_px: float, body: Body, frames: JointFrames,
        elements: ProjectedElements, visible: IntArray, joints: IntArray, deviation: float,
    ) -> Residuals:  # fmt: skip
        """Return the differences of the image's foreground and the pose's outline, at visible elements and contour
        samples."""
        distances_px = tuple(factor * blur_px for factor in CONTOUR_DISTANCES)
        contour, contour_joints, contour_pixels = contour_samples(body.limbs, frames, self.camera, distances_px)
        in_image = inside(contour_pixels, self.shape)
        pixels = np.concatenate([elements.pixels[visible], contour_pixels[in_image]])
        values, gradients = interpolate(self.foreground[level], pixels)
        expected, expected_gradients = self._expected(body, frames, pixels, blur_px)
        return Residuals(
            (values - expected) / deviation, 0.5 * (gradients + expected_gradients) / deviation,
            np.concatenate([elements.points[visible], contour[in_image]]),
            np.concatenate([joints, contour_joints[in_image]]),
            mask_at(self.background_known & self.unoccluded, pixels), OUTLINE_LOSS_SCALE,
        )  # fmt: skip

    def _expected(
        self, body: Body, frames: JointFrames, pixels: FloatArray, blur_px: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return values (K,) and gradients (K, 2) of the smoothed outline at pixels (K, 2); only these are rendered."""
        if not len(pixels):
            return np.zeros(0), np.zeros((0, 2))
        margin = int(np.ceil(5.0 * blur_px)) + 2  # beyond the support of OpenCV's Gaussians
        x, y = pixels.T  # separately, 20 times as fast in NumPy as both at once
        low = np.maximum(np.floor([x.min(), y.min()]).astype(np.int64) - margin, 0)
        high = np.minimum(np.ceil([x.max(), y.max()]).astype(np.int64) + margin + 1, self.shape[::-1])
        corners = limb_points(body, CORNERS, self.camera, frames).pixels[0] - low.astype(np.float32)
        mask = outline_mask(corners, body.limbs.spheres, (int(high[1] - low[1]), int(high[0] - low[0])))
        return interpolate(smoothed_image(mask.astype(np.float32), blur_px), pixels - low)


def person_mask(body: Body, camera: Camera, frames: JointFrames, shape: tuple[int, int]) -> BoolArray:
    """Return the pixels (height, width) that the person covers in the first of some poses, by the limbs' planar
    patches."""
    corners = limb_points(body, CORNERS, camera, frames).pixels[0]
    return outline_mask(corners, body.limbs.spheres, shape)


def mask_at(mask: BoolArray, pixels: FloatArray) -> FloatArray:
    """Return a mask's values at pixels (K, 2): 1 or 0."""
    x, y = np.rint(pixels).astype(np.int64).T
    return mask[y, x].astype(np.float64)
