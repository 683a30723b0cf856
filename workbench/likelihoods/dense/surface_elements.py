"""Surface elements of the limbs and points next to their contours: their projections and visibility."""

from dataclasses import dataclass

import numpy as np

from workbench.body.kinematics import JointFrames, descendants
from workbench.body.limbs import Limbs
from workbench.body.skeleton import Skeleton
from workbench.cameras.camera import Camera
from workbench.likelihoods.dense.kernels import (
    MARGIN_PX,
    place_contour_samples,
    project,
    rotation_axes,
    visible_elements_kernel,
)
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

ALONG, AROUND = 12, 24
"""Elements along a limb and around it; a sphere has half as many in all."""


@dataclass(frozen=True, eq=False)
class SurfaceElements:
    """S surface elements. points, normals: (S, 3) in their joints' frames, m. limbs, joints: (S,)."""

    points: FloatArray
    normals: FloatArray
    limbs: IntArray
    joints: IntArray


@dataclass(frozen=True, eq=False)
class ProjectedElements:
    """Surface elements in one pose and camera. points: (S, 3) in the world, m. facing: (S,) cosine of the angle between
    normal and line of sight. depth: (S,) m. pixels: (S, 2)."""

    points: FloatArray
    facing: FloatArray
    depth: FloatArray
    pixels: FloatArray


def surface_elements(limbs: Limbs) -> SurfaceElements:
    """Return the surface elements of every limb, evenly spaced along and around a cone, on a spiral on a sphere."""
    parts = [_sphere(limbs, k) if limbs.spheres[k] else _cone(limbs, k) for k in range(len(limbs))]
    points, normals = (np.concatenate(part) for part in zip(*parts, strict=True))
    limb_indices = np.repeat(np.arange(len(limbs)), [len(part[0]) for part in parts])
    return SurfaceElements(points, normals, limb_indices, limbs.joints[limb_indices])


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
    height, angle = 1.0 - 2.0 * i / n, np.pi * (1.0 + np.sqrt(5.0)) * i
    radius = np.sqrt(1.0 - height**2)
    normals = np.column_stack([np.cos(angle) * radius, np.sin(angle) * radius, height])
    return limbs.starts[k] + limbs.radii[k, 0, 0] * normals, normals


def project_elements(elements: SurfaceElements, frames: JointFrames, camera: Camera) -> ProjectedElements:
    """Project elements in the first of some poses, given by its joints' frames."""
    size = len(elements.joints)
    projected = ProjectedElements(np.empty((size, 3)), np.empty(size), np.empty(size), np.empty((size, 2)))
    project(
        elements.points, elements.normals, elements.joints, frames.rotations[0], frames.positions[0], camera.position,
        camera.row, projected.points, projected.facing, projected.depth, projected.pixels,
    )  # fmt: skip
    return projected


def inside(pixels: FloatArray, shape: tuple[int, int]) -> BoolArray:
    """Return which (K,) of pixels (K, 2) are in an image of this shape, at least MARGIN_PX from its edges."""
    x, y = pixels.T
    with np.errstate(invalid="ignore"):
        within = (x > MARGIN_PX) & (y > MARGIN_PX) & (x < shape[1] - 1 - MARGIN_PX) & (y < shape[0] - 1 - MARGIN_PX)
    return np.asarray(within)


def visible_elements(elements: ProjectedElements, shape: tuple[int, int], min_facing_cosine: float) -> IntArray:
    """Return the elements in the image that face the camera, by more than `min_facing_cosine`, and that no other limb
    hides. Deviation from ray casting: the nearest depth is that in a square of COARSE_PX and its neighbours, and
    elements less than THICK_M behind it are visible."""
    arrays = elements.pixels, elements.depth, elements.facing
    return np.asarray(visible_elements_kernel(*arrays, shape[0], shape[1], min_facing_cosine))


@dataclass(frozen=True, eq=False)
class PointMotion:
    """Motion of body points with one pose of P numbers: a rotation about the axis a through o moves x by a × (x − o).
    axes, moments: (P, 3), a and a × o of every rotation. dof_mask: (J, P), 1 where a number moves the points on a
    joint."""

    axes: FloatArray
    moments: FloatArray
    dof_mask: FloatArray


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a × b of (K, 3), faster than NumPy's."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.column_stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def dof_mask(skeleton: Skeleton) -> FloatArray:
    """Return 1 where a number of the pose moves the points on a joint, else 0, (J, P)."""
    joint = skeleton.dof_joints
    return (np.eye(len(skeleton.names), dtype=np.bool_) | descendants(skeleton))[joint].T.astype(np.float64)


def point_motion(skeleton: Skeleton, dof_mask: FloatArray, pose: FloatArray, frames: JointFrames) -> PointMotion:
    """Return the motion of points with a pose (P,), given its joints' frames."""
    axes = np.empty((len(pose), 3))
    rotation_axes(pose, skeleton.parents, skeleton.dof_joints, skeleton.dof_axes, frames.rotations[0], axes)
    return PointMotion(axes, _cross(axes, frames.positions[0][skeleton.dof_joints]), dof_mask)


N_CONTOUR_POINTS = 12
"""Points along a limb, on each side; around a sphere twice as many."""


def contour_samples(
    limbs: Limbs, frames: JointFrames, camera: Camera, distances_px: tuple[float, ...]
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return points (K, 3), m, just outside the contours of limbs in the first of some poses, their joints (K,) and
    pixels (K, 2).

    The points have the depth of the limbs' axes. A limb's section is taken as a circle of its mean radius.

    Parameters
    ----------
    limbs, frames, camera : the limbs, the poses' joints' frames and the camera.
    distances_px : from the contours.
    """
    starts, ends = _axes(limbs, frames)
    points = np.empty((len(starts), 2 * N_CONTOUR_POINTS * len(distances_px), 3))
    place_contour_samples(
        starts, ends, limbs.mean_radii, limbs.spheres, camera.position, float(camera.matrix[0, 0]),
        np.array(distances_px), N_CONTOUR_POINTS, points,
    )  # fmt: skip
    flattened = points.reshape(-1, 3)
    return flattened, np.repeat(limbs.joints, points.shape[1]), camera.project(flattened)


def _axes(limbs: Limbs, frames: JointFrames) -> tuple[FloatArray, FloatArray]:
    """Return the ends of the limbs' axes, (L, 3) m each."""
    rotations, origins = frames.rotations[0][limbs.joints], frames.positions[0][limbs.joints]
    starts, ends = (np.einsum("lij,lj->li", rotations, each) + origins for each in (limbs.starts, limbs.ends))
    return starts, ends
