"""Points beside the limbs, where the person should have ended."""

from dataclasses import dataclass

import numpy as np

from workbench.body.camera import Camera
from workbench.body.kinematics import JointFrames
from workbench.body.limbs import Limbs
from workbench.likelihoods.dense.kernels import place_beside
from workbench.utils.arrays import FloatArray, IntArray

ALONG = 12
"""Places along a limb, at either side; around a sphere twice as many."""


@dataclass(frozen=True, eq=False)
class Beside:
    """points: (K, 3) in the world, m. joints: (K,) they hang on. pixels: (K, 2)."""

    points: FloatArray
    joints: IntArray
    pixels: FloatArray


def beside(limbs: Limbs, frames: JointFrames, camera: Camera, distances_px: tuple[float, ...]) -> Beside:
    """Place points so many pixels beside the outlines of limbs in the first of some poses, at their axes' depth. A
    limb's section counts as a circle of its mean radius."""
    starts, ends = _axes(limbs, frames)
    points = np.empty((len(starts), 2 * ALONG * len(distances_px), 3))
    place_beside(
        starts, ends, limbs.mean_radii, limbs.spheres, camera.position, float(camera.matrix[0, 0]),
        np.array(distances_px), ALONG, points,
    )  # fmt: skip
    flat = points.reshape(-1, 3)
    return Beside(flat, np.repeat(limbs.joints, points.shape[1]), camera.project(flat))


def _axes(limbs: Limbs, frames: JointFrames) -> tuple[FloatArray, FloatArray]:
    """Where the limbs begin and end, (L, 3) m each."""
    turned, origins = frames.rotations[0][limbs.joints], frames.positions[0][limbs.joints]
    starts, ends = (np.einsum("lij,lj->li", turned, each) + origins for each in (limbs.starts, limbs.ends))
    return starts, ends
