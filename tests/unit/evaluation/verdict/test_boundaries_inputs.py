"""Findings on a run's cameras, keypoints and points on both sides of every threshold."""

from dataclasses import replace

import numpy as np
import pytest
from verdict_scenes import BODY, SIDES, N, level, point_scene, scene, walk

from workbench.body.kinematics import joints
from workbench.body.skeleton import JOINT_NAMES
from workbench.detections.association.keypoint_kalman import exchanged
from workbench.evaluation.verdict.knee_bends import bends

ONE, TWO, POINTS = (each.measurements() for each in (scene(1, 0.0), scene(2, 0.0), point_scene()))
LEFT_RIGHT = exchanged("shoulder", "elbow", "wrist", "hip", "knee", "ankle")


def with_keypoints(measured, change):
    """Return the measurements with other keypoints (V, N, J, 3), which a function changes in place."""
    keypoints = measured.observed.keypoints.copy()
    change(keypoints)
    return replace(measured, observed=replace(measured.observed, keypoints=keypoints))


@pytest.mark.parametrize(("n_joints", "expected"), [(6, "doubtful"), (7, "")])
def test_half_of_14_joints_are_observed(n_joints, expected):
    def change(keypoints):
        keypoints[:, :, 1 + n_joints :] = np.nan

    assert level(with_keypoints(ONE, change), "too few observations") == expected


@pytest.mark.parametrize(("n_frames", "expected"), [(29, "doubtful"), (30, "")])
def test_half_of_the_detected_joints_have_a_weight_of_03(n_frames, expected):
    def change(keypoints):
        keypoints[:, n_frames:, :, 2] = 0.29

    assert level(with_keypoints(ONE, change), "too few observations") == expected


@pytest.mark.parametrize(("n_frames", "expected"), [(29, "doubtful"), (30, "")])
def test_a_camera_has_keypoints_in_half_of_the_frames_that_show_the_person(n_frames, expected):
    def change(keypoints):
        keypoints[1, n_frames:] = np.nan

    assert N == 60
    assert level(with_keypoints(TWO, change), "inconsistent cameras") == expected


@pytest.mark.parametrize(("n_frames", "expected"), [(4, ""), (5, "doubtful")])
def test_a_camera_shows_the_person_in_five_frames(n_frames, expected):
    def change(keypoints):
        keypoints[1, :n_frames] = np.nan

    in_image = np.stack([np.ones(N, bool), np.arange(N) < n_frames], axis=1)
    assert level(replace(with_keypoints(TWO, change), in_image=in_image), "inconsistent cameras") == expected


@pytest.mark.parametrize(("n_joints", "shows"), [(7, False), (8, True)])
def test_more_than_half_of_15_joints_in_the_image_show_the_person(n_joints, shows):
    intact = replace(scene(1), poses=np.tile(walk()[:1], (N, 1)))
    (camera,), places = intact.cameras, intact.measurements().estimated_joints[0]
    lower, upper = np.sort(camera.project(places)[:, 1])[n_joints - 1 : n_joints + 1]
    cut = replace(intact, cameras=(replace(camera, height=int(np.ceil(0.5 * (lower + upper)))),))
    assert cut.measurements().in_image[0].tolist() == [shows]


def bent_legs(n_bent, n_exchanged):
    """Return measurements of a person with bent legs (of 2 N), of whom the sides are exchanged in some frames."""
    bent, poses = (np.arange(2 * N) < n_bent).reshape(N, 2), np.zeros((N, 25))
    poses[:, 2] = 0.9
    for side, is_bent in zip(SIDES, bent.T, strict=True):
        poses[:, BODY.skeleton.dof(f"{side}_knee_flexion")] = 0.6 * is_bent
        poses[:, BODY.skeleton.dof(f"{side}_hip_flexion")] = 0.3 * is_bent

    def change(keypoints):
        for v, camera in enumerate(TWO.observed.cameras):
            keypoints[v, ..., :2] = camera.project(joints(BODY.skeleton, poses))
        keypoints[:, :n_exchanged] = keypoints[:, :n_exchanged, LEFT_RIGHT]

    return with_keypoints(TWO, change)


@pytest.mark.parametrize(
    ("n_bent", "n_exchanged", "expected"),
    [(9, N, ""), (10, N, "not usable"), (100, 24, ""), (100, 26, "not usable"), (2 * N, 0, "")],
)
def test_half_of_ten_bent_legs_bend_forwards(n_bent, n_exchanged, expected):
    assert level(bent_legs(n_bent, n_exchanged), "left–right swap") == expected


@pytest.mark.parametrize(("offset", "is_bent"), [(0.099, False), (0.101, True)])
def test_a_leg_is_bent_from_a_tenth_of_its_length_on(offset, is_bent):
    person = joints(BODY.skeleton, np.zeros((1, 25)))
    for side in SIDES:
        hip, knee, ankle = (JOINT_NAMES.index(f"{side}_{name}") for name in ("hip", "knee", "ankle"))
        person[:, knee] = 0.5 * (person[:, hip] + person[:, ankle])
        person[:, knee, 0] += offset * np.linalg.norm(person[:, hip] - person[:, ankle])  # the person faces x
    np.testing.assert_allclose(bends(person), [offset] * 2 * is_bent)


def with_extents(*extent_m):
    return replace(POINTS, point_extent_m=np.tile(np.array(extent_m), (N, 1)))


@pytest.mark.parametrize(
    ("extent", "kind", "expected"),
    [
        (0.39, "height mismatch", "doubtful"), (0.41, "height mismatch", ""), (2.49, "height mismatch", ""),
        (2.51, "height mismatch", "doubtful"), (44.0, "unit of length", ""), (46.0, "unit of length", "not usable"),
        (239.0, "unit of length", "not usable"), (241.0, "unit of length", ""), (440.0, "unit of length", ""),
        (460.0, "unit of length", "not usable"), (2390.0, "unit of length", "not usable"),
        (2410.0, "unit of length", ""),
    ],
)  # fmt: skip
def test_points_extend_over_04_to_25_metres_or_are_in_another_unit(extent, kind, expected):
    assert level(with_extents(0.3 * extent, 0.3 * extent, extent), kind) == expected


@pytest.mark.parametrize(("ratio", "expected"), [(1.49, ""), (1.51, "doubtful")])
def test_points_of_an_upright_person_extend_15_times_as_far_to_the_side_as_up(ratio, expected):
    assert level(with_extents(ratio, 0.2, 1.0), "vertical") == expected


@pytest.mark.parametrize(("n_low", "n_high", "extent_m"), [(5, 5, 1.0), (6, 5, 3.0), (5, 6, 3.0)])
def test_a_twentieth_of_the_points_on_either_side_does_not_count(n_low, n_high, extent_m):
    points = np.zeros((N, 100, 3))
    points[..., 2] = np.linspace(0.0, 1.0, 100)
    points[:, :n_low, 2], points[:, 100 - n_high :, 2] = -2.0, 3.0
    assert replace(point_scene(), points=points).measurements().point_extent_m[0, 2] == pytest.approx(extent_m, abs=0.3)
