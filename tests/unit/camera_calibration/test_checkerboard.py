"""Lenses and poses of cameras are recovered from rendered boards."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from rendered_boards import COLUMNS, ROWS, SQUARE_M, board_poses, lens, rendered

from workbench.body.camera import load_cameras
from workbench.camera_calibration.camera_file import write_cameras
from workbench.camera_calibration.checkerboard import (
    TO_CHECKERBOARD,
    Checkerboard,
    CheckerboardDetections,
    calibrate_lens,
    find_checkerboards,
    find_corners,
    place_level,
    place_on_floor,
    pose_cameras,
)
from workbench.utils.errors import InputError

BOARD = Checkerboard(COLUMNS, ROWS, 0.05)


@cache
def found():
    """Corners in the rendered images of one camera."""
    return tuple(find_corners(rendered(lens(), *pose), BOARD) for pose in board_poses())


def exact(cameras, poses, name=""):
    """Detections by projection alone, without images."""
    return [
        CheckerboardDetections(name, (camera.width, camera.height), len(poses), {
            k: camera.project(BOARD.corners_m @ turn.T + at) for k, (turn, at) in enumerate(poses)
        }) for camera in cameras
    ]  # fmt: skip


def second():
    """A camera 0.3 m to the right of the first, turned inwards by 0.3 rad."""
    turn = cv2.Rodrigues(np.array([0.05, 0.3, -0.1]))[0]
    return replace(lens("two", 650.0), rotation=turn, translation=-turn @ [0.3, 0.02, 0.05])


def third():
    """A camera twice as far to the right, turned by twice as much."""
    turn = second().rotation @ second().rotation
    return replace(lens("three", 720.0), rotation=turn, translation=-turn @ [0.6, 0.04, 0.0])


def test_corners_of_rendered_boards_are_found_where_they_are_projected():
    for corners, (turn, at) in zip(found(), board_poses(), strict=True):
        assert corners is not None
        expected = lens().project(BOARD.corners_m @ turn.T + at)
        assert np.sqrt(((corners - expected) ** 2).mean()) < 0.2


def test_the_first_corner_is_the_same_whichever_way_up_the_board_is_held():
    turn, at = board_poses()[0]
    upright, turned = found()[0], find_corners(rendered(lens(), turn, at, upside_down=True), BOARD)
    np.testing.assert_allclose(turned, upright[::-1], atol=0.6)


def test_a_lens_is_recovered_from_rendered_boards():
    seen = CheckerboardDetections("film", (640, 480), 10, dict(enumerate(found())))
    calibrated = calibrate_lens("one", seen, BOARD)
    assert calibrated.error_px < 0.2
    assert calibrated.camera.matrix[0, 0] == pytest.approx(700.0, abs=4.0 * calibrated.sigma_px + 1.0)
    np.testing.assert_allclose(calibrated.camera.matrix[:2, 2], [310.0, 245.0], atol=4.0)
    assert set(calibrated.errors_px) == set(range(10))


def test_distortion_is_recovered_exactly_from_exact_corners():
    bent = replace(lens(), distortion=np.array([-0.2, 0.05, 0.001, -0.002, 0.0]))
    (seen,) = exact([bent], board_poses(12))
    calibrated = calibrate_lens("one", seen, BOARD).camera
    np.testing.assert_allclose(calibrated.matrix, bent.matrix, atol=0.05)
    np.testing.assert_allclose(calibrated.distortion, bent.distortion, atol=2e-3)


def test_an_image_with_a_wrong_board_is_omitted():
    (seen,) = exact([lens()], board_poses())
    seen.corners[4] = seen.corners[4] + np.random.default_rng(0).normal(0.0, 12.0, seen.corners[4].shape)
    calibrated = calibrate_lens("one", seen, BOARD)
    assert list(calibrated.omitted_px) == [4]
    assert calibrated.camera.matrix[0, 0] == pytest.approx(700.0, abs=0.5)


def test_cameras_are_posed_through_one_that_shares_a_board_with_both():
    cameras = [lens(), second(), third()]
    seen = exact(cameras, board_poses(12))
    for k in range(6):
        del seen[2].corners[k], seen[0].corners[11 - k]  # the first and the third share none
    placed, errors_px = pose_cameras(
        [replace(c, rotation=np.eye(3), translation=np.zeros(3)) for c in cameras], seen, BOARD
    )
    for camera, expected in zip(placed, cameras, strict=True):
        np.testing.assert_allclose(camera.rotation, expected.rotation, atol=1e-4)
        np.testing.assert_allclose(camera.translation, expected.translation, atol=1e-4)
    assert list(errors_px) == [("two", "one"), ("three", "two")]
    assert max(error for by_image in errors_px.values() for error in by_image.values()) < 1e-2


def test_a_board_on_the_floor_is_the_worlds_ground():
    cameras, (turn, at) = [lens(), second()], board_poses()[2]
    first, other = place_on_floor(cameras, exact(cameras, board_poses()), BOARD, 2)
    corner = BOARD.corners_m[-1]
    np.testing.assert_allclose(first.to_camera(TO_CHECKERBOARD @ corner), turn @ corner + at, atol=1e-6)
    assert first.position[2] > 0.3  # above the floor
    between = other.rotation @ first.rotation.T
    np.testing.assert_allclose(between, second().rotation, atol=1e-9)


def test_a_level_camera_looks_along_x_and_up_is_z():
    (camera,) = place_level([lens()])
    np.testing.assert_allclose(camera.project(np.array([2.0, 0.0, 0.0])), [310.0, 245.0])
    assert camera.project(np.array([2.0, 0.0, 0.5]))[1] < 245.0
    assert camera.project(np.array([2.0, 0.5, 0.0]))[0] < 310.0


def test_a_camera_file_is_read_back_to_the_last_bit(tmp_path):
    cameras = [replace(lens(), distortion=np.array([-0.2, 0.05, 0.001, -0.002, 0.0])), second()]
    write_cameras(tmp_path / "c.toml", cameras, 0.25, {"up": 'a "floor" \\'})
    for read, written in zip(load_cameras(tmp_path / "c.toml"), cameras, strict=True):
        assert (read.name, read.width, read.height) == (written.name, written.width, written.height)
        np.testing.assert_array_equal(read.matrix, written.matrix)
        np.testing.assert_array_equal(read.distortion, written.distortion)
        np.testing.assert_allclose(read.rotation, written.rotation, atol=1e-12)
        np.testing.assert_array_equal(read.translation, written.translation)


def test_bad_input_is_one_sentence(tmp_path):
    with pytest.raises(InputError, match="3×3 inner corners"):
        Checkerboard(2, 5, 0.05)
    with pytest.raises(InputError, match="squares of"):
        Checkerboard(9, 6, 25.0)
    with pytest.raises(InputError, match=r"found it in 2 of 10"):
        calibrate_lens("one", CheckerboardDetections("f", (640, 480), 10, dict(enumerate(found()[:2]))), BOARD)
    alike = Checkerboard(7, 5, SQUARE_M)
    seen = exact([lens(), second()], board_poses())
    with pytest.raises(InputError, match="distinguish its two ends"):
        pose_cameras([lens(), second()], seen, alike)
    with pytest.raises(InputError, match="videos are synchronized"):
        pose_cameras([lens(), second()], [seen[0], CheckerboardDetections("", (640, 480), 1, {})], BOARD)
    with pytest.raises(InputError, match="image 77 of at least one camera"):
        place_on_floor([lens()], seen[:1], BOARD, 77)
    with pytest.raises(InputError, match="no such video"):
        find_checkerboards(tmp_path / "none.mp4", BOARD)
