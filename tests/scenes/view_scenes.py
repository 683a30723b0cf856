"""People with keypoints in two cameras, for the tests of least squares over several views."""

from dataclasses import replace

import numpy as np
from keypoint_scenes import CAMERA

from workbench.body.kinematics import joints
from workbench.cameras.camera import plain_camera
from workbench.core.frame import Frame, View
from workbench.core.observations import observe

SIDE = plain_camera(640, 480, 700.0, (5.4, 0.3, 1.4), (0.4, 0.0, 1.0), name="side")
CAMERAS = (replace(CAMERA, name="front"), SIDE)


def swinging(skeleton, n_frames=15, rate_hz=14.0):
    """Return times (T,) and poses (T, 25) of a person who leans and swings an arm, unlike a walk."""
    times = np.arange(n_frames) / rate_hz
    poses = np.tile(np.zeros(25), (n_frames, 1))
    poses[:, :6] = [0.4, 0.0, 0.95, -1.4, 0.1, 0.0]
    turn = 2.0 * np.pi * times
    moves = {
        "root_roll": 0.4 * np.sin(turn), "right_shoulder_abduction": 1.0 + 0.7 * np.sin(turn),
        "right_elbow_flexion": 0.7 + 0.4 * np.cos(turn), "left_shoulder_flexion": 0.5 * np.sin(turn),
        "left_elbow_flexion": 0.6, "left_hip_flexion": 0.3 + 0.3 * np.cos(turn), "left_knee_flexion": 0.5,
        "right_knee_flexion": 0.2, "right_hip_flexion": 0.1,
    }  # fmt: skip
    for name, angle in moves.items():
        poses[:, skeleton.dof(name)] = angle
    return times, poses


def frames(skeleton, times, poses, cameras=CAMERAS, sigma_px=0.0, seed=0):
    """Return frames with the cameras' keypoints of poses (T, 25)."""
    rng, image, places = np.random.default_rng(seed), np.zeros((480, 640), np.uint8), joints(skeleton, poses)

    def view(camera, place):
        pixels = camera.project(place)
        noisy = pixels + sigma_px * rng.standard_normal(pixels.shape)
        return View(camera, image, np.column_stack([noisy, np.ones(15)]))

    return [
        Frame(t, time, tuple(view(camera, places[t]) for camera in cameras)) for t, time in enumerate(times)
    ]  # fmt: skip


def observed(skeleton, frames):
    return observe(frames, skeleton, 1000, np.random.default_rng(0))[0]


def errors_mm(skeleton, poses, truth):
    return 1e3 * np.linalg.norm(joints(skeleton, np.asarray(poses)) - joints(skeleton, truth), axis=2).mean()
