"""Small scenes for the tests of likelihoods: textures, cameras, people and rods."""

import cv2
import numpy as np

from workbench.body.limbs import Body, Limbs, person
from workbench.body.shape import from_height
from workbench.cameras.camera import Camera, plain_camera
from workbench.core.frame import Frame, View

PERSON = person(from_height(1.75))
WIDTH, HEIGHT, FOCAL, DISTANCE = 320, 240, 300.0, 4.0
FRONT = plain_camera(WIDTH, HEIGHT, FOCAL, (DISTANCE, 0.0, 0.0), (0.0, 0.0, 0.0), name="front")
"""Faces the origin along −x, with 75 px per metre there; image x is world y, image y is −z."""


def texture(rng, width=WIDTH, height=HEIGHT, blur=2.5):
    """Return a smooth random image with grey levels 128 ± 40."""
    noise = cv2.GaussianBlur(rng.standard_normal((height, width)), (0, 0), blur)
    return np.clip(128.0 + 40.0 * noise / noise.std(), 0.0, 255.0).astype(np.uint8)


def frame(index, *views):
    return Frame(index, index / 30.0, tuple(View(camera, image) for camera, image in views))


def flat(level, camera=FRONT):
    return np.full((camera.height, camera.width), level, dtype=np.uint8)


def distorted(camera: Camera) -> Camera:
    distortion = np.array([-0.2, 0.05, 0.003, -0.002, 0.01])
    return Camera(
        camera.name, camera.width, camera.height, camera.matrix, camera.rotation, camera.translation, distortion
    )


def rods(*limbs: tuple[tuple[float, float, float], tuple[float, float, float], float]) -> Body:
    """Return a body of cylinders (start, end, radius), m, fixed to the root; a sphere if start equals end."""
    starts, ends = (np.array([limb[side] for limb in limbs]) for side in (0, 1))
    radii = np.array([np.full((2, 2), limb[2]) for limb in limbs])
    spheres = (starts == ends).all(axis=1)
    names = tuple(f"rod_{i}" for i in range(len(limbs)))
    joints = np.zeros(len(limbs), dtype=np.int64)
    return Body(PERSON.skeleton, PERSON.shape, Limbs(names, joints, starts, ends, radii, spheres))


def root(position=(0.0, 0.0, 0.0), heading=0.0, pitch=0.0, roll=0.0):
    """Return one pose (1, 25) whose joint angles are zero."""
    pose = np.zeros((1, 25))
    pose[0, :3], pose[0, 3:6] = position, (heading, pitch, roll)
    return pose


def people(rng, n, spread=1.0):
    """Return n random poses (n, 25) near the origin; `spread` scales their standard deviations."""
    sigma = np.concatenate([np.full(3, 0.1), [0.8, 0.1, 0.1], np.full(19, 0.4)])
    return spread * sigma * rng.standard_normal((n, 25))


def log_prob(likelihood, previous, frame, previous_pose, pose):
    """Return log likelihoods (N,) of poses (N, P) and previous poses."""
    return likelihood.prepare(previous, frame).evaluate(previous_pose, pose).log_prob


def notes(likelihood, previous, frame, previous_pose, pose):
    """Return the notes on the frame and on the poses."""
    frame_likelihood = likelihood.prepare(previous, frame)
    return frame_likelihood.notes + frame_likelihood.evaluate(previous_pose, pose).notes


def after_first_frame(likelihood, frame, pose):
    """Return the likelihood after a first frame with the expected pose (P,)."""
    return likelihood.prepare(None, frame).update(pose)
