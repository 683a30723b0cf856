"""A correct calibration has no findings, wrong ones are reported, and overlays show the projections."""

from dataclasses import replace

import numpy as np
import pytest
from observed_walkers import HEIGHT_M, camera_arc, observed_joints

from workbench.cameras.calibration import unit_of_people
from workbench.cameras.calibration_findings import check_calibration, stand_upright
from workbench.cameras.overlay import AXES, LEFT, draw_overlay
from workbench.utils.errors import InputError

COLOURS = (255, 159, 28), (120, 255, 130)
"""Of joints and of keypoints."""


def tilted_world(camera, degrees):
    """Return the camera in a world that is rotated about x, so that its z axis is not vertical."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return replace(camera, rotation=camera.rotation @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]]))


def problems(observed, height_m=HEIGHT_M):
    """Return the messages of all problems as one text."""
    findings = check_calibration(observed, height_m).findings
    return " ".join(finding.message for finding in findings if finding.is_problem)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_a_correct_calibration_has_no_problems(n):
    check = check_calibration(observed_joints(camera_arc(n)), HEIGHT_M)
    assert check.level == "trustworthy", check.findings
    assert check.floor_m == pytest.approx(0.0, abs=0.08)


def test_exchanged_cameras_are_reported():
    cameras = camera_arc(3)
    observed = observed_joints(cameras, true_cameras=(cameras[1], cameras[0], cameras[2]))
    assert "the videos of c0 and c1 are exchanged" in problems(observed)
    assert check_calibration(observed, None).level == "not usable"


def test_a_camera_without_detections_of_the_person_is_reported():
    observed = observed_joints(camera_arc(3))
    observed.keypoints[1] = np.nan
    assert "c1: the person in the other cameras is not found" in problems(observed)
    observed.searched[1] = False
    assert problems(observed) == ""


@pytest.mark.parametrize("n", [1, 3])
def test_a_world_with_a_horizontal_z_axis_is_reported(n):
    cameras = camera_arc(n)
    text = problems(observed_joints([tilted_world(camera, 90.0) for camera in cameras], cameras))
    assert "z is not up" in text or "leans" in text


def test_a_calibration_without_keypoints_is_doubtful():
    observed = observed_joints(camera_arc(2))
    assert check_calibration(replace(observed, keypoints=observed.keypoints[:, :0]), None).level == "doubtful"


def test_the_position_of_an_upright_person_is_exact():
    (camera,) = camera_arc(1)
    feet = np.array([[0.5, 0.2, 0.1], [-1.0, 1.5, 0.1]])
    positions = stand_upright(camera, camera.project(feet), camera.project(feet + np.array([0.0, 0.0, 1.6])), 1.6)
    np.testing.assert_allclose(positions, feet, atol=1e-9)


def test_axes_and_keypoints_are_drawn_at_their_projections():
    camera = camera_arc(3)[0]  # a side view, in which no axis hides another
    observed = observed_joints([camera], sigma_px=0.0)
    overlay = draw_overlay(
        camera, observed.images[0], observed.keypoints[0, 0], np.full((15, 3), np.nan), 0.0, *COLOURS
    )
    assert overlay.shape == (960, 1280, 3)
    for end, colour in zip(0.5 * np.eye(3), AXES.values(), strict=True):
        u, v = np.round(camera.project(end)).astype(int)
        patch = overlay[v - 3 : v + 4, u - 3 : u + 4].reshape(-1, 3)
        assert (patch == colour).all(axis=1).any(), colour
    u, v = np.round(observed.keypoints[0, 0, 9, :2]).astype(int)  # the left hip
    hip_patch = overlay[v - 6 : v + 7, u - 6 : u + 7].reshape(-1, 3).astype(int)
    assert np.abs(hip_patch - LEFT).sum(axis=1).min() < 60  # the circle is antialiased


@pytest.mark.parametrize("share", [0.2, 0.5])
@pytest.mark.parametrize(("factor", "metres"), [(1.0, 1.0), (1000.0, 0.001)])
def test_a_unit_is_recognized_with_wrong_joints_in_every_camera(share, factor, metres):
    cameras, rng = camera_arc(), np.random.default_rng(0)
    pixels = observed_joints(cameras).pixels()
    wrong = rng.random(pixels.shape[:3]) < share
    pixels[wrong] = rng.uniform(0.0, [1280.0, 960.0], (wrong.sum(), 2))
    moved = [replace(camera, translation=factor * camera.translation) for camera in cameras]
    assert unit_of_people(moved, pixels, "rig.toml") == metres


def test_inverted_poses_are_recognized_by_the_rays_to_the_person():
    cameras = camera_arc()
    inverted = [replace(each, rotation=each.rotation.T, translation=each.position) for each in cameras]
    pixels = observed_joints(cameras).pixels()
    with pytest.raises(InputError, match=r"rig\.toml: the poses seem to be inverted: .*inverses, Rᵀ and -Rᵀ t"):
        unit_of_people(inverted, pixels, "rig.toml")
    exchanged = [cameras[1], cameras[0], *cameras[2:]]
    assert [unit_of_people(each, pixels, "rig.toml") for each in (cameras, exchanged)] == [1.0, 1.0]
