"""A right calibration fits, each wrong one is reported, and both are drawn where the camera projects them."""

from dataclasses import replace

import numpy as np
import pytest
from observed_walkers import HEIGHT_M, camera_arc, observed_joints, walker_joints

from workbench.body.camera import plain_camera
from workbench.camera_calibration.overlay import AXES, LEFT, draw_overlay
from workbench.evaluation.calibration_findings import check_calibration, stand_upright, triangulate


def turned(camera, degrees):
    """The camera in a world that is turned about x: its z is not up any more."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return replace(camera, rotation=camera.rotation @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]]))


def wrong(seen, height_m=HEIGHT_M):
    return " ".join(finding.message for finding in check_calibration(seen, height_m).findings if finding.is_problem)


def test_rays_of_exact_marks_meet_in_the_joints_also_through_a_bent_lens():
    cameras = tuple(replace(camera, distortion=np.array([-0.1, 0.02, 0.001, -0.001, 0.0])) for camera in camera_arc())
    seen = observed_joints(cameras, sigma_px=0.0)
    np.testing.assert_allclose(triangulate(cameras, seen.keypoints), walker_joints(), atol=1e-5)
    seen.keypoints[1:, 0, 3] = np.nan  # one camera is not enough
    assert np.isnan(triangulate(cameras, seen.keypoints)[0, 3]).all()


@pytest.mark.parametrize("n", [1, 2, 3])
def test_a_right_calibration_fits(n):
    check = check_calibration(observed_joints(camera_arc(n)), HEIGHT_M)
    assert check.level == "trustworthy", check.findings
    assert check.floor_m == pytest.approx(0.0, abs=0.08)


def test_cameras_that_are_exchanged_disagree():
    cameras = camera_arc(3)
    seen = observed_joints(cameras, true_cameras=(cameras[1], cameras[0], cameras[2]))
    assert "the videos of c0 and c1 are exchanged" in wrong(seen)
    assert check_calibration(seen, None).level == "not usable"


def test_a_camera_in_which_the_person_is_not_found_is_reported():
    seen = observed_joints(camera_arc(3))
    seen.keypoints[1] = np.nan
    assert "c1: the person in the other cameras is not found" in wrong(seen)
    seen.searched[1] = False
    assert wrong(seen) == ""


def test_a_wrong_unit_of_length_shows_in_the_legs():
    cameras = tuple(replace(camera, translation=1.5 * camera.translation) for camera in camera_arc(3))
    assert "2.5" in wrong(observed_joints(cameras, camera_arc(3)), None)
    assert "expected 1.70 m" in wrong(observed_joints(cameras, camera_arc(3)))


@pytest.mark.parametrize("n", [1, 3])
def test_a_world_whose_z_is_not_up_is_reported(n):
    cameras = camera_arc(n)
    findings = wrong(observed_joints([turned(camera, 90.0) for camera in cameras], cameras))
    assert "z is not up" in findings or "leans" in findings


def test_a_camera_that_rolls_by_30_degrees_makes_the_person_lean_by_about_as_much():
    (camera,) = camera_arc(1)
    c, s = np.cos(np.radians(30.0)), np.sin(np.radians(30.0))
    roll = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    rolled = replace(camera, rotation=roll @ camera.rotation, translation=roll @ camera.translation)
    assert "leans by 2" in wrong(observed_joints([rolled], [camera]))  # 25°: verticals of one image are not parallel


def test_a_camera_that_is_tilted_by_15_degrees_makes_the_floor_steep():
    (camera,) = (plain_camera(1280, 960, 900.0, (-7.0, 0.0, 1.4), (0.0, 0.0, 1.0)),)  # they walk away from it
    c, s = np.cos(np.radians(15.0)), np.sin(np.radians(15.0))
    tilt = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    tilted = replace(camera, rotation=tilt @ camera.rotation, translation=tilt @ camera.translation)
    assert wrong(observed_joints([camera])) == ""
    assert "floor" in wrong(observed_joints([tilted], [camera]))


def test_an_axis_far_from_the_middle_is_of_another_size():
    (camera,) = camera_arc(1)
    assert "another image size" in wrong(
        observed_joints([replace(camera, matrix=camera.matrix * [[2, 1, 2], [1, 2, 2], [1, 1, 1]])])
    )


def test_without_marks_nothing_is_judged():
    seen = observed_joints(camera_arc(2))
    empty = replace(seen, keypoints=seen.keypoints[:, :0])
    assert check_calibration(empty, None).level == "doubtful"


def test_the_place_of_an_upright_person_is_exact():
    (camera,) = camera_arc(1)
    feet = np.array([[0.5, 0.2, 0.1], [-1.0, 1.5, 0.1]])
    places = stand_upright(camera, camera.project(feet), camera.project(feet + np.array([0.0, 0.0, 1.6])), 1.6)
    np.testing.assert_allclose(places, feet, atol=1e-9)


def test_axes_and_marks_are_drawn_where_they_are_projected():
    camera = camera_arc(3)[0]  # from aside, so that no axis hides another
    seen = observed_joints([camera], sigma_px=0.0)
    picture = draw_overlay(camera, seen.images[0], seen.keypoints[0, 0], np.full((15, 3), np.nan), 0.0)
    assert picture.shape == (960, 1280, 3)
    for way, colour in zip(0.5 * np.eye(3), AXES.values(), strict=True):
        u, v = np.round(camera.project(way)).astype(int)
        near = picture[v - 3 : v + 4, u - 3 : u + 4].reshape(-1, 3)
        assert (near == colour).all(axis=1).any(), colour
    u, v = np.round(seen.keypoints[0, 0, 9, :2]).astype(int)  # the left hip
    around_hip = picture[v - 6 : v + 7, u - 6 : u + 7].reshape(-1, 3).astype(int)
    assert np.abs(around_hip - LEFT).sum(axis=1).min() < 60  # its edges are smoothed
