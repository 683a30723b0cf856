"""Walks with known feet, of the generated gait with the ankles of textbooks, and their keypoints in one camera."""

import numpy as np
import scipy

from workbench.body.kinematics import joints
from workbench.body.limbs import person_with_feet
from workbench.body.skeleton import FOOT_POINTS, JOINT_NAMES
from workbench.cameras.camera import plain_camera
from workbench.core.frame import Frame, View
from workbench.motion.sources import find_motion

_CYCLE = (0, 7, 20, 40, 50, 56, 62, 66, 74, 82, 90, 100)
_ANKLE_DEG = (0, -5, 3, 9, 6, -5, -17, -20, -10, 0, 2, 0)
"""Percent of the cycle from heel strike, and the ankle's dorsiflexion in natural walking (Winter, *Biomechanics and
Motor Control of Human Movement*, 4th ed. 2009, table A.3, rounded)."""


def walker(n_frames=45, rate_hz=30.0, seed=0, first=60):
    """Return times (T,), the body and poses (T, 27) of a walk at the origin, ankles by the textbook's curve."""
    motion = find_motion("builtin", data=None, rate_hz=rate_hz, seed=seed)
    body, poses = person_with_feet(motion.shape), np.pad(motion.poses, ((0, 0), (0, 2)))
    curve = scipy.interpolate.CubicSpline(_CYCLE, np.radians(_ANKLE_DEG), bc_type="periodic")
    places, heading = joints(body.skeleton, poses), motion.poses[:, 3]
    ahead = np.column_stack([np.cos(heading), np.sin(heading)])
    for side in ("left", "right"):
        ankle = places[:, body.skeleton.joint(f"{side}_ankle"), :2] - places[:, 0, :2]
        strikes, _ = scipy.signal.find_peaks((ankle * ahead).sum(axis=1), distance=0.6 * rate_hz)
        phase = 100.0 * np.interp(np.arange(len(poses)), strikes, np.arange(len(strikes)))
        poses[:, body.skeleton.dof(f"{side}_ankle_flexion")] = curve(phase % 100.0)
    poses = poses[first : first + n_frames]
    poses[:, :2] -= poses[:, :2].mean(axis=0)
    return np.arange(n_frames) / rate_hz, body, poses


def side_camera(distance_m=5.0, azimuth_deg=-90.0):
    """Return a camera 1.2 m above the ground that sees a walker along x from the side."""
    azimuth = np.radians(azimuth_deg)
    place = (distance_m * np.cos(azimuth), distance_m * np.sin(azimuth), 1.2)
    return plain_camera(1280, 960, 200.0 * distance_m, place, (0.0, 0.0, 0.85))


def frames(times, body, poses, camera, sigma_px=0.0, feet=True, seed=0):
    """Return frames with the keypoints of poses (T, 27) with noise; feet: whether they include heels and toes."""
    rng, skeleton = np.random.default_rng(seed), body.skeleton
    pixels = camera.project(joints(skeleton, poses))
    pixels += sigma_px * rng.standard_normal(pixels.shape)
    rows = np.concatenate([pixels, np.ones((*pixels.shape[:2], 1))], axis=2)
    plain, ends = [[skeleton.joint(name) for name in names] for names in (JOINT_NAMES, FOOT_POINTS)]
    image = np.zeros((camera.height, camera.width), np.uint8)
    return [
        Frame(t, time, (View(camera, image, row[plain], feet=row[ends] if feet else None),))
        for t, (time, row) in enumerate(zip(times, rows, strict=True))
    ]
