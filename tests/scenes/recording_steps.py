"""Synthetic steps for the recorder: a person walks past a camera, and particles are noise around the truth."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import cv2
import numpy as np

from workbench.body.kinematics import joints
from workbench.body.limbs import Body, person
from workbench.body.shape import from_height
from workbench.cameras.camera import Camera, plain_camera
from workbench.core.frame import Frame, Truth, View
from workbench.core.state_space import StateSpace
from workbench.core.step import Step
from workbench.utils.arrays import ByteArray, FloatArray

BODY = person(from_height(1.75))
SPACE = StateSpace.of(
    {
        "coefficients": (("c1", "c2", "c3", "c4", "c5"), "1"),
        "phase": (("phase",), "cycle"),
        "phase_speed": (("phase_speed",), "cycle/s"),
        "root": (("root_x", "root_y", "root_z", "root_heading", "root_pitch", "root_roll"), "m, rad"),
    }
)
SCALE = np.array([1.0, 0.7, 0.5, 0.35, 0.25])
CAMERA = plain_camera(640, 480, 700.0, (1.2, -5.0, 1.2), (1.2, 0.0, 0.95))
_RATE_HZ = 30.0
N_DRAWS = 5


def walk(body: Body, time_s: float) -> FloatArray:
    """Return the pose (25,) of a walk along x at 1.4 m/s, with sinusoidal hips, knees and arms."""
    pose = np.zeros(25)
    swing = np.sin(2.0 * np.pi * time_s)
    bend = 0.15 + 0.45 * np.array([max(0.0, np.sin(2.0 * np.pi * time_s + phase)) for phase in (1.3, 1.3 + np.pi)])
    angles = {
        "root_x": 1.4 * time_s, "root_z": 0.88 + 0.015 * np.cos(4.0 * np.pi * time_s),
        "left_hip_flexion": 0.1 + 0.4 * swing, "right_hip_flexion": 0.1 - 0.4 * swing,
        "left_knee_flexion": bend[0], "right_knee_flexion": bend[1],
        "left_shoulder_flexion": -0.4 * swing, "right_shoulder_flexion": 0.4 * swing,
        "left_shoulder_abduction": 0.08, "right_shoulder_abduction": 0.08,
        "left_elbow_flexion": 0.35 - 0.15 * swing, "right_elbow_flexion": 0.35 + 0.15 * swing,
    }  # fmt: skip
    for name, value in angles.items():
        pose[body.skeleton.dof(name)] = value
    return pose


def picture(body: Body, camera: Camera, pose: FloatArray, rng: np.random.Generator, colour: bool = False) -> ByteArray:
    """Return a grey or RGB noise image with the skeleton as thick lines."""
    image = np.clip(rng.normal(95.0, 6.0, (camera.height, camera.width)), 0, 255).astype(np.uint8)
    image = cv2.GaussianBlur(image, (0, 0), 1.4)
    pixels = camera.project(joints(body.skeleton, pose[None])[0])
    for a, b in body.skeleton.bones:
        start, end = (tuple(int(x) for x in np.rint(pixels[j])) for j in (a, b))
        cv2.line(image, start, end, 165, 18, cv2.LINE_AA)
    cv2.circle(image, tuple(int(x) for x in np.rint(pixels[body.skeleton.joint("head_centre")])), 14, 165, -1)
    return cv2.cvtColor(image, cv2.COLOR_GRAY2RGB) if colour else image


def steps(
    n_frames: int, n_particles: int = 300, camera: Camera = CAMERA, seed: int = 0, colour: bool = False
) -> Iterator[Step]:
    """Yield a run of `n_frames` steps; the first frame has index 10."""
    rng = np.random.default_rng(seed)
    coefficients = rng.normal(0.0, 0.4, 5) * SCALE
    for i in range(n_frames):
        truth = walk(BODY, i / _RATE_HZ)
        annotations = camera.project(joints(BODY.skeleton, truth[None])[0])
        frame_truth = Truth(pose=truth, joints=joints(BODY.skeleton, truth[None])[0], annotations=annotations)
        image = picture(BODY, camera, truth, rng, colour)
        frame = Frame(10 + i, i / _RATE_HZ, (View(camera, image),), frame_truth)
        coefficients = 0.95 * coefficients + rng.normal(0.0, 0.08, 5) * SCALE
        yield _step(frame, truth, coefficients, n_particles, rng)


def without_images(run: Iterable[Step]) -> list[Step]:
    """Return the steps without cameras, which most readers do not need."""
    return [replace(step, frame=replace(step.frame, views=())) for step in run]


def _step(frame: Frame, truth: FloatArray, coefficients: FloatArray, n: int, rng: np.random.Generator) -> Step:
    spread = np.full(25, 0.09)
    spread[:6] = (0.03, 0.09, 0.02, 0.05, 0.02, 0.02)
    offset = 0.35 * rng.standard_normal(25) * spread
    noise = rng.standard_normal((n, 25))
    poses = truth + offset + noise * spread
    phase = (frame.time_s + 0.03 * rng.standard_normal((n, 1))) % 1.0
    speed = 1.0 + 0.05 * rng.standard_normal((n, 1))
    styles = coefficients + 0.3 * SCALE * rng.standard_normal((n, 5))
    log_weights = -0.12 * (noise**2).sum(axis=1)
    log_weights -= np.log(np.exp(log_weights - log_weights.max()).sum()) + log_weights.max()
    weights = np.exp(log_weights)
    return Step(
        frame=frame,
        space=SPACE,
        particles=np.hstack([styles, phase, speed, poses[:, :6]]),
        poses=poses,
        log_weights=log_weights,
        ancestors=np.arange(n),
        expected_pose=weights @ poses,
        map_pose=poses[np.argmax(weights)],
        ess=float(1.0 / (weights**2).sum()),
        log_evidence=-3.0 * (frame.index - 9.0),
        diagnostics={"visible_limbs": 10.0},
        draws=poses[:N_DRAWS],
        warnings=("limb left_hand left the image",) if frame.index == 12 else (),
    )


def errors(step: Step) -> dict[str, float]:
    """Return the mean joint errors, absolute and root-aligned, mm, and the log evidence."""
    assert step.frame.truth is not None
    assert step.frame.truth.joints is not None
    estimate = joints(BODY.skeleton, step.expected_pose[None])[0]
    true = step.frame.truth.joints
    absolute = np.linalg.norm(estimate - true, axis=1).mean()
    relative = np.linalg.norm((estimate - estimate[0]) - (true - true[0]), axis=1).mean()
    return {
        "error_mm": 1e3 * float(absolute),
        "error_relative_mm": 1e3 * float(relative),
        "log_evidence": step.log_evidence,
    }
