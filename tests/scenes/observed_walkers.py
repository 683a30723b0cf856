"""A generated walker's keypoints in calibrated cameras, without rendered images."""

from functools import cache

import numpy as np

from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.cameras.camera import plain_camera
from workbench.cameras.observed_joints import ObservedJoints
from workbench.motion.sources import find_motion

HEIGHT_M = 1.7


@cache
def walker_joints():
    """Return joints (F, J, 3), m, of a person 1.70 m tall who walks along x on the floor z = 0."""
    motion = find_motion("builtin", data=None, rate_hz=10.0)
    positions = joints(person(from_height(HEIGHT_M)).skeleton, motion.poses)[:20]
    return positions - [*positions[:, 0, :2].mean(axis=0), positions[..., 2].min() - 0.039 * HEIGHT_M]


def camera_arc(n=3, focal_px=900.0, distance_m=5.0):
    """Return cameras on an arc about the origin, at a height of 1.4 m, tilted a few degrees down."""
    angles = np.radians(np.linspace(-120.0, -60.0, n) if n > 1 else [-90.0])
    return tuple(
        plain_camera(
            1280, 960, focal_px, (distance_m * np.cos(a), distance_m * np.sin(a), 1.4), (0.0, 0.0, 1.0), f"c{k}"
        )
        for k, a in enumerate(angles)
    )


def observed_joints(cameras, true_cameras=None, sigma_px=2.0, points=None):
    """Return keypoints (V, F, J, 3) attributed to `cameras` and projected by `true_cameras`, by default the same."""
    points, rng = walker_joints() if points is None else points, np.random.default_rng(5)
    keypoints = np.stack([camera.project(points) for camera in true_cameras or cameras])
    keypoints = keypoints + rng.normal(0.0, sigma_px, keypoints.shape)
    keypoints = np.concatenate([keypoints, np.ones_like(keypoints[..., :1])], axis=-1)
    images = tuple(np.full((camera.height, camera.width), 90, np.uint8) for camera in cameras)
    return ObservedJoints(tuple(cameras), keypoints, np.ones(len(cameras), bool), 0, images)
