"""Forward kinematics in plain NumPy, joint by joint, for `workbench.body.kinematics` and the kernels in lanes."""

import numpy as np

from workbench.body.kinematics import JointFrames, axis_rotations
from workbench.body.skeleton import Skeleton
from workbench.utils.arrays import FloatArray


def forward(skeleton: Skeleton, poses: FloatArray) -> JointFrames:
    """Return the joints' frames in poses (N, P): T_world_joint = T_world_parent [R, offset] (paper A, section 3)."""
    size = (len(poses), len(skeleton.names), 3)
    rotations, positions = np.zeros((*size, 3)), np.zeros(size)
    for j, parent in enumerate(skeleton.parents):
        if parent < 0:
            rotations[:, j], positions[:, j] = np.eye(3), poses[:, :3]
        else:
            rotations[:, j] = rotations[:, parent]
            positions[:, j] = positions[:, parent] + rotations[:, parent] @ skeleton.offsets[j]
        for p in range(3, poses.shape[1]):
            if skeleton.dof_joints[p] == j:
                rotations[:, j] = rotations[:, j] @ axis_rotations(skeleton.dof_axes[p], poses[:, p])
    return JointFrames(rotations, positions)
