"""Whitened residuals of a pose, the terms of least squares.

A residual function maps a pose (P,) to whitened residuals (K,), dimensionless, and their Jacobian (K, P). It recomputes
pose-dependent associations, such as the body part of each point, at every call.
"""

from collections.abc import Callable, Sequence
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np

from workbench.body.kinematics import forward, joint_jacobian
from workbench.body.skeleton import Skeleton
from workbench.body.surface import Kind, Surface, nearest_residual_jacobian
from workbench.cameras.camera import Camera
from workbench.core.losses import BEHIND, Loss
from workbench.core.observations import Observables, Observed
from workbench.utils.arrays import FloatArray, IntArray

ResidualFunction: TypeAlias = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


class ResidualLikelihood(Protocol):
    """A likelihood with RESIDUALS: residuals and a loss for least squares. observables: the observations it uses and
    their standard deviations."""

    @property
    def observables(self) -> Observables: ...
    @property
    def residual_loss(self) -> Loss: ...

    def residual_function(self, observed: Observed) -> ResidualFunction:
        """Return the residual function of one frame; without residuals if the frame has no observations for it."""


@runtime_checkable
class KeypointResiduals(ResidualLikelihood, Protocol):
    """A likelihood with keypoint residuals (projected joint − keypoint) · whitening, as in `keypoint_residual`; fits
    then evaluate all frames in one kernel."""

    def whitening(self, weights: FloatArray) -> FloatArray:
        """Return the inverse standard deviations (M,), 1/px, of keypoints with weights (M,)."""


def robust(residual: ResidualFunction, loss: Loss) -> ResidualFunction:
    """Return the residual √(2 ρ), whose half square is the loss, with its Jacobian; stacked residuals can then have
    different losses."""

    def robustified(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        values, jacobian = residual(pose)
        rho, weights = loss(values)
        size = np.sqrt(2.0 * rho)
        factor = np.divide(weights * np.abs(values), size, out=np.ones_like(size), where=size > 0.0)
        return np.sign(values) * size, factor[:, None] * jacobian

    return robustified


def scaled(residual: ResidualFunction, factor: float) -> ResidualFunction:
    """Return the residual and its Jacobian multiplied by a factor."""

    def multiplied(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        values, jacobian = residual(pose)
        return factor * values, factor * jacobian

    return multiplied


def stacked(residuals: Sequence[ResidualFunction]) -> ResidualFunction:
    """Return the concatenation of several residual functions, in order."""
    if len(residuals) < 2:
        return residuals[0] if residuals else no_residuals

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        values, jacobians = zip(*(function(pose) for function in residuals), strict=True)
        return np.concatenate(values), np.concatenate(jacobians)

    return residual


def no_residuals(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return empty residuals (0,) and their Jacobian (0, P)."""
    return np.empty(0), np.empty((0, len(pose)))


def surface_residual(
    skeleton: Skeleton, surface: Surface, points: FloatArray, kind: Kind, sigma: float
) -> ResidualFunction:
    """Return the residual of points (K, 3), m, from the body surface.

    Each point is associated with the nearest body part in the evaluated pose (paper D, eq. 5, 6), so that the cost is
    the distance to the nearest part and never increases in an accepted step.

    Parameters
    ----------
    sigma : standard deviation, m for kind "distance", the field's unit for "field".
    """
    if not len(points):
        return no_residuals

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        values, jacobian = nearest_residual_jacobian(skeleton, surface, pose, points, kind)
        values /= sigma
        jacobian *= 1.0 / sigma
        return values, jacobian

    return residual


def keypoint_residual(
    skeleton: Skeleton, camera: Camera, joints: IntArray, keypoints: FloatArray, sigma_px: float
) -> ResidualFunction:
    """Return the reprojection residual of joints, 2 K values.

    The Jacobian neglects lens distortion, the residual includes it.

    Parameters
    ----------
    joints : (K,) joint indices.
    keypoints : (K, 3) annotated or detected [u px, v px, weight 0..1].
    sigma_px : standard deviation of a keypoint of weight 1, px; it is sigma_px / √weight in general. The residual of a
        joint behind the camera is BEHIND.
    """
    if not len(keypoints):
        return no_residuals
    whitening = np.sqrt(keypoints[:, 2:]) / sigma_px

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        points = forward(skeleton, pose[None]).positions[0, joints]
        errors = np.nan_to_num((camera.project(points) - keypoints[:, :2]) * whitening, nan=BEHIND)
        jacobian = projection_jacobian(camera, points) @ joint_jacobian(skeleton, pose[None])[0, joints]
        return errors.ravel(), (jacobian * whitening[:, :, None]).reshape(errors.size, -1)

    return residual


def projection_jacobian(camera: Camera, points: FloatArray) -> FloatArray:
    """Return the Jacobian (n, 2, 3), px/m, of the projection of world points (n, 3), without lens distortion."""
    x, y, z = camera.to_camera(points).T
    zero = np.zeros_like(z)
    focal_x, focal_y = camera.matrix[0, 0], camera.matrix[1, 1]
    jacobian = np.array([[focal_x / z, zero, -focal_x * x / z**2], [zero, focal_y / z, -focal_y * y / z**2]])
    return jacobian.transpose(2, 0, 1) @ camera.rotation
