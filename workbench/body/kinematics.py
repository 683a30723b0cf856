"""Forward kinematics of batches of poses, and its derivatives."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.body.skeleton import Skeleton
from workbench.utils.arrays import BoolArray, FloatArray
from workbench.utils.kernel_cache import kernel
from workbench.utils.parallel import parallel_for

_MIN_POSES = 256  # minimum poses per thread

_SMALLEST = 1e-6
"""Motion of a joint, m per rad, that is none."""


@dataclass(frozen=True, eq=False)
class JointFrames:
    """World frames of J joints in N poses. rotations: (N, J, 3, 3); positions: (N, J, 3), m."""

    rotations: FloatArray
    positions: FloatArray


def forward(skeleton: Skeleton, poses: FloatArray) -> JointFrames:
    """Return the world frames of every joint in poses (N, P), rad and m, on numba's number of threads: T_world_joint =
    T_world_parent [R, offset] (paper A, section 3)."""
    poses = _as_poses(skeleton, poses)
    size = (len(poses), len(skeleton.names), 3)
    rotations, positions = np.empty((*size, 3)), np.empty(size)
    rows = (skeleton.parents, skeleton.offsets, skeleton.dof_joints, skeleton.dof_axes)

    def run(first: int, last: int) -> None:
        _forward(poses[first:last], *rows, rotations[first:last], positions[first:last])

    parallel_for(run, len(poses), _MIN_POSES)
    return JointFrames(rotations, positions)


def joints(skeleton: Skeleton, poses: FloatArray) -> FloatArray:
    """Return joint positions in the world, (N, J, 3) m, of poses (N, P)."""
    return forward(skeleton, poses).positions


def axis_rotations(axis: FloatArray, angles: FloatArray) -> FloatArray:
    """Return rotations (N, 3, 3) by angles (N,), rad, about one unit axis (3,), by Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return np.eye(3) + s * cross + (1.0 - c) * (cross @ cross)


def joint_jacobian(skeleton: Skeleton, poses: FloatArray) -> FloatArray:
    """Return the derivatives of joint positions with respect to the pose, (N, J, 3, P), m/rad (1 for the translations):
    a rotation about the world axis w through the point o moves a joint x below it by w × (x − o)."""
    poses = _as_poses(skeleton, poses)
    frames = forward(skeleton, poses)
    arms = frames.positions[:, :, None] - frames.positions[:, None, skeleton.dof_joints]  # (N, J, P, 3)
    below = descendants(skeleton)[skeleton.dof_joints].T[..., None]
    jacobian = np.where(below, np.cross(world_axes(skeleton, poses, frames)[:, None], arms), 0.0)
    jacobian[:, :, :3] = skeleton.dof_axes[:3]
    return np.ascontiguousarray(jacobian.swapaxes(-1, -2))


def length_jacobian(skeleton: Skeleton, by_length: FloatArray, poses: FloatArray) -> FloatArray:
    """Return the derivatives (T, J, 3, G) of joints in poses (T, P) with respect to G lengths, which change the offsets
    by by_length (J, 3, G)."""
    frames = forward(skeleton, poses)
    moved = frames.rotations[:, skeleton.parents] @ by_length  # (T, J, 3, G); the root's offsets do not move
    at_or_below = descendants(skeleton) | np.eye(len(skeleton.names), dtype=bool)
    return np.einsum("jk,tjxg->tkxg", at_or_below.astype(np.float64), moved)


def undetermined(skeleton: Skeleton, observed: BoolArray) -> tuple[BoolArray, BoolArray]:
    """Return which joints (J,) of a body and which parameters (P,) of its pose the observed joints (J,) leave free.

    A joint is free if some motion moves it and, to first order in a bent pose, no observed joint. A parameter is free
    if it takes part in such a motion.
    """
    bent = np.linspace(0.3, 0.8, len(skeleton.dof_names))[None].astype(np.float64)
    jacobian = joint_jacobian(skeleton, bent)[0]
    motionless = _null_space(jacobian.reshape(-1, jacobian.shape[-1]))
    free = _null_space(np.concatenate([jacobian[observed].reshape(-1, jacobian.shape[-1]), motionless]))
    moved = np.abs(jacobian @ free.T).max(axis=(1, 2), initial=0.0)
    return moved > _SMALLEST, np.abs(free).max(axis=0, initial=0.0) > _SMALLEST


def _null_space(matrix: FloatArray) -> FloatArray:
    """Return orthonormal rows (k, P) that a matrix (m, P) maps to 0."""
    _, sizes, rows = np.linalg.svd(matrix)
    return rows[(sizes > _SMALLEST).sum() :]


def world_axes(skeleton: Skeleton, poses: FloatArray, frames: JointFrames) -> FloatArray:
    """Return the world direction (N, P, 3) of every degree of freedom's axis in poses (N, P)."""
    axes = np.empty((*poses.shape, 3))
    axes[:, :3] = skeleton.dof_axes[:3]
    rotated: dict[int, FloatArray] = {}  # by joint: rotation by its previous degrees of freedom
    for p in range(3, poses.shape[1]):
        joint = int(skeleton.dof_joints[p])
        parent = skeleton.parents[joint]
        rotation = frames.rotations[:, parent] if parent >= 0 else np.broadcast_to(np.eye(3), (len(poses), 3, 3))
        rotation = rotated.get(joint, rotation)
        axes[:, p] = rotation @ skeleton.dof_axes[p]
        rotated[joint] = rotation @ axis_rotations(skeleton.dof_axes[p], poses[:, p])
    return axes


def descendants(skeleton: Skeleton) -> BoolArray:
    """Return a mask (J, J): [a, b] is true if joint b is below joint a (a itself is not)."""
    below = np.zeros((len(skeleton.names),) * 2, dtype=bool)
    for j, parent in enumerate(skeleton.parents):
        if parent >= 0:
            below[:, j] = below[:, parent]
            below[parent, j] = True
    return below


def _as_poses(skeleton: Skeleton, poses: FloatArray) -> FloatArray:
    poses = np.ascontiguousarray(poses, dtype=np.float64)
    if poses.ndim != 2 or poses.shape[1] != len(skeleton.dof_names):
        raise ValueError(f"poses must be (N, {len(skeleton.dof_names)}), found {poses.shape}")
    return poses


@kernel()
def _forward(
    poses: Any, parents: Any, offsets: Any, dof_joints: Any, dof_axes: Any, rotations: Any, positions: Any
) -> None:
    n_poses, n_dofs = poses.shape
    rotation = np.empty((3, 3))
    for n in range(n_poses):
        p = 3
        for j in range(parents.shape[0]):
            parent = parents[j]
            frame = rotations[n, j]
            if parent < 0:
                for a in range(3):
                    positions[n, j, a] = poses[n, a]
                    for b in range(3):
                        frame[a, b] = 1.0 if a == b else 0.0
            else:
                parent_frame = rotations[n, parent]
                for a in range(3):
                    coordinate = positions[n, parent, a]
                    for b in range(3):
                        coordinate += parent_frame[a, b] * offsets[j, b]
                        frame[a, b] = parent_frame[a, b]
                    positions[n, j, a] = coordinate
            while p < n_dofs and dof_joints[p] == j:
                _axis_rotation(dof_axes[p], poses[n, p], rotation)
                for a in range(3):
                    r0, r1, r2 = frame[a, 0], frame[a, 1], frame[a, 2]
                    for b in range(3):
                        frame[a, b] = r0 * rotation[0, b] + r1 * rotation[1, b] + r2 * rotation[2, b]
                p += 1


@kernel()
def _axis_rotation(axis: Any, angle: float, out: Any) -> None:
    x, y, z = axis[0], axis[1], axis[2]
    s, c = np.sin(angle), np.cos(angle)
    t = 1.0 - c
    out[0, 0], out[0, 1], out[0, 2] = c + t * x * x, t * x * y - s * z, t * x * z + s * y
    out[1, 0], out[1, 1], out[1, 2] = t * x * y + s * z, c + t * y * y, t * y * z - s * x
    out[2, 0], out[2, 1], out[2, 2] = t * x * z - s * y, t * y * z + s * x, c + t * z * z
