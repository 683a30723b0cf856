"""Uniform samples of a body's surface, and their visibility in a camera."""

import numpy as np

from workbench.body.kinematics import forward
from workbench.body.limbs import Body
from workbench.cameras.camera import Camera
from workbench.datasets.rendering.render import Rays, cast
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

_CANDIDATES_PER_POINT = 24
"""Candidates for each requested point: less than half of a surface is visible, and limbs' ends lie in other limbs."""
_SAME_M = 1e-3
_SIDE, _END = 0, 2


def visible_points(body: Body, pose: FloatArray, camera: Camera, n: int, rng: np.random.Generator) -> FloatArray:
    """Draw n points (n, 3), m, in the world, uniform by area on the visible rendered surface of a body in a pose (P,).

    Of a body that is invisible or hardly visible there are none or fewer than n.
    """
    points = surface_points(body, pose, _CANDIDATES_PER_POINT * n, rng)
    depth = camera.to_camera(points)[:, 2]
    visible = np.abs(first_depth(body, pose, camera, points) - depth) < _SAME_M
    return points[visible & inside(camera, points)][:n]


def surface_points(body: Body, pose: FloatArray, n_candidates: int, rng: np.random.Generator) -> FloatArray:
    """Draw points (K, 3), m, in the world, uniform by area on all limbs in a pose (P,), about half of the candidates.

    They lie on the limbs' sides and on an ellipsoid at each end, as in `render`, also inside other limbs.
    """
    areas = _approximate_areas(body)
    piece = rng.choice(areas.size, n_candidates, p=(areas / areas.sum()).ravel())
    limb, kind = np.divmod(piece, 3)
    local, jacobian = _on_pieces(body, limb, kind, rng)
    density_ratio = jacobian / areas[limb, kind]
    accepted = rng.uniform(size=n_candidates) * density_ratio.max() < density_ratio
    limbs, limb, frames = body.limbs, limb[accepted], forward(body.skeleton, pose[None])
    joint, in_limb = limbs.joints[limb], np.einsum("kij,kj->ki", limbs.axes[limb], local[accepted])
    in_joint = limbs.starts[limb] + in_limb
    return np.einsum("kij,kj->ki", frames.rotations[0, joint], in_joint) + frames.positions[0, joint]


def _approximate_areas(body: Body) -> FloatArray:
    """Return approximate areas (L, 3), m², of every limb's side, start and end, as of round cones and spheres.

    Areas of missing pieces are 0, such as the ends between consecutive segments of a `subject`'s limb.
    """
    limbs = body.limbs
    radii = limbs.radii.mean(axis=2)
    length = np.linalg.norm(limbs.ends - limbs.starts, axis=1)
    start, end = 4.0 * radii.T**2
    continues = (limbs.joints[:-1] == limbs.joints[1:]) & (limbs.ends[:-1] == limbs.starts[1:]).all(axis=1)
    start[1:][continues], end[:-1][continues] = 0.0, 0.0
    return np.pi * np.column_stack([radii.sum(axis=1) * length, start, np.where(length > 0.0, end, 0.0)])


def _on_pieces(body: Body, limb: IntArray, kind: IntArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Draw a point (K, 3), m, on every piece, in its limb's own frame, and return the area element of the map (K,).

    The map takes uniform heights from 0 to 1 and uniform angles to the surface; on a sphere, equal heights on the axis
    have equal areas (Archimedes).
    """
    n = len(limb)
    height, angle = rng.uniform(size=n), rng.uniform(0.0, 2.0 * np.pi, n)
    c, s = np.cos(angle), np.sin(angle)
    length = np.linalg.norm(body.limbs.ends - body.limbs.starts, axis=1)[limb]
    start, end = body.limbs.radii[limb, 0], body.limbs.radii[limb, 1]

    (rx, ry), (gx, gy) = (start + height[:, None] * (end - start)).T, (end - start).T
    side = np.stack([rx * c, ry * s, height * length], axis=1)
    around, along = np.stack([-rx * s, ry * c, np.zeros(n)], axis=1), np.stack([gx * c, gy * s, length], axis=1)
    side_jacobian = np.linalg.norm(np.cross(around, along), axis=1)

    at_end, level = (kind == _END)[:, None], 2.0 * height - 1.0
    semi = np.where(at_end, end, start)
    semi = np.column_stack([semi, semi.min(axis=1)])
    ring = np.sqrt(1.0 - level**2)
    unit = np.stack([ring * c, ring * s, level], axis=1)
    cap = unit * semi + np.where(at_end, length[:, None] * [0.0, 0.0, 1.0], 0.0)
    cap_jacobian = 2.0 * semi.prod(axis=1) * np.linalg.norm(unit / semi, axis=1)

    on_side = kind == _SIDE
    return np.where(on_side[:, None], side, cap), np.where(on_side, side_jacobian, cap_jacobian)


def first_depth(body: Body, pose: FloatArray, camera: Camera, points: FloatArray) -> FloatArray:
    """Return the depth (K,), m, of the first intersection of rays to points (K, 3) with a body in a pose (P,); inf for
    none."""
    in_camera = camera.to_camera(points)
    directions = (in_camera[:, :2] / in_camera[:, 2:])[None].astype(np.float32)
    hits, depth = cast(body, pose, camera, Rays(1, directions)), np.full(len(points), np.inf)
    if hits.depth.size:
        depth[hits.left : hits.left + hits.depth.shape[1]] = hits.depth[0]
    return depth


def inside(camera: Camera, points: FloatArray) -> BoolArray:
    """Return whether points (K, 3) lie in the camera's image (K,)."""
    pixels = camera.project(points)
    with np.errstate(invalid="ignore"):
        is_inside = (pixels >= -0.5) & (pixels < [camera.width - 0.5, camera.height - 0.5])
    return np.asarray(is_inside.all(axis=1))
