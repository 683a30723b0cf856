"""A walk of known motion and its keypoints in one camera, for the tests of least squares."""

import numpy as np
from least_squares_scenes import SineModel

from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.cameras.camera import plain_camera
from workbench.core.frame import Frame, View
from workbench.inference.least_squares.motion.motion_decoder import MotionDecoder

BODY = person(from_height(1.75))
CAMERA = plain_camera(640, 480, 700.0, (0.4, -5.0, 1.2), (0.4, 0.0, 1.0))
PX_M = 5.0 / 700.0
"""Length of a pixel at the walker's distance, m."""
NOTHING = np.full((15, 3), np.nan)


def walk(n_frames=12, heading=0.0, rate_hz=1.1, phase=0.3):
    """Return times (T,) at 14 Hz, phases (T,) and poses (T, 25) of a walk through the middle of the image."""
    times = np.arange(n_frames) / 14.0
    roots = np.tile([0.4, 0.0, 0.95, heading, 0.05, 0.0], (n_frames, 1))
    roots[:, :2] += 1.3 * (times - times.mean())[:, None] * [np.cos(heading), np.sin(heading)]
    decoder = MotionDecoder(BODY.skeleton, SineModel(), np.zeros(25))
    phases = phase + rate_hz * times
    return times, phases, decoder.poses(decoder.states(np.array([0.5, -0.5]), phases, roots))


def keypoints(poses, sigma_px=0.0, missing=0.0, seed=0):
    """Return keypoints (T, 15, 3) of poses (T, 25) with noise; a fraction `missing` of them is NaN."""
    rng = np.random.default_rng(seed)
    pixels = CAMERA.project(joints(BODY.skeleton, poses))
    pixels += sigma_px * rng.standard_normal(pixels.shape)
    rows = np.concatenate([pixels, np.ones((*pixels.shape[:2], 1))], axis=2)
    rows[rng.random(rows.shape[:2]) < missing] = np.nan
    return rows


def frames(times, rows):
    """Return frames with keypoints (T, 15, 3); None for a frame without keypoints."""
    image = np.zeros((480, 640), np.uint8)
    return [
        Frame(20 + t, time, (View(CAMERA, image, frame_rows),))
        for t, (time, frame_rows) in enumerate(zip(times, rows, strict=True))
    ]  # fmt: skip


def errors_mm(poses, truth):
    """Return mean distances between the joints of poses (T, 25): in 3-D, and across the optical axis."""
    errors = joints(BODY.skeleton, np.asarray(poses)) - joints(BODY.skeleton, truth)
    across = errors @ CAMERA.rotation[:2].T
    return [1e3 * np.linalg.norm(vectors, axis=2).mean() for vectors in (errors, across)]


def streams():
    return {name: np.random.default_rng(k) for k, name in enumerate(("start", "prior", "draws"))}
