"""Detections of people in normalised image coordinates, and the projection model of a view."""

from dataclasses import dataclass

import numpy as np

from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.camera import Camera
from workbench.cameras.image_height import height_px
from workbench.detections.readers.people import People
from workbench.utils.arrays import BoolArray, FloatArray

J = len(JOINT_NAMES)
HEIGHT_M = 1.5
"""Height from head to ankles of a standing person: the unit of a view without a camera."""
SIGMA_M = 0.03
"""Standard deviation of a confident joint at the person's distance, m. Detectors have errors of 1 to 2 cm, which are
common to all joints of a view and differ between views."""


@dataclass(frozen=True, eq=False)
class Detection:
    """One person detected in one view.

    places: (J, 2) coordinates of `DetectorView`, NaN for a joint that was not detected. sigma: (J,) standard deviation,
    m at the person's distance. missing: (J,) undetected joints that the detector outputs for other people.
    """

    places: FloatArray
    sigma: FloatArray
    missing: BoolArray

    @property
    def detected(self) -> BoolArray:
        """Whether each joint was detected, (J,)."""
        return np.isfinite(self.places[:, 0])


@dataclass(frozen=True, eq=False)
class DetectorView:
    """Projection model of a view for joints (J, D), m.

    With a camera D is 3 and places are x/z, y/z in its frame, undistorted; without one D is 2 and places are pixels
    over px_per_m, m: all people are assumed at the distance of the median person. detectable: (J,) joints that the
    detector outputs at all.
    """

    camera: Camera | None
    detectable: BoolArray
    px_per_m: float = 1.0

    def places(self, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return places (..., 2) of joints (..., D), m, and the factors (...,) from places to metres: the depths."""
        if self.camera is None:
            return joints, np.ones(joints.shape[:-1])
        in_camera = self.camera.to_camera(joints)
        depth = np.maximum(in_camera[..., 2], 0.1)  # nearer joints, and those behind the camera, are projected far off
        return in_camera[..., :2] / depth[..., None], depth

    def project(self, joints: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return places (J, 2) of joints (J, D), m, their derivatives (J, 2, D), and the depths (J,)."""
        places, depth = self.places(joints)
        if self.camera is None:
            return places, np.broadcast_to(np.eye(2), (len(joints), 2, 2)), depth
        by_camera = np.zeros((len(joints), 2, 3))
        by_camera[:, 0, 0] = by_camera[:, 1, 1] = 1.0
        by_camera[:, :, 2] = -places
        return places, by_camera @ self.camera.rotation / depth[:, None, None], depth

    def inside(self, places: FloatArray) -> BoolArray:
        """Return whether places (..., 2) lie in the image, (...,)."""
        if self.camera is None:
            return np.ones(places.shape[:-1], dtype=bool)
        pixels = places * self.camera.matrix[[0, 1], [0, 1]] + self.camera.matrix[:2, 2]
        return np.asarray(((pixels > 0.0) & (pixels < [self.camera.width, self.camera.height])).all(axis=-1), bool)

    def detection(self, joints: FloatArray) -> Detection:
        """Convert a detector's joints (J, 3), [u px, v px, confidence]."""
        sigma, pixels = SIGMA_M / np.sqrt(np.clip(joints[:, 2], 0.1, 1.0)), joints[:, :2]
        places = pixels / self.px_per_m if self.camera is None else self.camera.undistorted(pixels)
        return Detection(places, sigma, self.detectable & ~np.isfinite(joints[:, 0]))

    @property
    def calibrated(self) -> Camera:
        """The camera of a view that has one."""
        assert self.camera is not None
        return self.camera


def detector_view(people: People, camera: Camera | None) -> DetectorView:
    """Return the view in which people were detected; without a camera its scale comes from their median height."""
    joints = np.concatenate(people.joints)
    detectable = np.asarray(np.isfinite(joints[..., 0]).any(axis=0), bool)
    return DetectorView(camera, detectable, max(median_height(joints[..., :2]) or HEIGHT_M, 1e-3 * HEIGHT_M) / HEIGHT_M)


def median_height(places: FloatArray) -> float:
    """Return the median height in the image of people's joints (n, J, 2), NaN where unknown; 0 for none."""
    detected = places[np.isfinite(places[..., 0]).sum(axis=1) > 1]
    return float(np.median(height_px(detected))) if len(detected) else 0.0


def prominence(joints: FloatArray) -> FloatArray:
    """Return the sum of confidence times the height in the image, (...), of people's joints (..., J, 3)."""
    return np.nansum(joints[..., 2], axis=-1) * height_px(joints[..., :2])
