"""Forearms and calves that point away from a camera where they might point towards it (Sminchisescu & Triggs, Kinematic
Jump Processes for Monocular 3D Human Tracking, CVPR 2003), over whole stretches of a motion."""

from collections.abc import Iterator

import numpy as np

from workbench.arrays import FloatArray, IntArray
from workbench.body.camera import Camera
from workbench.body.kinematics import joints
from workbench.body.skeleton import Skeleton
from workbench.core.residual import Loss, stacked
from workbench.inference.fit.decoding import PoseDecoder
from workbench.inference.fit.frame import fit_frame
from workbench.inference.fit.residuals import joint_residual, limit_residual

LIMBS = tuple(
    (f"{side}_{upper}", f"{side}_{middle}", f"{side}_{lower}")
    for side in ("left", "right")
    for upper, middle, lower in (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle"))
)
LEAST_FRAMES = 3
"""A stretch of fewer is left to the fit, which gets there by itself."""
FLIP_SIGMA_M = 0.03
"""How near the joints of a limb come to where the flip has them, against the body's limits."""
LIMIT_SIGMA_RAD = 0.05


def flips(skeleton: Skeleton, camera: Camera, poses: FloatArray) -> Iterator[FloatArray]:
    """Motions (T, P) that differ from `poses` (T, P) in one limb's lower part, turned over in depth.

    It is turned over in all frames, or in those between two times at which it lies across the view, where nobody can
    tell in which direction it goes on.
    """
    places = joints(skeleton, poses)
    for upper, middle, lower in LIMBS:
        if not {upper, middle, lower} <= set(skeleton.names):
            continue
        limb = np.array([skeleton.joint(upper), skeleton.joint(middle), skeleton.joint(lower)])
        rays = places[:, limb[1]] - camera.position
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        away = ((places[:, limb[2]] - places[:, limb[1]]) * rays).sum(axis=1)
        stretches = np.split(np.arange(len(poses)), np.flatnonzero(np.diff(np.sign(away))) + 1)
        for frames in [np.arange(len(poses))] * (len(stretches) > 1) + stretches:
            if len(frames) >= LEAST_FRAMES:
                aims = places[:, limb[1:]].copy()
                aims[:, 1] -= 2.0 * away[:, None] * rays
                yield _reaching(skeleton, poses, frames, limb, aims)


def _reaching(skeleton: Skeleton, poses: FloatArray, frames: IntArray, limb: IntArray, aims: FloatArray) -> FloatArray:
    """Poses (T, P) whose limb has its middle and end near aims (T, 2, 3) in some frames, as far as its limits allow."""
    reached, decoder = poses.copy(), PoseDecoder(skeleton)
    own = np.flatnonzero(np.isin(skeleton.dof_joints, limb[:2]))
    for t in frames:
        aim = joint_residual(skeleton, limb[1:], aims[t], FLIP_SIGMA_M)
        near = stacked([aim, limit_residual(skeleton, LIMIT_SIGMA_RAD)])
        reached[t] = fit_frame(
            decoder, near, Loss("squared", 1.0), poses[t], free=own, max_iterations=8, tolerance=1e-2
        ).x  # fmt: skip
    return reached
