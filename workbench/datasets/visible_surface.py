"""Points on the surface of a body, drawn evenly over it, and which of them a camera sees."""

import numpy as np

from workbench.arrays import BoolArray, FloatArray, IntArray
from workbench.body.camera import Camera
from workbench.body.kinematics import forward
from workbench.body.limbs import Body
from workbench.datasets.render import Rays, cast

CANDIDATES = 12
"""Points tried for every one asked for: a camera sees less than half of a surface, and ends of limbs lie in others."""
_HIDDEN_M = 1e-3
_SIDE, _START, _END = range(3)


def visible_points(body: Body, pose: FloatArray, camera: Camera, n: int, rng: np.random.Generator) -> FloatArray:
    """n points (n, 3), m, in the world, drawn evenly by area over what the camera sees of a body in a pose (P,).

    The surface is the renderer's: cones and spheres with rounded ends. There are none of a body the camera does not
    see, and fewer than n of one it sees very little of.
    """
    points, areas = surface_points(body, pose, CANDIDATES * n, rng)
    depth = camera.to_camera(points)[:, 2]
    seen = first_depth(body, pose, camera, points) > depth - _HIDDEN_M
    seen &= inside(camera, points) & (areas > 0.0)
    points, areas = points[seen], areas[seen]
    if not len(points):
        return points
    return points[rng.choice(len(points), min(n, len(points)), replace=False, p=areas / areas.sum())]


def surface_points(body: Body, pose: FloatArray, n: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """n points (n, 3), m, of all limbs in a pose (P,), in the world, and the area (n,), up to one factor, of each.

    A limb is a side and two half ellipsoids, also where those lie inside another limb (see `render`).
    """
    limb, piece = rng.integers(len(body.limbs), size=n), rng.integers(3, size=n)
    height, angle = rng.uniform(size=n), rng.uniform(0.0, 2.0 * np.pi, n)
    c, s = np.cos(angle), np.sin(angle)
    axes = body.limbs.ends - body.limbs.starts
    length = np.linalg.norm(axes, axis=1)[limb]
    (ax, ay), (bx, by) = body.limbs.radii[limb, 0].T, body.limbs.radii[limb, 1].T

    rx, ry = ax + height * (bx - ax), ay + height * (by - ay)
    side = np.stack([rx * c, ry * s, height * length], axis=1)
    along = np.stack([(bx - ax) * c, (by - ay) * s, length], axis=1)
    side_area = np.linalg.norm(np.cross(np.stack([-rx * s, ry * c, np.zeros(n)], axis=1), along), axis=1)

    # heights that are even on the axis are even on a sphere (Archimedes)
    sign, at_end = np.where(piece == _START, -1.0, 1.0), piece == _END
    semi = np.where(
        at_end[:, None], np.stack([bx, by, np.minimum(bx, by)], 1), np.stack([ax, ay, np.minimum(ax, ay)], 1)
    )
    ring = np.sqrt(1.0 - height**2)
    unit = np.stack([ring * c, ring * s, sign * height], axis=1)
    cap = unit * semi + np.where(at_end, length, 0.0)[:, None] * [0.0, 0.0, 1.0]
    cap_area = semi.prod(axis=1) * np.linalg.norm(unit / semi, axis=1)

    on_side = piece == _SIDE
    own = np.where(on_side[:, None], side, cap)
    return _placed(body, pose, limb, own), np.where(on_side, side_area, cap_area)


def first_depth(body: Body, pose: FloatArray, camera: Camera, points: FloatArray) -> FloatArray:
    """The depth (K,), m, where lines of sight to points (K, 3) first meet a body in a pose (P,), inf for nowhere."""
    seen = camera.to_camera(points)
    x, y = (seen[:, :2] / seen[:, 2:]).T
    directions = np.stack([x, y], axis=1)[None].astype(np.float32)
    rays = Rays(
        samples=1,
        directions=directions,
        across=np.stack([directions[0, :, 0]] * 2),
        down=np.array([[directions[..., 1].min()], [directions[..., 1].max()]]),
    )
    hits = cast(body, pose, camera, rays)
    depth = np.full(len(points), np.inf)
    if hits.depth.size:
        depth[hits.left : hits.left + hits.depth.shape[1]] = hits.depth[0]
    return depth


def inside(camera: Camera, points: FloatArray) -> BoolArray:
    """Which of points (K, 3) lie in the camera's image (K,)."""
    pixels = camera.project(points)
    with np.errstate(invalid="ignore"):
        found = (pixels >= -0.5) & (pixels < [camera.width - 0.5, camera.height - 0.5])
    return np.asarray(found.all(axis=1))


def _placed(body: Body, pose: FloatArray, limb: IntArray, own: FloatArray) -> FloatArray:
    """Points (K, 3) of limbs (K,), each in its limb's own frame, in the world.

    A limb's own frame starts at its axis' start, with z along the axis and x as near to its joint's x as can be.
    """
    limbs, frames = body.limbs, forward(body.skeleton, pose[None])
    axes = limbs.ends - limbs.starts
    z = np.where(limbs.spheres[:, None], [0.0, 0.0, 1.0], axes)
    z = z / np.linalg.norm(z, axis=1, keepdims=True)
    x = np.array([1.0, 0.0, 0.0]) - z[:, :1] * z
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    basis = np.stack([x, np.cross(z, x), z], axis=2)[limb]
    in_joint = limbs.starts[limb] + np.einsum("kij,kj->ki", basis, own)
    joint = limbs.joints[limb]
    points: FloatArray = np.einsum("kij,kj->ki", frames.rotations[0, joint], in_joint) + frames.positions[0, joint]
    return points
