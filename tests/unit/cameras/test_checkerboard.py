"""Intrinsics and poses of cameras are recovered from checkerboards."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from rendered_boards import COLUMNS, ROWS, SQUARE_M, board_poses, lens, rendered

from workbench.cameras.camera_file import load_cameras, write_cameras
from workbench.cameras.checkerboard import (
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
def detected_corners():
    """Return the corners in the rendered images of one camera."""
    return tuple(find_corners(rendered(lens(), *pose), BOARD) for pose in board_poses())


def projected_detections(cameras, poses, name=""):
    """Return the projected corners of every camera, without images."""
    boards = [BOARD.corners_m @ rotation.T + translation for rotation, translation in poses]
    return [
        CheckerboardDetections(
            name, (camera.width, camera.height), len(poses), dict(enumerate(map(camera.project, boards)))
        )
        for camera in cameras
    ]


def second():
    """Return a camera 0.3 m to the right of the first, rotated inwards by 0.3 rad."""
    rotation = cv2.Rodrigues(np.array([0.05, 0.3, -0.1]))[0]
    return replace(lens("two", 650.0), rotation=rotation, translation=-rotation @ [0.3, 0.02, 0.05])


def third():
    """Return a camera 0.6 m to the right of the first, with twice the rotation of the second."""
    rotation = second().rotation @ second().rotation
    return replace(lens("three", 720.0), rotation=rotation, translation=-rotation @ [0.6, 0.04, 0.0])


def test_detected_corners_are_the_projected_ones():
    for corners, (rotation, translation) in zip(detected_corners(), board_poses(), strict=True):
        assert corners is not None
        expected = lens().project(BOARD.corners_m @ rotation.T + translation)
        assert np.sqrt(((corners - expected) ** 2).mean()) < 0.2


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_the_first_corner_is_identified_in_a_turned_image(quarters):
    """A quarter turn moves (x, y) of an image 640 px wide to (y, 639 - x), the next one of 480 px."""
    image, expected = rendered(lens(), *board_poses()[0]), detected_corners()[0]
    for k in range(quarters):
        expected = np.stack([expected[:, 1], (639, 479)[k % 2] - expected[:, 0]], axis=1)
    np.testing.assert_allclose(find_corners(np.rot90(image, quarters).copy(), BOARD), expected, atol=0.6)


@pytest.mark.parametrize(("rows", "columns"), [(1, -1), (-1, 1), (-1, -1)])
def test_the_first_corner_is_identified_in_every_order_of_the_detected_corners(rows, columns, monkeypatch):
    expected = detected_corners()[0]
    pixels = expected.reshape(ROWS, COLUMNS, 2)[::rows, ::columns].reshape(-1, 1, 2).astype(np.float32)
    monkeypatch.setattr(cv2, "findChessboardCornersSB", lambda *_, **__: (True, pixels))
    np.testing.assert_allclose(find_corners(rendered(lens(), *board_poses()[0]), BOARD), expected, atol=1e-4)


def test_a_lens_is_recovered_from_rendered_boards():
    detections = CheckerboardDetections("video", (640, 480), 10, dict(enumerate(detected_corners())))
    calibrated = calibrate_lens("one", detections, BOARD)
    assert calibrated.error_px < 0.2
    assert calibrated.camera.matrix[0, 0] == pytest.approx(700.0, abs=4.0 * calibrated.sigma_px + 1.0)
    np.testing.assert_allclose(calibrated.camera.matrix[:2, 2], [310.0, 245.0], atol=4.0)
    assert set(calibrated.errors_px) == set(range(10))


def test_distortion_is_recovered_from_projected_corners():
    distorted = replace(lens(), distortion=np.array([-0.2, 0.05, 0.001, -0.002, 0.0]))
    (detections,) = projected_detections([distorted], board_poses(12))
    calibrated = calibrate_lens("one", detections, BOARD).camera
    np.testing.assert_allclose(calibrated.matrix, distorted.matrix, atol=0.05)
    np.testing.assert_allclose(calibrated.distortion, distorted.distortion, atol=2e-3)


def test_an_image_with_outlying_corners_is_omitted():
    (detections,) = projected_detections([lens()], board_poses())
    detections.corners[4] = detections.corners[4] + np.random.default_rng(0).normal(
        0.0, 12.0, detections.corners[4].shape
    )
    calibrated = calibrate_lens("one", detections, BOARD)
    assert list(calibrated.omitted_px) == [4]
    assert calibrated.camera.matrix[0, 0] == pytest.approx(700.0, abs=0.5)


def test_cameras_without_a_common_board_are_posed_through_a_third():
    cameras = [lens(), second(), third()]
    detections = projected_detections(cameras, board_poses(12))
    for k in range(6):
        del detections[2].corners[k], detections[0].corners[11 - k]  # the first and the third have no common board
    posed, errors_px = pose_cameras(
        [replace(c, rotation=np.eye(3), translation=np.zeros(3)) for c in cameras], detections, BOARD
    )
    for camera, expected in zip(posed, cameras, strict=True):
        np.testing.assert_allclose(camera.rotation, expected.rotation, atol=1e-4)
        np.testing.assert_allclose(camera.translation, expected.translation, atol=1e-4)
    assert list(errors_px) == [("two", "one"), ("three", "two")]
    assert max(error for by_image in errors_px.values() for error in by_image.values()) < 1e-2


def test_a_board_on_the_floor_defines_the_ground_plane():
    cameras, (rotation, translation) = [lens(), second()], board_poses()[2]
    first, second_camera = place_on_floor(cameras, projected_detections(cameras, board_poses()), BOARD, 2)
    corner = BOARD.corners_m[-1]
    np.testing.assert_allclose(first.to_camera(TO_CHECKERBOARD @ corner), rotation @ corner + translation, atol=1e-6)
    assert first.position[2] > 0.3  # above the floor
    relative_rotation = second_camera.rotation @ first.rotation.T
    np.testing.assert_allclose(relative_rotation, second().rotation, atol=1e-9)


def test_a_level_camera_looks_along_x_with_z_up():
    (camera,) = place_level([lens()])
    np.testing.assert_allclose(camera.project(np.array([2.0, 0.0, 0.0])), [310.0, 245.0])
    assert camera.project(np.array([2.0, 0.0, 0.5]))[1] < 245.0
    assert camera.project(np.array([2.0, 0.5, 0.0]))[0] < 310.0


def test_written_cameras_are_read_back(tmp_path):
    cameras = [replace(lens(), distortion=np.array([-0.2, 0.05, 0.001, -0.002, 0.0])), second()]
    write_cameras(tmp_path / "c.toml", cameras, 0.25, {"up": 'a "floor" \\'})
    for read, written in zip(load_cameras(tmp_path / "c.toml"), cameras, strict=True):
        assert (read.name, read.width, read.height) == (written.name, written.width, written.height)
        np.testing.assert_array_equal(read.matrix, written.matrix)
        np.testing.assert_array_equal(read.distortion, written.distortion)
        np.testing.assert_allclose(read.rotation, written.rotation, atol=1e-12)
        np.testing.assert_array_equal(read.translation, written.translation)


def test_invalid_input_is_an_error(tmp_path):
    with pytest.raises(InputError, match="3×3 inner corners"):
        Checkerboard(2, 5, 0.05)
    with pytest.raises(InputError, match="squares of"):
        Checkerboard(9, 6, 25.0)
    with pytest.raises(InputError, match=r"found it in 2 of 10"):
        calibrate_lens(
            "one", CheckerboardDetections("f", (640, 480), 10, dict(enumerate(detected_corners()[:2]))), BOARD
        )
    symmetric_board = Checkerboard(7, 5, SQUARE_M)
    detections = projected_detections([lens(), second()], board_poses())
    with pytest.raises(InputError, match="distinguish its two ends"):
        pose_cameras([lens(), second()], detections, symmetric_board)
    with pytest.raises(InputError, match="videos are synchronized"):
        pose_cameras([lens(), second()], [detections[0], CheckerboardDetections("", (640, 480), 1, {})], BOARD)
    with pytest.raises(InputError, match="image 77 of at least one camera"):
        place_on_floor([lens()], detections[:1], BOARD, 77)
    with pytest.raises(InputError, match="empty: expected images"):
        find_checkerboards("empty", [], 0, BOARD)
    with pytest.raises(InputError, match="image 1 has another size than the first, 8×6 px"):
        find_checkerboards("two", [np.zeros((6, 8, 3), np.uint8), np.zeros((6, 9, 3), np.uint8)], 2, BOARD)
