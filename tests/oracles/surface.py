"""The implicit surface in plain NumPy, formula by formula, for `workbench.body.surface`, which states the formulas.

Every point meets every part, so that one function serves attachment, residuals and meshes. A surface has E ellipsoids
in B parts; frames are the joints' in one pose, (1, J, ...); points (K, 3) are in the world, m. Residuals are of kind
"field", dimensionless, or "distance", m.
"""

import numpy as np

from tests.oracles.kinematics import forward
from workbench.body.kinematics import JointFrames, descendants, world_axes
from workbench.body.skeleton import Skeleton
from workbench.body.surface import Kind, Surface
from workbench.utils.arrays import FloatArray, IntArray


def log_fields(surface: Surface, frames: JointFrames, points: FloatArray) -> FloatArray:
    """Return log(f / C) of every part, (K, B)."""
    return np.stack([_log_field(surface, frames, part, points) for part in range(len(surface.part_names))], axis=1)


def _log_field(surface: Surface, frames: JointFrames, part: int, points: FloatArray) -> FloatArray:
    """Return log(f / C), (K,), of one part at points (K, 3), m, in one pose."""
    return np.logaddexp.reduce([_exponent(surface, frames, i, points) for i in _members(surface, part)])


def distances(surface: Surface, frames: JointFrames, points: FloatArray) -> FloatArray:
    """Return the pseudo-distances (K, B), m, to every part, positive outside."""
    fields = log_fields(surface, frames, points)
    part_distances = np.empty_like(fields)
    for part in range(len(surface.part_names)):
        members = _members(surface, part)
        log_weights = np.stack([_exponent(surface, frames, i, points) - fields[:, part] for i in members])
        scales = np.stack([_scale(surface, i, _local(surface, frames, i, points))[0] for i in members])
        part_distances[:, part] = _steps(surface, fields[:, part]) * np.sum(np.exp(log_weights) * scales, axis=0)
    return part_distances


def attach(surface: Surface, frames: JointFrames, points: FloatArray, kind: Kind = "distance") -> IntArray:
    """Return the part, (K,), 0 to B − 1, with the smallest |distance| or |log(f / C)| of each point."""
    values = distances(surface, frames, points) if kind == "distance" else log_fields(surface, frames, points)
    return np.abs(values).argmin(axis=1)


def residuals(
    skeleton: Skeleton, surface: Surface, pose: FloatArray, points: FloatArray, kind: Kind, attachment: IntArray
) -> FloatArray:
    """Return the residuals (K,) in a pose (P,), m and rad, of points attached to parts (K,)."""
    frames = forward(skeleton, pose[None])
    if kind == "distance":
        values = distances(surface, frames, points)
    else:
        values = surface.level * np.expm1(log_fields(surface, frames, points))
    return values[np.arange(len(points)), attachment]


def residual_jacobian(
    skeleton: Skeleton, surface: Surface, pose: FloatArray, points: FloatArray, kind: Kind, attachment: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return `residuals` and their derivative (K, P), per m and rad, by loops over ellipsoids and parameters."""
    frames = forward(skeleton, pose[None])
    axes, descends = world_axes(skeleton, pose[None], frames)[0], descendants(skeleton)
    jacobian = np.zeros((len(points), len(pose)))
    for part in range(len(surface.part_names)):
        attached = attachment == part
        gradients = _gradients(surface, frames, part, points[attached], kind)
        for i, gradient in zip(_members(surface, part), gradients, strict=True):
            for p, moved in enumerate(skeleton.dof_joints):
                if p < 3:
                    velocity = np.broadcast_to(axes[p], gradient.shape)
                elif moved == surface.joints[i] or descends[moved, surface.joints[i]]:
                    velocity = np.cross(axes[p], points[attached] - frames.positions[0, moved])
                else:
                    continue
                jacobian[attached, p] -= np.sum(velocity * gradient, axis=1)
    return residuals(skeleton, surface, pose, points, kind, attachment), jacobian


def _gradients(surface: Surface, frames: JointFrames, part: int, points: FloatArray, kind: Kind) -> list[FloatArray]:
    """Return each ellipsoid's contribution (K, 3) to the gradient of a part's residual by the point."""
    field = log_fields(surface, frames, points)[:, part]
    members = _members(surface, part)
    weights = [np.exp(_exponent(surface, frames, i, points) - field) for i in members]
    scales = [_scale(surface, i, _local(surface, frames, i, points)) for i in members]
    mean_scale = sum(weight * scale for weight, (scale, _) in zip(weights, scales, strict=True))
    steps, slope = _steps(surface, field), _slope(surface, field)
    gradients = []
    for i, weight, (scale, scale_gradient) in zip(members, weights, scales, strict=True):
        local = _local(surface, frames, i, points)
        by_exponent = -2.0 * surface.sharpness * local / surface.half_sizes[i] ** 2
        if kind == "field":
            inner = (surface.level * np.exp(field) * weight)[:, None] * by_exponent
        else:
            inner = (weight * (slope * mean_scale + steps * (scale - mean_scale)))[:, None] * by_exponent
            inner = inner + (weight * steps)[:, None] * scale_gradient
        gradients.append(inner @ (frames.rotations[0, surface.joints[i]] @ surface.axes[i]).T)
    return gradients


def _members(surface: Surface, part: int) -> range:
    """Return the ellipsoids of a part."""
    return range(surface.bounds[part], surface.bounds[part + 1])


def _local(surface: Surface, frames: JointFrames, i: int, points: FloatArray) -> FloatArray:
    """Return points (K, 3), m, in the axes of ellipsoid i, from its centre."""
    rotation, position = frames.rotations[0, surface.joints[i]], frames.positions[0, surface.joints[i]]
    return ((points - position) @ rotation - surface.centers[i]) @ surface.axes[i]


def _exponent(surface: Surface, frames: JointFrames, i: int, points: FloatArray) -> FloatArray:
    """Return log(f_i / C) = a (1 − d_i), (K,), of ellipsoid i at points (K, 3), m."""
    d = np.sum((_local(surface, frames, i, points) / surface.half_sizes[i]) ** 2, axis=1)
    return np.asarray(surface.sharpness * (1.0 - d))


def _steps(surface: Surface, field: FloatArray) -> FloatArray:
    """Return by how much a part's normalised radius exceeds 1, (K,), from log(f / C), (K,)."""
    radius = np.sqrt(1.0 - np.minimum(field, 0.0) / surface.sharpness)
    return np.where(field > 0.0, -0.5 * field / surface.sharpness, radius - 1.0)


def _slope(surface: Surface, field: FloatArray) -> FloatArray:
    """Return the derivative (K,) of `_steps` by log(f / C), (K,), outside the part."""
    return np.asarray(-0.5 / (surface.sharpness * np.sqrt(1.0 - np.minimum(field, 0.0) / surface.sharpness)))


def _scale(surface: Surface, i: int, local: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the metres per unit of the normalised radius of ellipsoid i, (K,), and their gradient (K, 3) by the point.

    local : points (K, 3) in the ellipsoid's axes, m from its centre.
    """
    half = surface.half_sizes[i]
    d, d_slope = np.sum((local / half) ** 2, axis=1), 2.0 * local / half**2
    n, n_slope = np.sum((local / half**2) ** 2, axis=1), 2.0 * local / half**4
    m = np.sum(local**2, axis=1)

    inside = np.maximum(0.0, 1.0 - d)  # near² = numerator / denominator
    numerator, denominator = d + inside**2, n + (inside / half.min()) ** 2
    near = np.sqrt(numerator / denominator)
    numerator_slope = (1.0 - 2.0 * inside)[:, None] * d_slope
    denominator_slope = n_slope - (2.0 * inside / half.min() ** 2)[:, None] * d_slope
    near_slope = (numerator_slope - (near**2)[:, None] * denominator_slope) / (2.0 * near * denominator)[:, None]

    radius = np.sqrt(np.maximum(d, 1.0))  # used only outside
    far = np.sqrt(m) / radius
    weight = (1.0 - 1.0 / radius) ** 2
    outside = np.where(d > 1.0, d, np.inf)[:, None]
    far_slope = far[:, None] * (local / np.where(m > 0.0, m, 1.0)[:, None] - 0.5 * d_slope / outside)
    weight_slope = ((1.0 - 1.0 / radius) / radius**3)[:, None] * d_slope
    slope = near_slope + weight[:, None] * (far_slope - near_slope) + (far - near)[:, None] * weight_slope
    return near + weight * (far - near), slope
