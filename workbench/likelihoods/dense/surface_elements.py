"""Elements of the limbs' surfaces and points beside their contours: where a pose has them, which of them a camera
sees."""

from dataclasses import dataclass

import numpy as np

from workbench.body.camera import Camera
from workbench.body.kinematics import JointFrames, descendants
from workbench.body.limbs import Limbs
from workbench.body.skeleton import Skeleton
from workbench.likelihoods.dense.kernels import MARGIN_PX, place, place_beside, see, turn_axes
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

ALONG, AROUND = 12, 24
"""Cells of a limb, along it and once around it; a sphere has half as many in all."""


@dataclass(frozen=True, eq=False)
class Cells:
    """S cells. points, normals: (S, 3) in their joints' frames, m. limbs, joints: (S,)."""

    points: FloatArray
    normals: FloatArray
    limbs: IntArray
    joints: IntArray


@dataclass(frozen=True, eq=False)
class Placed:
    """Cells in one pose before one camera. points: (S, 3) in the world, m. facing: (S,) cosine of the angle between
    normal and line of sight. depth: (S,) m. pixels: (S, 2)."""

    points: FloatArray
    facing: FloatArray
    depth: FloatArray
    pixels: FloatArray


def surface_cells(limbs: Limbs) -> Cells:
    """Cover every limb with cells: a cone's evenly along it and around it, a sphere's on a spiral."""
    parts = [_sphere(limbs, k) if limbs.spheres[k] else _cone(limbs, k) for k in range(len(limbs))]
    points, normals = (np.concatenate(side) for side in zip(*parts, strict=True))
    of = np.repeat(np.arange(len(limbs)), [len(part[0]) for part in parts])
    return Cells(points, normals, of, limbs.joints[of])


def _cone(limbs: Limbs, k: int) -> tuple[FloatArray, FloatArray]:
    u, angle = np.meshgrid(
        (np.arange(ALONG) + 0.5) / ALONG, 2.0 * np.pi * (np.arange(AROUND) + 0.5) / AROUND, indexing="ij"
    )
    u, angle = u.reshape(-1, 1), angle.reshape(-1, 1)
    radii = limbs.radii[k, 0] + (limbs.radii[k, 1] - limbs.radii[k, 0]) * u
    circle = np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
    across = limbs.axes[k][:, :2]
    outwards = circle / radii
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    return limbs.starts[k] + (limbs.ends[k] - limbs.starts[k]) * u + (circle * radii) @ across.T, outwards @ across.T


def _sphere(limbs: Limbs, k: int) -> tuple[FloatArray, FloatArray]:
    n = ALONG * AROUND // 2
    i = np.arange(n) + 0.5
    height, turn = 1.0 - 2.0 * i / n, np.pi * (1.0 + np.sqrt(5.0)) * i
    flat = np.sqrt(1.0 - height**2)
    normals = np.column_stack([np.cos(turn) * flat, np.sin(turn) * flat, height])
    return limbs.starts[k] + limbs.radii[k, 0, 0] * normals, normals


def placed(cells: Cells, frames: JointFrames, camera: Camera) -> Placed:
    """Place cells in the first of some poses, given by its joints' frames."""
    size = len(cells.joints)
    found = Placed(np.empty((size, 3)), np.empty(size), np.empty(size), np.empty((size, 2)))
    place(
        cells.points, cells.normals, cells.joints, frames.rotations[0], frames.positions[0], camera.position,
        camera.row, found.points, found.facing, found.depth, found.pixels,
    )  # fmt: skip
    return found


def inside(pixels: FloatArray, shape: tuple[int, int]) -> BoolArray:
    """Return which (K,) of pixels (K, 2) lie in an image of this shape, MARGIN_PX from its edges."""
    x, y = pixels.T
    with np.errstate(invalid="ignore"):
        found = (x > MARGIN_PX) & (y > MARGIN_PX) & (x < shape[1] - 1 - MARGIN_PX) & (y < shape[0] - 1 - MARGIN_PX)
    return np.asarray(found)


def visible(cells: Placed, shape: tuple[int, int], least_facing: float) -> IntArray:
    """List the cells in the image that face the camera, by more than `least_facing`, and that no other limb hides.

    Deviation from ray casting: the nearest depth is looked for in squares of COARSE_PX and their neighbours, and what
    is less than THICK_M behind it counts as seen.
    """
    return np.asarray(see(cells.pixels, cells.depth, cells.facing, shape[0], shape[1], least_facing))


@dataclass(frozen=True, eq=False)
class PointMotion:
    """How points of the body move with one pose of P numbers: a turn about the axis a through o moves x by a × (x − o).
    axes, moments: (P, 3), a and a × o of every turn. moves: (J, P), 1 where a number moves what hangs on a joint."""

    axes: FloatArray
    moments: FloatArray
    moves: FloatArray


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """a × b of (K, 3), faster than NumPy's."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.column_stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def moved_by(skeleton: Skeleton) -> FloatArray:
    """Return which numbers of the pose move what hangs on each joint, (J, P), 1 or 0."""
    joint = skeleton.dof_joints
    return (np.eye(len(skeleton.names), dtype=np.bool_) | descendants(skeleton))[joint].T.astype(np.float64)


def motion_of(skeleton: Skeleton, moves: FloatArray, pose: FloatArray, frames: JointFrames) -> PointMotion:
    """Return how points move with a pose (P,), whose joints' frames are given."""
    axes = np.empty((len(pose), 3))
    turn_axes(pose, skeleton.parents, skeleton.dof_joints, skeleton.dof_axes, frames.rotations[0], axes)
    return PointMotion(axes, _cross(axes, frames.positions[0][skeleton.dof_joints]), moves)


PLACES = 12
"""Places along a limb, at either side; around a sphere twice as many."""


def beside(
    limbs: Limbs, frames: JointFrames, camera: Camera, distances_px: tuple[float, ...]
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Place points (K, 3), m, so many pixels beside the outlines of limbs in the first of some poses, at their axes'
    depth; return them, the joints (K,) they hang on and their pixels (K, 2). A limb's section counts as a circle of its
    mean radius."""
    starts, ends = _axes(limbs, frames)
    points = np.empty((len(starts), 2 * PLACES * len(distances_px), 3))
    place_beside(
        starts, ends, limbs.mean_radii, limbs.spheres, camera.position, float(camera.matrix[0, 0]),
        np.array(distances_px), PLACES, points,
    )  # fmt: skip
    flat = points.reshape(-1, 3)
    return flat, np.repeat(limbs.joints, points.shape[1]), camera.project(flat)


def _axes(limbs: Limbs, frames: JointFrames) -> tuple[FloatArray, FloatArray]:
    """Where the limbs begin and end, (L, 3) m each."""
    turned, origins = frames.rotations[0][limbs.joints], frames.positions[0][limbs.joints]
    starts, ends = (np.einsum("lij,lj->li", turned, each) + origins for each in (limbs.starts, limbs.ends))
    return starts, ends
