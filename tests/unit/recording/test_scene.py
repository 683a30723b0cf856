"""What is drawn of a body: bones once each, solids where the limbs are, overlays where the camera sees them."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from workbench.body.camera import plain_camera
from workbench.body.kinematics import forward, joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES
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


def test_chains_cover_every_bone_once():
    chains = scene.figure(BODY).chains
    drawn = [(a, b) for chain in chains for a, b in pairwise(chain) if a != b]
    assert sorted(drawn) == sorted(map(tuple, BODY.skeleton.bones))


def test_solids_reach_from_head_to_ankles_of_a_standing_person():
    figure = scene.figure(BODY)
    frames = forward(BODY.skeleton, np.zeros((1, 25)))
    heights = frames.positions[0, figure.carriers, 2] + figure.centers[:, 2]
    shape = BODY.shape
    top = shape.neck[2] + shape.head[2] + shape.head_radius
    bottom = -shape.thigh - shape.calf - shape.calf_radii[1]
    assert (heights + figure.half_sizes[:, 2]).max() == pytest.approx(top)
    assert (heights - figure.half_sizes[:, 2]).min() == pytest.approx(bottom)


def test_solids_have_the_limbs_sections_and_stay_inside_their_ends():
    figure, limbs = scene.figure(BODY), BODY.limbs
    for i in range(len(limbs)):
        along = np.linspace(limbs.starts[i], limbs.ends[i], 101)
        mine = np.flatnonzero(
            (figure.carriers == limbs.joints[i])
            & (np.abs(figure.centers[:, None] - along).sum(axis=2).min(axis=1) < 0.01)
            & (figure.half_sizes[:, 0] <= limbs.radii[i, :, 0].max() + 1e-9)
        )
        assert len(mine)
        length = np.linalg.norm(limbs.ends[i] - limbs.starts[i])
        for e in mine if not limbs.spheres[i] else []:
            u = np.linalg.norm(figure.centers[e] - limbs.starts[i]) / length
            section = (1 - u) * limbs.radii[i, 0] + u * limbs.radii[i, 1]
            assert figure.half_sizes[e, :2] == pytest.approx(section)


def test_solids_move_with_their_joints():
    pose = random_pose()
    body = shown(scene.estimate(scene.figure(BODY), pose))["world/estimate/body"]
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


def test_heavier_particles_are_brighter():
    shades = scene.weight_colours(np.array([-1.0, -3.0, -7.0, -40.0, -np.inf])).astype(int).sum(axis=1)
    assert shades[0] > shades[1] > shades[2] == shades[3] == shades[4]


def test_overlays_lie_where_the_undistorted_camera_sees_the_joints():
    camera = plain_camera(640, 480, 600.0, (0.0, -4.0, 1.0), (0.0, 0.0, 1.0))
    picture = images.picture(replace(camera, distortion=LENS))
    positions = joints(BODY.skeleton, random_pose()[None])
    chains = scene.figure(BODY).chains
    (drawn,) = shown(images.overlay(picture, "estimate", positions, chains)).values()
    assert drawn["strips"] == pytest.approx(camera.project(positions)[0][chains], abs=1e-3)  # float32


def test_what_is_behind_the_camera_is_not_drawn():
    camera = plain_camera(640, 480, 600.0, (0.0, -4.0, 1.0), (0.0, 0.0, 1.0))
    pose = random_pose()
    pose[1] = -9.0
    positions = joints(BODY.skeleton, np.stack([pose, random_pose()]))
    shades = np.array([[10, 20, 30], [40, 50, 60]], dtype=np.uint8)
    chains = scene.figure(BODY).chains
    (drawn,) = shown(images.overlay(images.picture(camera), "particles", positions, chains, shades)).values()
    assert len(drawn["strips"]) == len(drawn["colors"]) == len(chains)
    assert {tuple(colour) for colour in drawn["colors"].tolist()} == {(40, 50, 60)}


def test_straightened_pixels_undo_the_lens():
    camera = replace(plain_camera(640, 480, 600.0, (0.0, -4.0, 1.0), (0.0, 0.0, 1.0)), distortion=LENS)
    points = joints(BODY.skeleton, random_pose()[None])[0]
    straight = replace(camera, distortion=np.zeros(5)).project(points)
    assert images.straightened(camera, camera.project(points)) == pytest.approx(straight, abs=0.02)  # five iterations
    assert images.straightened(camera, np.empty((0, 2))).shape == (0, 2)


def test_keypoints_are_drawn_where_they_are_and_vanish_in_the_next_frame():
    camera = images.picture(plain_camera(64, 48, 60.0, (0.0, -4.0, 1.0), (0.0, 0.0, 1.0), name="left"))
    given = np.full((len(JOINT_NAMES), 3), np.nan)
    given[2], given[5] = [10.0, 20.0, 1.0], [30.0, 40.0, 0.25]
    ((path, points),) = images.keypoints(camera, given, JOINT_NAMES)
    assert path == "/world/left/image/keypoints"
    np.testing.assert_array_equal(np.array(points.positions.as_arrow_array().to_pylist()), given[[2, 5], :2])
    sizes = np.abs(points.radii.as_arrow_array().to_pylist())
    assert sizes[1] == sizes[0] / 2.0
    assert points.labels.as_arrow_array().to_pylist() == [JOINT_NAMES[2], JOINT_NAMES[5]]
    ((_, none),) = images.keypoints(camera, None, JOINT_NAMES)
    assert len(none.positions.as_arrow_array()) == 0
