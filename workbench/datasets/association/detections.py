"""Detections as their views show them, without lenses: what a joint's rays meet, and how a place is seen."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from workbench.body.camera import Camera
from workbench.body.skeleton import JOINT_NAMES
from workbench.motion.formats.openpose import People
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

J = len(JOINT_NAMES)
HEIGHT_M = 1.5
"""From head to ankles, of a person who stands: the unit of a view whose camera tells no distance."""
SIGMA_M = 0.03
"""Standard deviation of a sure joint at the person's distance, m: detectors are off by 1 to 2 cm, and alike in all
joints of a view, which means another place on the body from each side."""


@dataclass(frozen=True, eq=False)
class Detection:
    """One person found in one view. places: (J, 2) as `Eye` has them, NaN for a joint that was not found. sigma: (J,)
    standard deviation, m at the person's distance. lacks: (J,), joints not found that the detector finds in others;
    None for no joint."""

    places: FloatArray
    sigma: FloatArray
    lacks: BoolArray | None = None

    @property
    def found(self) -> BoolArray:
        """Tell which joints were found, (J,)."""
        return np.isfinite(self.places[:, 0])


@dataclass(frozen=True, eq=False)
class Eye:
    """How joints (J, D), m, are seen. Before a camera D is 3 and places are x/z, y/z in its frame, without distortion;
    without one D is 2 and places are pixels over px_per_m, m: all are taken to be as far off as the median person.
    finds: (J,), the joints that the detector finds at all."""

    camera: Camera | None
    finds: BoolArray
    px_per_m: float = 1.0

    def seen(self, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return places (..., 2) of joints (..., D), m, and the distances (...,) that make metres of places."""
        if self.camera is None:
            return joints, np.ones(joints.shape[:-1])
        at = self.camera.to_camera(joints)
        depth = np.maximum(at[..., 2], 0.1)  # who is nearer, or behind, is seen far off
        return at[..., :2] / depth[..., None], depth

    def project(self, joints: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return places (J, 2) of joints (J, D), m, their derivatives (J, 2, D), and the distances as `seen` does."""
        places, depth = self.seen(joints)
        if self.camera is None:
            return places, np.broadcast_to(np.eye(2), (len(joints), 2, 2)), depth
        by_camera = np.zeros((len(joints), 2, 3))
        by_camera[:, 0, 0] = by_camera[:, 1, 1] = 1.0
        by_camera[:, :, 2] = -places
        return places, by_camera @ self.camera.rotation / depth[:, None, None], depth

    def inside(self, places: FloatArray) -> BoolArray:
        """Tell which places (..., 2) are in the image, (...,)."""
        if self.camera is None:
            return np.ones(places.shape[:-1], dtype=bool)
        pixels = places * self.camera.matrix[[0, 1], [0, 1]] + self.camera.matrix[:2, 2]
        return np.asarray(((pixels > 0.0) & (pixels < [self.camera.width, self.camera.height])).all(axis=-1), bool)

    def detection(self, joints: FloatArray) -> Detection:
        """Take a detector's joints (J, 3), [u px, v px, confidence]."""
        sigma = SIGMA_M / np.sqrt(np.clip(joints[:, 2], 0.1, 1.0))
        found = np.isfinite(joints[:, 0])
        lacks = self.finds & ~found
        if self.camera is None:
            return Detection(joints[:, :2] / self.px_per_m, sigma, lacks)
        places = np.full((len(joints), 2), np.nan)
        if found.any():
            pixels = np.ascontiguousarray(joints[found, None, :2])
            places[found] = cv2.undistortPoints(pixels, self.camera.matrix, self.camera.distortion)[:, 0]
        return Detection(places, sigma, lacks)

    def rays(self, places: FloatArray) -> FloatArray:
        """Return the directions (..., 3), of unit length, of a camera's rays to places (..., 2)."""
        assert self.camera is not None
        ahead = np.concatenate([places, np.ones((*places.shape[:-1], 1))], axis=-1)
        return ahead / np.linalg.norm(ahead, axis=-1, keepdims=True) @ self.camera.rotation

    @property
    def position(self) -> FloatArray:
        """Where a camera's rays come from, (3,) m."""
        assert self.camera is not None
        return self.camera.position


def meeting(eyes: Sequence[Eye], places: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return where the rays of V cameras to places (V, ..., 2), NaN for none, pass each other nearest, (..., 3), m, NaN
    where there are fewer than two, and their numbers (...,)."""
    normal, right = np.zeros((*places.shape[1:-1], 3, 3)), np.zeros((*places.shape[1:-1], 3))
    n_rays = np.isfinite(places[..., 0]).sum(axis=0)
    for eye, seen in zip(eyes, places, strict=True):
        ray = eye.rays(seen)
        across = np.where(np.isfinite(ray[..., :1, None]), np.eye(3) - ray[..., :, None] * ray[..., None, :], 0.0)
        normal += across
        right += across @ eye.position
    joints = np.full(right.shape, np.nan)
    joints[n_rays > 1] = np.linalg.solve(normal[n_rays > 1], right[n_rays > 1, :, None])[..., 0]
    return joints, n_rays


def eye_of(people: People, camera: Camera | None) -> Eye:
    """Return the eye that a folder's people were found with. Without a camera metres come from their median height in
    the image: the longer side of the box around a person's joints."""
    found = np.concatenate(people.joints)
    finds = np.asarray(np.isfinite(found[..., 0]).any(axis=0), bool)
    seen = found[np.isfinite(found[..., 0]).sum(axis=1) > 1]
    heights = (np.nanmax(seen[..., :2], axis=1) - np.nanmin(seen[..., :2], axis=1)).max(axis=1)
    px_per_m = float(np.median(heights)) / HEIGHT_M if len(heights) else 1.0
    return Eye(camera, finds, max(px_per_m, 1e-3))
