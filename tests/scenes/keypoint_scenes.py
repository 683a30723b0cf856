"""A walk of known motion whose joints a camera sees in every frame, for the tests of least squares on keypoints."""

import numpy as np
from least_squares_scenes import SineModel

from workbench.body.camera import plain_camera
from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.core.frame import Frame, View
from workbench.inference.least_squares.single_frame import MotionDecoder

BODY = person(from_height(1.75))
CAMERA = plain_camera(640, 480, 700.0, (0.4, -5.0, 1.2), (0.4, 0.0, 1.0))
PX_M = 5.0 / 700.0
"""What a pixel is at the walker's distance, m."""
NOTHING = np.full((15, 3), np.nan)


def walk(n_frames=12, heading=0.0, rate_hz=1.1, phase=0.3):
    """Times (T,) at 14 Hz, phases (T,) and poses (T, 25) of a walk through the middle of the image."""
    times = np.arange(n_frames) / 14.0
    roots = np.tile([0.4, 0.0, 0.95, heading, 0.05, 0.0], (n_frames, 1))
    roots[:, :2] += 1.3 * (times - times.mean())[:, None] * [np.cos(heading), np.sin(heading)]
    decoder = MotionDecoder(BODY.skeleton, SineModel(), np.zeros(25))
    phases = phase + rate_hz * times
    return times, phases, decoder.poses(decoder.states(np.array([0.5, -0.5]), phases, roots))


def keypoints(poses, sigma_px=0.0, missing=0.0, seed=0):
    """(T, 15, 3) of poses (T, 25), with noise and without some."""
    rng = np.random.default_rng(seed)
    pixels = CAMERA.project(joints(BODY.skeleton, poses))
    found = np.concatenate([pixels + sigma_px * rng.standard_normal(pixels.shape), np.ones((*pixels.shape[:2], 1))], 2)
    found[rng.random(found.shape[:2]) < missing] = np.nan
    return found


def frames(times, seen):
    """Frames that show keypoints (T, 15, 3), or none where they are None."""
    image = np.zeros((480, 640), np.uint8)
    return [
        Frame(20 + t, time, (View(CAMERA, image, rows),))
        for t, (time, rows) in enumerate(zip(times, seen, strict=True))
    ]  # fmt: skip


def errors_mm(poses, truth):
    """Mean distances between the joints of poses (T, 25): in all directions, and without depth."""
    apart = joints(BODY.skeleton, np.asarray(poses)) - joints(BODY.skeleton, truth)
    across = apart @ CAMERA.rotation[:2].T
    return [1e3 * np.linalg.norm(way, axis=2).mean() for way in (apart, across)]


def streams():
    return {name: np.random.default_rng(k) for k, name in enumerate(("start", "prior"))}
