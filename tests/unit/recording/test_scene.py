"""What is drawn of a body: bones once each, solids where the limbs are, overlays where the camera sees them."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from workbench.body.camera import plain_camera
from workbench.body.kinematics import forward, joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.recording.write import images, scene

BODY = person(from_height(1.8))
LENS = np.array([-0.25, 0.05, 0.003, -0.002, 0.01])


def random_pose(seed=0):
    pose = np.random.default_rng(seed).uniform(-0.6, 0.6, 25)
    pose[:3] = (0.3, -0.2, 0.95)
    return pose


def shown(rows):
    """{entity path: {field: value}} of what a function of the scene returns."""
    return {path: row.fields for path, row in rows}


def test_solids_move_with_their_joints():
    pose = random_pose()
    body = shown(scene.estimate(scene.figure(BODY), forward(BODY.skeleton, pose[None])))["world/estimate/body"]
    centers, quaternions = body["centers"], body["quaternions"]
    figure, frames = scene.figure(BODY), forward(BODY.skeleton, pose[None])
    for e in range(len(centers)):
        x, y, z, w = quaternions[e]
        axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])  # the turned z axis
        rotation = frames.rotations[0, figure.carriers[e]]
        along = rotation @ figure.axes[e, :, 2]
        assert axis == pytest.approx(along, abs=1e-6)
        place = frames.positions[0, figure.carriers[e]] + rotation @ figure.centers[e]
        assert centers[e] == pytest.approx(place, abs=1e-6)


def test_overlays_lie_where_the_undistorted_camera_sees_the_joints():
    camera = plain_camera(640, 480, 600.0, (0.0, -4.0, 1.0), (0.0, 0.0, 1.0))
    picture = images.recorded_camera(replace(camera, distortion=LENS))
    positions = joints(BODY.skeleton, random_pose()[None])
    chains = scene.figure(BODY).chains
    (drawn,) = shown(images.overlay(picture, "estimate", positions, chains)).values()
    assert drawn["strips"] == pytest.approx(camera.project(positions)[0][chains], abs=1e-3)  # float32


def test_straightened_pixels_undo_the_lens():
    camera = replace(plain_camera(640, 480, 600.0, (0.0, -4.0, 1.0), (0.0, 0.0, 1.0)), distortion=LENS)
    points = joints(BODY.skeleton, random_pose()[None])[0]
    straight = replace(camera, distortion=np.zeros(5)).project(points)
    assert images.undistorted(camera, camera.project(points)) == pytest.approx(straight, abs=0.02)  # five iterations
    assert images.undistorted(camera, np.empty((0, 2))).shape == (0, 2)


@pytest.mark.parametrize("colours", [1, 3])
def test_an_image_is_undistorted_and_read_back_in_its_colours(colours):
    camera = plain_camera(64, 48, 60.0, (0.0, -4.0, 1.0), (0.0, 0.0, 1.0))
    grey = np.tile(np.linspace(20, 220, 64).astype(np.uint8), (48, 1))
    pixels = grey if colours == 1 else np.stack([grey, grey[:, ::-1], np.full_like(grey, 90)], axis=-1)
    encoded = images.jpeg(images.recorded_camera(camera), pixels, 95)
    ((path, row),) = images.jpeg_row("world/camera/image", encoded)
    assert (path, row.fields["media_type"]) == ("world/camera/image", ["image/jpeg"])
    decoded = cv2.imdecode(row.fields["blob"][0], cv2.IMREAD_UNCHANGED)
    assert np.abs((decoded if colours == 1 else decoded[..., ::-1]).astype(float) - pixels).mean() < 2.0
    bent = images.jpeg(images.recorded_camera(replace(camera, distortion=LENS)), grey, 95)
    straight = cv2.undistort(grey, camera.matrix, np.array(LENS))
    assert np.abs(cv2.imdecode(bent, cv2.IMREAD_UNCHANGED).astype(float) - straight).mean() < 2.0
