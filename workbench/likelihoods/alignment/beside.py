"""Points beside the limbs, where the person should have ended."""

from dataclasses import dataclass

import numpy as np

from workbench.arrays import FloatArray, IntArray
from workbench.body.camera import Camera
from workbench.body.kinematics import JointFrames
from workbench.body.limbs import Limbs
from workbench.likelihoods.alignment.kernels import place_beside

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
    limb's section counts as a circle of its mean radius. See `beside_reference`."""
    starts, ends = _axes(limbs, frames)
    points = np.empty((len(starts), 2 * ALONG * len(distances_px), 3))
    place_beside(
        starts, ends, limbs.mean_radii, limbs.spheres, camera.position, float(camera.matrix[0, 0]),
        np.array(distances_px), ALONG, points,
    )  # fmt: skip
    flat = points.reshape(-1, 3)
    return Beside(flat, np.repeat(limbs.joints, points.shape[1]), camera.project(flat))


def beside_reference(limbs: Limbs, frames: JointFrames, camera: Camera, distances_px: tuple[float, ...]) -> Beside:
    """`beside` in plain NumPy."""
    starts, ends = _axes(limbs, frames)
    edges, outwards = _edges(limbs, starts, ends, camera.position)
    metres_per_px = np.linalg.norm(edges - camera.position, axis=-1, keepdims=True) / camera.matrix[0, 0]
    points = np.concatenate([edges + distance * metres_per_px * outwards for distance in distances_px], axis=1)
    joints = np.repeat(limbs.joints, points.shape[1])
    flat = points.reshape(-1, 3)
    return Beside(flat, joints, camera.project(flat))


def _axes(limbs: Limbs, frames: JointFrames) -> tuple[FloatArray, FloatArray]:
    """Where the limbs begin and end, (L, 3) m each."""
    turned, origins = frames.rotations[0][limbs.joints], frames.positions[0][limbs.joints]
    starts, ends = (np.einsum("lij,lj->li", turned, each) + origins for each in (limbs.starts, limbs.ends))
    return starts, ends


def _edges(limbs: Limbs, starts: FloatArray, ends: FloatArray, eye: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points (L, 2 ALONG, 3) of the limbs' outlines as seen from `eye`, and the directions outwards there."""
    u = ((np.arange(ALONG) + 0.5) / ALONG)[:, None]
    axis = starts[:, None] + (ends - starts)[:, None] * u
    side = _unit(np.cross((ends - starts)[:, None], eye - axis))
    low, high = limbs.mean_radii.T[:, :, None, None]
    radii = low + (high - low) * u
    edges, outwards = np.concatenate([axis + radii * side, axis - radii * side], axis=1), np.repeat(side, 2, axis=1)
    outwards[:, :ALONG], outwards[:, ALONG:] = side, -side
    balls = limbs.spheres
    sight = _unit(eye - starts[balls])
    across = _unit(np.cross(sight, [0.0, 0.0, 1.0]))
    angle = np.pi * np.arange(2 * ALONG) / ALONG
    around = np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * np.cross(sight, across)[:, None]
    outwards[balls] = around
    edges[balls] = starts[balls][:, None] + limbs.radii[balls, 0, 0][:, None, None] * around
    return edges, outwards


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9))
