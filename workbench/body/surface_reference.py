"""The implicit surface in plain NumPy, formula by formula: what the kernels of `surface_kernel` are tested against.

The formulas stand in `surface`. Here every point meets every part, so that one function serves attachment, residuals
and meshes alike.
"""

import numpy as np

from workbench.arrays import FloatArray, IntArray
from workbench.body.kinematics import JointFrames, descendants, forward_reference, world_axes
from workbench.body.skeleton import Skeleton
from workbench.body.surface import Kind, Surface


def log_fields(surface: Surface, frames: JointFrames, points: FloatArray) -> FloatArray:
    """log(f / C) of every part at points (K, 3) in one pose, (K, B)."""
    return np.stack([log_field(surface, frames, part, points) for part in range(len(surface.part_names))], axis=1)


def log_field(surface: Surface, frames: JointFrames, part: int, points: FloatArray) -> FloatArray:
    """log(f / C) of one part at points (K, 3) in one pose, (K,)."""
    return np.logaddexp.reduce([_exponent(surface, frames, i, points) for i in _members(surface, part)])


def distances(surface: Surface, frames: JointFrames, points: FloatArray) -> FloatArray:
    """Pseudo-distances (K, B), m, of points (K, 3) to every part in one pose."""
    fields = log_fields(surface, frames, points)
    found = np.empty_like(fields)
    for part in range(len(surface.part_names)):
        members = _members(surface, part)
        shares = np.stack([_exponent(surface, frames, i, points) - fields[:, part] for i in members])
        scales = np.stack([_scale(surface, i, _local(surface, frames, i, points))[0] for i in members])
        found[:, part] = _steps(surface, fields[:, part]) * np.sum(np.exp(shares) * scales, axis=0)
    return found


def attach(surface: Surface, frames: JointFrames, points: FloatArray, kind: Kind = "distance") -> IntArray:
    """Compute `surface.attach`."""
    away = distances(surface, frames, points) if kind == "distance" else log_fields(surface, frames, points)
    return np.abs(away).argmin(axis=1)


def residuals(
    skeleton: Skeleton, surface: Surface, pose: FloatArray, points: FloatArray, kind: Kind, attachment: IntArray
) -> FloatArray:
    """Compute `surface.residuals`."""
    frames = forward_reference(skeleton, pose[None])
    if kind == "distance":
        every = distances(surface, frames, points)
    else:
        every = surface.level * np.expm1(log_fields(surface, frames, points))
    return every[np.arange(len(points)), attachment]


def residual_jacobian(
    skeleton: Skeleton, surface: Surface, pose: FloatArray, points: FloatArray, kind: Kind, attachment: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Compute `surface.residual_jacobian`, one ellipsoid and one degree of freedom after the other."""
    frames = forward_reference(skeleton, pose[None])
    axes, below = world_axes(skeleton, pose[None], frames)[0], descendants(skeleton)
    jacobian = np.zeros((len(points), len(pose)))
    for part in range(len(surface.part_names)):
        mine = attachment == part
        gradients = _gradients(surface, frames, part, points[mine], kind)
        for i, gradient in zip(_members(surface, part), gradients, strict=True):
            for p, moved in enumerate(skeleton.dof_joints):
                if p < 3:
                    velocity = np.broadcast_to(axes[p], gradient.shape)
                elif moved == surface.joints[i] or below[moved, surface.joints[i]]:
                    velocity = np.cross(axes[p], points[mine] - frames.positions[0, moved])
                else:
                    continue
                jacobian[mine, p] -= np.sum(velocity * gradient, axis=1)
    return residuals(skeleton, surface, pose, points, kind, attachment), jacobian


def _gradients(surface: Surface, frames: JointFrames, part: int, points: FloatArray, kind: Kind) -> list[FloatArray]:
    """Compute what each ellipsoid of a part adds to the gradient (K, 3) of the residual with respect to the point."""
    field = log_fields(surface, frames, points)[:, part]
    members = _members(surface, part)
    shares = [np.exp(_exponent(surface, frames, i, points) - field) for i in members]
    scales = [_scale(surface, i, _local(surface, frames, i, points)) for i in members]
    mean_scale = sum(share * scale for share, (scale, _) in zip(shares, scales, strict=True))
    steps, slope = _steps(surface, field), _slope(surface, field)
    gradients = []
    for i, share, (scale, scale_gradient) in zip(members, shares, scales, strict=True):
        local = _local(surface, frames, i, points)
        by_exponent = -2.0 * surface.sharpness * local / surface.half_sizes[i] ** 2
        if kind == "field":
            inner = (surface.level * np.exp(field) * share)[:, None] * by_exponent
        else:
            inner = (share * (slope * mean_scale + steps * (scale - mean_scale)))[:, None] * by_exponent
            inner = inner + (share * steps)[:, None] * scale_gradient
        gradients.append(inner @ (frames.rotations[0, surface.joints[i]] @ surface.axes[i]).T)
    return gradients


def _members(surface: Surface, part: int) -> range:
    return range(surface.bounds[part], surface.bounds[part + 1])


def _local(surface: Surface, frames: JointFrames, i: int, points: FloatArray) -> FloatArray:
    """Points (K, 3) in the axes of ellipsoid i, m from its centre."""
    rotation, position = frames.rotations[0, surface.joints[i]], frames.positions[0, surface.joints[i]]
    return ((points - position) @ rotation - surface.centers[i]) @ surface.axes[i]


def _exponent(surface: Surface, frames: JointFrames, i: int, points: FloatArray) -> FloatArray:
    """log(f_i / C) = a (1 − d_i), (K,)."""
    d = np.sum((_local(surface, frames, i, points) / surface.half_sizes[i]) ** 2, axis=1)
    return np.asarray(surface.sharpness * (1.0 - d))


def _steps(surface: Surface, field: FloatArray) -> FloatArray:
    """Measure how far a part's normalised radius is above 1; field: (K,) log(f / C)."""
    radius = np.sqrt(1.0 - np.minimum(field, 0.0) / surface.sharpness)
    return np.where(field > 0.0, -0.5 * field / surface.sharpness, radius - 1.0)


def _slope(surface: Surface, field: FloatArray) -> FloatArray:
    return np.asarray(-0.5 / (surface.sharpness * np.sqrt(1.0 - np.minimum(field, 0.0) / surface.sharpness)))


def _scale(surface: Surface, i: int, local: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Metres per unit of the normalised radius of ellipsoid i, (K,), at points (K, 3) in its axes; its gradient."""
    half = surface.half_sizes[i]
    d, d_slope = np.sum((local / half) ** 2, axis=1), 2.0 * local / half**2
    n, n_slope = np.sum((local / half**2) ** 2, axis=1), 2.0 * local / half**4
    m = np.sum(local**2, axis=1)

    inside = np.maximum(0.0, 1.0 - d)  # near² = top / below
    top, below = d + inside**2, n + (inside / half.min()) ** 2
    near = np.sqrt(top / below)
    top_slope = (1.0 - 2.0 * inside)[:, None] * d_slope
    below_slope = n_slope - (2.0 * inside / half.min() ** 2)[:, None] * d_slope
    near_slope = (top_slope - (near**2)[:, None] * below_slope) / (2.0 * near * below)[:, None]

    radius = np.sqrt(np.maximum(d, 1.0))  # of use outside only
    far = np.sqrt(m) / radius
    weight = (1.0 - 1.0 / radius) ** 2
    outside = np.where(d > 1.0, d, np.inf)[:, None]
    far_slope = far[:, None] * (local / np.where(m > 0.0, m, 1.0)[:, None] - 0.5 * d_slope / outside)
    weight_slope = ((1.0 - 1.0 / radius) / radius**3)[:, None] * d_slope
    slope = near_slope + weight[:, None] * (far_slope - near_slope) + (far - near)[:, None] * weight_slope
    return near + weight * (far - near), slope
