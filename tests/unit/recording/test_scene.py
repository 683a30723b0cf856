"""Solids are drawn at the limbs, and overlays at the projections of the joints without lens distortion."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.body.kinematics import forward, joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.cameras.camera import plain_camera
from workbench.recording.write import images, scene, styles

BODY = person(from_height(1.8))
LENS = np.array([-0.25, 0.05, 0.003, -0.002, 0.01])


def random_pose(seed=0):
    pose = np.random.default_rng(seed).uniform(-0.6, 0.6, 25)
    pose[:3] = (0.3, -0.2, 0.95)
    return pose


def fields_of(rows):
    """Return {entity path: {field: value}} of rows."""
    return {path: row.fields for path, row in rows}


def test_solids_move_with_their_joints():
    pose = random_pose()
    body = fields_of(scene.estimate(scene.figure(BODY), forward(BODY.skeleton, pose[None])))["world/estimate/body"]
    centers, quaternions = body["centers"], body["quaternions"]
    figure, frames = scene.figure(BODY), forward(BODY.skeleton, pose[None])
    for e in range(len(centers)):
        x, y, z, w = quaternions[e]
        axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])  # the rotated z axis
        rotation = frames.rotations[0, figure.carriers[e]]
        assert axis == pytest.approx(rotation @ figure.axes[e, :, 2], abs=1e-6)
        center = frames.positions[0, figure.carriers[e]] + rotation @ figure.centers[e]
        assert centers[e] == pytest.approx(center, abs=1e-6)


def test_the_solids_of_a_limb_end_with_it_or_within_its_smallest_radius_beyond():
    drawn, limbs = scene.figure(BODY), BODY.limbs
    n_per_cone = (len(drawn.centers) - limbs.spheres.sum()) // (~limbs.spheres).sum()
    limb = np.repeat(np.arange(len(limbs)), np.where(limbs.spheres, 1, n_per_cone))
    cones = ~limbs.spheres[limb]
    along = np.einsum("ei,ei->e", drawn.centers - limbs.starts[limb], drawn.axes[..., 2])
    begin, end = (along + sign * drawn.half_sizes[:, 2] for sign in (-1.0, 1.0))
    smallest = limbs.radii.min(axis=2)[limb]
    assert (begin >= -smallest[:, 0] - 1e-12)[cones].all()
    assert (end <= limbs.lengths[limb] + smallest[:, 1] + 1e-12)[cones].all()
    assert n_per_cone > 1


def test_particles_fade_with_the_logarithm_of_their_weight():
    ends = np.array([styles.LIGHTEST_PARTICLE, styles.HEAVIEST_PARTICLE])
    shades = scene.weight_colours(np.array([-11.0, -2.0, -6.5, -8.0]))
    np.testing.assert_array_equal(shades, np.rint([[1.0, 0.0], [0.0, 1.0], [0.75, 0.25], [1.0, 0.0]] @ ends))


@pytest.mark.parametrize("is_true", [False, True])
def test_overlays_are_the_joints_projected_without_distortion(is_true):
    """The middle one of three persons stands behind the camera; the truth has a camera of its own."""
    camera, other = (plain_camera(640, 480, 600.0, (x, -4.0, 1.0), (0.0, 0.0, 1.0)) for x in (0.0, 1.0))
    poses = np.stack([random_pose(seed) for seed in range(3)])
    poses[1, 1] = -9.0
    positions, chains = joints(BODY.skeleton, poses), scene.figure(BODY).chains
    shades = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255]], np.uint8)
    true_camera = replace(other, distortion=LENS) if is_true else None
    recorded_camera = images.recorded_camera(replace(camera, distortion=LENS))
    rows = images.overlay(recorded_camera, "estimate", positions, chains, shades, true_camera)
    (drawn,) = fields_of(rows).values()
    expected = (other if is_true else camera).project(positions[[0, 2]])[:, chains]
    assert drawn["strips"] == pytest.approx(np.concatenate(expected), abs=1e-3)  # float32
    assert drawn["colors"].tolist() == [[255, 0, 0]] * len(chains) + [[0, 0, 255]] * len(chains)


def test_a_camera_that_turns_is_recorded_in_every_frame():
    camera = plain_camera(640, 480, 600.0, (0.0, -4.0, 1.0), (0.5, 0.0, 1.2))
    recorded = images.turned(images.recorded_camera(camera), replace(camera, matrix=1.1 * camera.matrix))
    pose = fields_of(images.turn(recorded))[recorded.path]
    np.testing.assert_allclose(Rotation.from_quat(pose["quaternion"][0]).as_matrix(), camera.rotation.T, atol=1e-12)
    np.testing.assert_allclose(pose["translation"][0], camera.position)
    lens = dict(images.zoom(recorded))[f"{recorded.path}/image"].image_from_camera.as_arrow_array().to_pylist()
    np.testing.assert_allclose(np.reshape(lens, (3, 3)).T, 1.1 * camera.matrix)
    still = dict(images.fixed(recorded, turns=False))
    assert set(still) - set(dict(images.fixed(recorded, turns=True))) == {recorded.path}


def test_undistorted_pixels_are_projections_without_distortion():
    camera = replace(plain_camera(640, 480, 600.0, (0.0, -4.0, 1.0), (0.0, 0.0, 1.0)), distortion=LENS)
    points = joints(BODY.skeleton, random_pose()[None])[0]
    expected = replace(camera, distortion=np.zeros(5)).project(points)
    assert images.undistorted(camera, camera.project(points)) == pytest.approx(expected, abs=0.02)  # five iterations
    assert images.undistorted(camera, np.empty((0, 2))).shape == (0, 2)
