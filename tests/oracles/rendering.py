"""Ray casting in plain NumPy, every ray against every limb, for `workbench.datasets.rendering.render`."""

import numpy as np

from workbench.body.kinematics import forward
from workbench.body.limbs import Body
from workbench.cameras.camera import Camera
from workbench.datasets.rendering.render import Hits, Rays
from workbench.utils.arrays import FloatArray

EVEN = 1e-9
"""Relative difference between the axis ratios of a limb's ends below which the limb is a quadric."""


def cast(body: Body, pose: FloatArray, camera: Camera, rays: Rays) -> Hits:
    """Find the first limb that each ray (h, w) meets, for all pixels of an image.

    Depths are in m, inf where a ray meets nothing; limbs are −1 there. pose : (P,), m and rad.
    """
    limbs, frames = body.limbs, forward(body.skeleton, pose[None])
    from_joint, origins = frames.rotations[0, limbs.joints], frames.positions[0, limbs.joints]
    to_limb = limbs.axes.transpose(0, 2, 1) @ from_joint.transpose(0, 2, 1)
    starts = origins + np.einsum("lij,lj->li", from_joint, limbs.starts)
    origins_in_limbs = np.einsum("lij,lj->li", to_limb, camera.position - starts)
    sizes = np.column_stack([limbs.lengths, limbs.radii.reshape(-1, 4)])

    directions = np.concatenate([rays.directions, np.ones((*rays.directions.shape[:2], 1))], axis=-1, dtype=np.float64)
    depth = np.full(directions.shape[:2], np.inf)
    limb = np.full(directions.shape[:2], -1)
    with np.errstate(divide="ignore", invalid="ignore"):
        for k, rotation in enumerate(to_limb @ camera.rotation.T):
            s = _depths(origins_in_limbs[k], directions @ rotation.T, sizes[k])
            limb[s < depth] = k
            depth = np.minimum(depth, s)
    return Hits(0, 0, depth, limb)


def _depths(origin: FloatArray, direction: FloatArray, size: FloatArray) -> FloatArray:
    """Return the depths (...), m, where rays meet a limb, inf where they miss.

    origin : the camera's centre in the limb's frame, which starts at its axis' start with z along the axis, m.
    direction : (..., 3), in the limb's frame, of which depth is the multiple. size : (5,), m, length of the axis,
    semi-axes x and y at its start, x and y at its end.
    """
    length, ax, ay, bx, by = size
    depth = np.full(direction.shape[:-1], np.inf)
    for z, rx, ry in ((0.0, ax, ay), (length, bx, by)):  # the caps, halves of ellipsoids
        scale = np.array([rx, ry, min(rx, ry)])
        o, d = (origin - [0.0, 0.0, z]) / scale, direction / scale
        depth = np.minimum(depth, _entry((d * d).sum(-1), (o * d).sum(-1), np.sum(o * o) - 1.0))
    if length == 0.0:
        return depth
    ox, oy, oz = origin
    dx, dy, dz = np.moveaxis(direction, -1, 0)
    gx, gy = (bx - ax) / length, (by - ay) / length
    t = np.clip((oz - dz * (ox * dx + oy * dy) / (dx * dx + dy * dy)) / length, 0.0, 1.0)
    k = ((ax + t * (bx - ax)) / (ay + t * (by - ay))) ** 2
    exact = abs(ax * by - ay * bx) < EVEN * ax * by
    scale_factor = 1.0 if exact else 1.1
    r, g = scale_factor * (ax + gx * oz), scale_factor * gx
    a, b = dx * dx + k * dy * dy - (g * dz) ** 2, ox * dx + k * oy * dy - g * dz * r
    s = _entry(a, b, ox**2 + k * oy**2 - r * r)
    settled = np.full(s.shape, exact)
    for _ in range(0 if exact else 8):  # Newton's method from a quadric enlarged by a tenth
        x, y, t = ox + s * dx, oy + s * dy, np.clip((oz + s * dz) / length, 0.0, 1.0)
        rx, ry = ax + t * (bx - ax), ay + t * (by - ay)
        f = (x / rx) ** 2 + (y / ry) ** 2 - 1.0
        rate = x * (dx - x * gx * dz / rx) / rx**2 + y * (dy - y * gy * dz / ry) / ry**2
        settled = np.abs(f) < 1e-7
        s = np.where(settled, s, np.where(rate < 0.0, s - 0.5 * f / rate, np.inf))
    z = oz + s * dz
    return np.where(settled & (z >= 0.0) & (z <= length), np.minimum(depth, s), depth)


def _entry(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Find where a s² + 2 b s + c falls through zero at s > 0, inf where it does not; c > 0 outside the surface."""
    root = np.sqrt(b * b - a * c)  # NaN where the ray misses
    s = c / (root - b)  # not (−b − root) / a, which fails for rays along the cone's slope
    return np.where(s > 0.0, s, np.inf)
