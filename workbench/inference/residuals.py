"""What one frame says about a pose, as a function of the pose: points on the surface, keypoints, known joints.

A residual function takes a pose (P,) to whitened residuals (K,), dimensionless, and their derivative (K, P). Whatever
it has to look up for that pose, such as the part of the body that each point belongs to, it looks up anew.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from workbench.arrays import FloatArray, IntArray
from workbench.body.camera import Camera
from workbench.body.kinematics import forward, joint_jacobian
from workbench.body.skeleton import Skeleton
from workbench.body.surface import Kind, Surface, nearest_residual_jacobian
from workbench.inference.robust import LOSSES

UPRIGHT = slice(4, 6)
"""Pitch and roll in a pose."""

Residual: TypeAlias = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True)
class Loss:
    """A robust loss of whitened residuals. name: in robust.LOSSES. scale: where it bends, in standard deviations."""

    name: str
    scale: float

    def __call__(self, residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """ρ and weight (K,) of residuals (K,); ρ is ½ r² near zero, whatever the scale."""
        rho, weights = LOSSES[self.name](residuals / self.scale)
        return self.scale**2 * rho, weights

    def wider(self, factor: float) -> "Loss":
        """The same loss on a scale `factor` times as large."""
        return replace(self, scale=factor * self.scale)


def surface_residual(skeleton: Skeleton, surface: Surface, points: FloatArray, kind: Kind, sigma: float) -> Residual:
    """Of points (K, 3), m, seen on the surface, over `sigma`: m for kind "distance", the field's unit for "field".

    Every point belongs to the part of the body that is nearest in the pose asked for (paper D, eq. 5, 6), so that the
    cost is the distance to the nearest part, and a step that is accepted never raises it.
    """
    if not len(points):
        return _nothing

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        misses, slopes = nearest_residual_jacobian(skeleton, surface, pose, points, kind)
        misses /= sigma
        slopes *= 1.0 / sigma
        return misses, slopes

    return residual


def joint_residual(skeleton: Skeleton, joints: IntArray, points: FloatArray, sigma_m: float) -> Residual:
    """Of points (K, 3), m, known to be the joints (K,) of the skeleton; 3 K residuals."""
    if not len(points):
        return _nothing

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        apart = forward(skeleton, pose[None]).positions[0, joints] - points
        slopes = joint_jacobian(skeleton, pose[None])[0, joints]
        return apart.ravel() / sigma_m, slopes.reshape(apart.size, -1) / sigma_m

    return residual


def keypoint_residual(
    skeleton: Skeleton, camera: Camera, joints: IntArray, marks: FloatArray, sigma_px: float
) -> Residual:
    """Of joints (K,) marked or detected at pixels, marks (K, 3) [u px, v px, weight 0..1]; 2 K residuals.

    The standard deviation is sigma_px over the root of the weight. A joint behind the camera counts as 1000 deviations
    away. The derivative leaves the lens' distortion out, the residual does not.
    """
    if not len(marks):
        return _nothing
    whitening = np.sqrt(marks[:, 2:]) / sigma_px

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        points = forward(skeleton, pose[None]).positions[0, joints]
        apart = np.nan_to_num((camera.project(points) - marks[:, :2]) * whitening, nan=1e3)
        slopes = projection_jacobian(camera, points) @ joint_jacobian(skeleton, pose[None])[0, joints]
        return apart.ravel(), (slopes * whitening[:, :, None]).reshape(apart.size, -1)

    return residual


def upright_residual(skeleton: Skeleton, sigma_rad: float) -> Residual:
    """Of pitch and roll of the root, small in people who stand, walk or run, and badly seen by one camera."""
    leaning = np.eye(len(skeleton.dof_names))[UPRIGHT] / sigma_rad

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        return leaning @ pose, leaning

    return residual


def limit_residual(skeleton: Skeleton, sigma_rad: float) -> Residual:
    """Of angles beyond the skeleton's limits, by how much; zero within."""
    low, high = skeleton.limits.T

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        beyond = pose - np.clip(pose, low, high)
        return beyond / sigma_rad, np.diag(beyond != 0.0) / sigma_rad

    return residual


def robust(residual: Residual, loss: Loss) -> Residual:
    """With half its square as the loss, so that others beside it keep theirs: √(2 ρ), and its derivative."""

    def robustified(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        misses, slopes = residual(pose)
        rho, weights = loss(misses)
        size = np.sqrt(2.0 * rho)
        factor = np.divide(weights * np.abs(misses), size, out=np.ones_like(size), where=size > 0.0)
        return np.sign(misses) * size, factor[:, None] * slopes

    return robustified


def stacked(residuals: Sequence[Residual]) -> Residual:
    """All of them together."""
    if len(residuals) < 2:
        return residuals[0] if residuals else _nothing

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        misses, slopes = zip(*(one(pose) for one in residuals), strict=True)
        return np.concatenate(misses), np.concatenate(slopes)

    return residual


def projection_jacobian(camera: Camera, points: FloatArray) -> FloatArray:
    """Derivative (n, 2, 3), px/m, of the pixels of world points (n, 3); the lens' distortion is left out."""
    x, y, z = camera.to_camera(points).T
    zero = np.zeros_like(z)
    focal_x, focal_y = camera.matrix[0, 0], camera.matrix[1, 1]
    seen = np.array([[focal_x / z, zero, -focal_x * x / z**2], [zero, focal_y / z, -focal_y * y / z**2]])
    jacobian: FloatArray = seen.transpose(2, 0, 1) @ camera.rotation
    return jacobian


def _nothing(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
    return np.empty(0), np.empty((0, len(pose)))
