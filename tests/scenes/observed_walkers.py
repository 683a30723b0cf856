"""A generated walker as calibrated cameras see them, without any image being rendered."""

from functools import cache

import numpy as np

from workbench.body.camera import plain_camera
from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.evaluation.observed_joints import ObservedJoints
from workbench.motion.sources import find_motion

HEIGHT_M = 1.7


@cache
def walked():
    """Joints (F, J, 3), m, of a person 1.70 m tall who walks along x, on the floor z = 0."""
    motion = find_motion("builtin", data=None, rate_hz=10.0)
    found = joints(person(from_height(HEIGHT_M)).skeleton, motion.poses)[:20]
    return found - [*found[:, 0, :2].mean(axis=0), found[..., 2].min() - 0.039 * HEIGHT_M]


def around(n=3, focal_px=900.0, distance_m=5.0):
    """Cameras on an arc about the origin, 1.4 m high, a few degrees down."""
    angles = np.radians(np.linspace(-120.0, -60.0, n) if n > 1 else [-90.0])
    return tuple(
        plain_camera(
            1280, 960, focal_px, (distance_m * np.cos(a), distance_m * np.sin(a), 1.4), (0.0, 0.0, 1.0), f"c{k}"
        )
        for k, a in enumerate(angles)
    )


def seen_by(cameras, taken_by=None, sigma_px=2.0, points=None):
    """What cameras show of the walker: marks (V, F, J, 3) as `taken_by`, else they themselves, really see them."""
    points, rng = walked() if points is None else points, np.random.default_rng(5)
    marks = np.stack([camera.project(points) for camera in taken_by or cameras])
    marks = np.concatenate([marks + rng.normal(0.0, sigma_px, marks.shape), np.ones_like(marks[..., :1])], axis=-1)
    images = tuple(np.full((camera.height, camera.width), 90, np.uint8) for camera in cameras)
    return ObservedJoints(tuple(cameras), marks, np.ones(len(cameras), bool), 0, images)
