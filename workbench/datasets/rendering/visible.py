"""Points on the surface of a body, drawn evenly over it, and which of them a camera sees."""

import numpy as np

from workbench.body.camera import Camera
from workbench.body.kinematics import forward
from workbench.body.limbs import Body
from workbench.datasets.rendering.render import Rays, cast
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

_TRIES = 24
"""Places tried for each point asked for: a camera sees less than half of a surface, and limbs' ends lie in others."""
_SAME_M = 1e-3
_SIDE, _END = 0, 2


def visible_points(body: Body, pose: FloatArray, camera: Camera, n: int, rng: np.random.Generator) -> FloatArray:
    """Draw n points (n, 3), m, in the world, evenly by area over what the camera sees of a body's rendered surface in a
    pose (P,); none of a body it does not see, and fewer than n of one it sees very little of."""
    points = surface_points(body, pose, _TRIES * n, rng)
    depth = camera.to_camera(points)[:, 2]
    seen = np.abs(first_depth(body, pose, camera, points) - depth) < _SAME_M
    return points[seen & inside(camera, points)][:n]


def surface_points(body: Body, pose: FloatArray, tries: int, rng: np.random.Generator) -> FloatArray:
    """Draw points (K, 3), m, in the world, evenly by area over all limbs in a pose (P,), about half of the tries: over
    their sides and an ellipsoid about each end, as in `render`, also where these lie in others."""
    share = _rough_areas(body)
    piece = rng.choice(share.size, tries, p=(share / share.sum()).ravel())
    limb, kind = np.divmod(piece, 3)
    own, stretch = _on_pieces(body, limb, kind, rng)
    dense = stretch / share[limb, kind]
    kept = rng.uniform(size=tries) * dense.max() < dense
    limbs, limb, frames = body.limbs, limb[kept], forward(body.skeleton, pose[None])
    in_joint, joint = limbs.starts[limb] + np.einsum("kij,kj->ki", limbs.axes[limb], own[kept]), limbs.joints[limb]
    return np.einsum("kij,kj->ki", frames.rotations[0, joint], in_joint) + frames.positions[0, joint]


def _rough_areas(body: Body) -> FloatArray:
    """About the areas (L, 3), m², of every limb's side, start and end: of round cones and spheres; 0: there is none.

    Where a limb goes on in the next, as those of a `subject` do, there is no end.
    """
    limbs = body.limbs
    radii = limbs.radii.mean(axis=2)
    length = np.linalg.norm(limbs.ends - limbs.starts, axis=1)
    start, end = 4.0 * radii.T**2
    goes_on = (limbs.joints[:-1] == limbs.joints[1:]) & (limbs.ends[:-1] == limbs.starts[1:]).all(axis=1)
    start[1:][goes_on], end[:-1][goes_on] = 0.0, 0.0
    return np.pi * np.column_stack([radii.sum(axis=1) * length, start, np.where(length > 0.0, end, 0.0)])


def _on_pieces(body: Body, limb: IntArray, kind: IntArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """A place (K, 3), m, on every piece, in its limb's own frame, and how far its map stretches area there (K,). The
    map takes heights from 0 to 1 and angles, both drawn evenly, to the surface; equal heights on the axis of a sphere
    are equal areas (Archimedes)."""
    n = len(limb)
    height, angle = rng.uniform(size=n), rng.uniform(0.0, 2.0 * np.pi, n)
    c, s = np.cos(angle), np.sin(angle)
    length = np.linalg.norm(body.limbs.ends - body.limbs.starts, axis=1)[limb]
    start, end = body.limbs.radii[limb, 0], body.limbs.radii[limb, 1]

    (rx, ry), (gx, gy) = (start + height[:, None] * (end - start)).T, (end - start).T
    side = np.stack([rx * c, ry * s, height * length], axis=1)
    around, along = np.stack([-rx * s, ry * c, np.zeros(n)], axis=1), np.stack([gx * c, gy * s, length], axis=1)
    side_stretch = np.linalg.norm(np.cross(around, along), axis=1)

    at_end, level = (kind == _END)[:, None], 2.0 * height - 1.0
    semi = np.where(at_end, end, start)
    semi = np.column_stack([semi, semi.min(axis=1)])
    ring = np.sqrt(1.0 - level**2)
    unit = np.stack([ring * c, ring * s, level], axis=1)
    cap = unit * semi + np.where(at_end, length[:, None] * [0.0, 0.0, 1.0], 0.0)
    cap_stretch = 2.0 * semi.prod(axis=1) * np.linalg.norm(unit / semi, axis=1)

    on_side = kind == _SIDE
    return np.where(on_side[:, None], side, cap), np.where(on_side, side_stretch, cap_stretch)


def first_depth(body: Body, pose: FloatArray, camera: Camera, points: FloatArray) -> FloatArray:
    """The depth (K,), m, where lines of sight to points (K, 3) first meet a body in a pose (P,), inf for nowhere."""
    seen = camera.to_camera(points)
    directions = (seen[:, :2] / seen[:, 2:])[None].astype(np.float32)
    hits, depth = cast(body, pose, camera, Rays(1, directions)), np.full(len(points), np.inf)
    if hits.depth.size:
        depth[hits.left : hits.left + hits.depth.shape[1]] = hits.depth[0]
    return depth


def inside(camera: Camera, points: FloatArray) -> BoolArray:
    """Return whether points (K, 3) lie in the camera's image (K,)."""
    pixels = camera.project(points)
    with np.errstate(invalid="ignore"):
        found = (pixels >= -0.5) & (pixels < [camera.width - 0.5, camera.height - 0.5])
    return np.asarray(found.all(axis=1))
