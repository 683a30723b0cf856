"""Alignment of the ground truth's axes with those of the cameras, by detections."""

import numpy as np
import pytest

from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.cameras.camera import plain_camera
from workbench.datasets.truth_axes import ROTATIONS, in_axes_of_cameras

CAMERAS = [plain_camera(640, 480, 600.0, at, (0.0, 0.0, 1.0)) for at in ((4.0, 1.0, 1.5), (-1.0, 4.5, 1.2))]


def scene(n=6):
    poses = np.random.default_rng(0).normal(0.0, 0.3, (n, 25))
    poses[:, :3] = np.linspace([-0.4, 0.2, 0.9], [0.5, -0.1, 0.95], n)
    places = joints(person(from_height(1.7)).skeleton, poses)
    noise = np.random.default_rng(1).normal(0.0, 2.0, (len(CAMERAS), n, places.shape[1], 2))
    return places, [(camera, camera.project(places) + errors) for camera, errors in zip(CAMERAS, noise, strict=True)]


def test_there_are_24_rotations():
    assert len(np.unique(ROTATIONS, axis=0)) == 24
    np.testing.assert_array_equal(ROTATIONS[0], np.eye(3))
    np.testing.assert_allclose(np.linalg.det(ROTATIONS), 1.0)


@pytest.mark.parametrize("k", range(24))
def test_every_rotation_of_the_axes_is_recognized(k, caplog):
    places, detections = scene()
    detections[0][1][2] = np.nan
    places[1, 4] = np.nan
    np.testing.assert_allclose(in_axes_of_cameras("truth.trc", places @ ROTATIONS[k], detections), places, atol=1e-12)
    assert ("set truth_up and truth_forward" in caplog.text) == (k > 0)


def test_a_truth_without_a_better_rotation_is_unchanged():
    places, detections = scene()
    elsewhere = places + np.array([30.0, 0.0, 0.0])
    for observed in ([], [(camera, np.full_like(pixels, np.nan)) for camera, pixels in detections], detections):
        assert in_axes_of_cameras("truth.trc", elsewhere, observed) is elsewhere
