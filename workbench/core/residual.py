"""What least squares minimises: whitened residuals of a pose, under robust losses.

A residual function takes a pose (P,) to whitened residuals (K,), dimensionless, and their derivative (K, P). Whatever
it has to look up for that pose, such as the part of the body that each point belongs to, it looks up anew.

A robust loss takes z = residual / scale, (K,), to ρ(z) and the weight ρ'(z) / z, both (K,), for iteratively reweighted
least squares (Holland & Welsch 1977). Near zero all are ½ z² with weight 1, so that they differ only in how they treat
what is far off. Paper D has the squared loss alone.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np

from workbench.body.camera import Camera
from workbench.body.kinematics import forward, joint_jacobian
from workbench.body.skeleton import Skeleton
from workbench.body.surface import Kind, Surface, nearest_residual_jacobian
from workbench.core.observations import Observables, Observed
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

ResidualFunction: TypeAlias = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
RobustLoss: TypeAlias = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


def squared(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ρ = ½ z²: one far point outweighs everything else."""
    return 0.5 * z * z, np.ones_like(z)


def huber(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ρ = ½ z² up to |z| = 1, |z| − ½ beyond: far points pull with a constant force (Huber 1964)."""
    size = np.abs(z)
    return np.where(size <= 1.0, 0.5 * z * z, size - 0.5), 1.0 / np.maximum(size, 1.0)


def geman_mcclure(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ρ = ½ z² / (1 + z²): redescends, far points do not pull at all (Geman & McClure 1987)."""
    kept = 1.0 / (1.0 + z * z)
    return 0.5 * (1.0 - kept), kept * kept


LOSSES: Mapping[str, RobustLoss] = MappingProxyType(
    {"squared": squared, "huber": huber, "geman_mcclure": geman_mcclure}
)


@dataclass(frozen=True)
class Loss:
    """A robust loss of whitened residuals. name: in LOSSES. scale: where it bends, in standard deviations. Raises
    InputError for another name and a scale that is not positive."""

    name: str
    scale: float

    def __post_init__(self) -> None:
        if self.name not in LOSSES:
            raise InputError(f"loss must be one of {', '.join(LOSSES)}, found {self.name!r}")
        if not 0.0 < self.scale < np.inf:
            raise InputError(f"loss: scale must be above zero, found {self.scale}")

    def __call__(self, residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ρ and weight (K,) of residuals (K,); ρ is ½ r² near zero, whatever the scale."""
        rho, weights = LOSSES[self.name](residuals / self.scale)
        return self.scale**2 * rho, weights

    def wider(self, factor: float) -> "Loss":
        """Return this loss on a scale `factor` times as large."""
        return replace(self, scale=factor * self.scale)


SQUARED = Loss("squared", 1.0)


@runtime_checkable
class ResidualLikelihood(Protocol):
    """A likelihood that also says which residuals, under which loss, least squares minimises in its place. observables:
    what it looks at, and how exactly it takes that."""

    @property
    def observables(self) -> Observables: ...
    @property
    def residual_loss(self) -> Loss: ...

    def residual_function(self, observed: Observed) -> ResidualFunction:
        """Return the residuals of one frame; none where it shows nothing that the likelihood looks at."""


@runtime_checkable
class KeypointResiduals(ResidualLikelihood, Protocol):
    """A likelihood whose residuals of keypoints are (projected joint − keypoint) · whitening, as `keypoint_residual`:
    fits then take those of all frames at once."""

    def whitening(self, weights: FloatArray) -> FloatArray:
        """Return one over the deviations (M,), 1/px, of keypoints with weights (M,)."""


def robust(residual: ResidualFunction, loss: Loss) -> ResidualFunction:
    """Make half its square the loss, so that others beside it keep theirs: √(2 ρ), and its derivative."""

    def robustified(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        misses, slopes = residual(pose)
        rho, weights = loss(misses)
        size = np.sqrt(2.0 * rho)
        factor = np.divide(weights * np.abs(misses), size, out=np.ones_like(size), where=size > 0.0)
        return np.sign(misses) * size, factor[:, None] * slopes

    return robustified


def scaled(residual: ResidualFunction, factor: float) -> ResidualFunction:
    """Multiply its residuals and their derivative by a factor."""

    def multiplied(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        misses, slopes = residual(pose)
        return factor * misses, factor * slopes

    return multiplied


def stacked(residuals: Sequence[ResidualFunction]) -> ResidualFunction:
    """Put the residuals of all of them together, in order."""
    if len(residuals) < 2:
        return residuals[0] if residuals else nothing

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        misses, slopes = zip(*(part(pose) for part in residuals), strict=True)
        return np.concatenate(misses), np.concatenate(slopes)

    return residual


def nothing(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return no residuals."""
    return np.empty(0), np.empty((0, len(pose)))


def surface_residual(
    skeleton: Skeleton, surface: Surface, points: FloatArray, kind: Kind, sigma: float
) -> ResidualFunction:
    """Measure how far points (K, 3), m, are off the surface, over `sigma`: m for kind "distance", the field's unit for
    "field".

    Every point belongs to the part of the body that is nearest in the pose asked for (paper D, eq. 5, 6), so that the
    cost is the distance to the nearest part, and a step that is accepted never raises it.
    """
    if not len(points):
        return nothing

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        misses, slopes = nearest_residual_jacobian(skeleton, surface, pose, points, kind)
        misses /= sigma
        slopes *= 1.0 / sigma
        return misses, slopes

    return residual


def keypoint_residual(
    skeleton: Skeleton, camera: Camera, joints: IntArray, marks: FloatArray, sigma_px: float
) -> ResidualFunction:
    """Measure how far joints (K,) are off the pixels where they were marked or detected, marks (K, 3) [u px, v px,
    weight 0..1]; 2 K residuals.

    The standard deviation is sigma_px over the root of the weight. A joint behind the camera counts as 1000 deviations
    away. The derivative leaves the lens' distortion out, the residual does not.
    """
    if not len(marks):
        return nothing
    whitening = np.sqrt(marks[:, 2:]) / sigma_px

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        points = forward(skeleton, pose[None]).positions[0, joints]
        apart = np.nan_to_num((camera.project(points) - marks[:, :2]) * whitening, nan=1e3)
        slopes = projection_jacobian(camera, points) @ joint_jacobian(skeleton, pose[None])[0, joints]
        return apart.ravel(), (slopes * whitening[:, :, None]).reshape(apart.size, -1)

    return residual


def projection_jacobian(camera: Camera, points: FloatArray) -> FloatArray:
    """Differentiate the pixels of world points (n, 3) by the points, (n, 2, 3), px/m, without the lens' distortion."""
    x, y, z = camera.to_camera(points).T
    zero = np.zeros_like(z)
    focal_x, focal_y = camera.matrix[0, 0], camera.matrix[1, 1]
    seen = np.array([[focal_x / z, zero, -focal_x * x / z**2], [zero, focal_y / z, -focal_y * y / z**2]])
    return seen.transpose(2, 0, 1) @ camera.rotation
