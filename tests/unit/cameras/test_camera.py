"""The camera against OpenCV and by geometry, and its calibration files."""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.cameras.camera import Camera, plain_camera
from workbench.cameras.camera_file import load_cameras
from workbench.cameras.triangulation import ray_distances
from workbench.utils.errors import InputError

GOOD = """
[cam]
name = "cam_01"
size = [640.0, 480.0]
matrix = [[500.0, 0.0, 320.0], [0.0, 510.0, 240.0], [0.0, 0.0, 1.0]]
distortions = [-0.1, 0.02, 0.001, -0.002]
rotation = [1.2, -0.4, 0.3]
translation = [0.1, 0.2, 3.0]
fisheye = false

[metadata]
adjusted = false
"""


def random_camera(seed):
    rng = np.random.default_rng(seed)
    matrix = np.array([[500.0 + seed, 0.0, 310.0], [0.0, 520.0, 250.0], [0.0, 0.0, 1.0]])
    distortion = np.array([-0.3, 0.1, 0.002, -0.003, 0.02]) * rng.uniform(-1.0, 1.0, 5)
    rotation = Rotation.random(rng=rng).as_matrix()
    return Camera("random", 640, 480, matrix, rotation, rng.normal(size=3), distortion)


@pytest.mark.parametrize("seed", range(3))
def test_projection_agrees_with_opencv(seed):
    camera, rng = random_camera(seed), np.random.default_rng(100 + seed)
    depths = rng.uniform(0.5, 9.0, (200, 1))
    points = depths * np.concatenate([rng.uniform(-0.6, 0.6, (200, 2)), np.ones((200, 1))], axis=1)
    world = (points - camera.translation) @ camera.rotation
    expected, _ = cv2.projectPoints(
        world, cv2.Rodrigues(camera.rotation)[0], camera.translation, camera.matrix, camera.distortion
    )
    np.testing.assert_allclose(camera.project(world), expected[:, 0], rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(camera.to_camera(world), points, atol=1e-12)


@pytest.mark.parametrize("k1", [-0.35, -0.2, 0.2])
def test_the_distortion_of_wide_lenses_is_removed_to_the_corners(k1):
    """With x/z up to 0.8; the polynomial increases up to where 1 + 3 k1 r² is 0."""
    camera = replace(random_camera(0), distortion=np.array([k1, 0.1, 0.0, 0.0, 0.0]))
    rays = np.stack(np.meshgrid(*2 * [np.linspace(-0.8, 0.8, 21)]), axis=-1)
    pixels = camera.pixels(np.concatenate([rays, np.ones((21, 21, 1))], axis=-1), 0.0)
    np.testing.assert_allclose(camera.undistorted(pixels), rays, atol=1e-9)


def test_projection_keeps_leading_axes():
    camera, points = random_camera(0), np.random.default_rng(0).normal(size=(3, 4, 5, 3))
    np.testing.assert_array_equal(camera.project(points)[1, 2, 3], camera.project(points[1, 2, 3]))


def test_points_at_and_behind_the_camera_have_no_pixel():
    camera = plain_camera(100, 80, 90.0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    pixels = camera.project(np.array([[0.0, 0.0, 0.0], [-1.0, 0.1, 0.2], [0.0, 1.0, 1.0], [1.0, 0.0, 0.0]]))
    np.testing.assert_array_equal(np.isnan(pixels), [[True, True]] * 3 + [[False, False]])


@pytest.mark.parametrize("factor", [0.5, 0.25, 2.0])
def test_scaled_camera_follows_cv2_resize(factor):
    """After cv2.resize, a smooth blob at a point's pixel lies where the scaled camera projects the point."""
    camera = replace(random_camera(3), distortion=np.zeros(5))
    point = camera.rotation.T @ (np.array([0.21, -0.13, 2.0]) - camera.translation)
    y, x = np.mgrid[: camera.height, : camera.width]
    u, v = camera.project(point)
    blob = np.exp(-((x - u) ** 2 + (y - v) ** 2) / (2 * 12.0**2))
    scaled = camera.scaled(factor)
    method = cv2.INTER_AREA if factor < 1.0 else cv2.INTER_LINEAR
    resized = cv2.resize(blob, (scaled.width, scaled.height), interpolation=method)
    y, x = np.mgrid[: scaled.height, : scaled.width]
    centre = np.array([(x * resized).sum(), (y * resized).sum()]) / resized.sum()
    # a wrong pixel convention shifts the centre by half a pixel, the averaging of a Gaussian of 12 px by far less
    np.testing.assert_allclose(centre, scaled.project(point), rtol=0.0, atol=0.01)


def test_scaling_back_gives_the_same_camera():
    camera = random_camera(1)
    np.testing.assert_allclose(camera.scaled(0.5).scaled(2.0).matrix, camera.matrix, rtol=1e-14)
    assert (camera.scaled(0.5).width, camera.scaled(0.5).height) == (320, 240)


@pytest.mark.parametrize("target", [(3.0, -2.0, 1.5), (3.0, -2.0, 9.0), (3.0, -2.0, 0.0)])
def test_a_plain_camera_at_above_or_below_its_target_is_rejected(target):
    with pytest.raises(InputError, match="is at, above or below look_at"):
        plain_camera(64, 48, 50.0, (3.0, -2.0, 1.5), target)


def test_cameras_of_a_file(tmp_path):
    path = tmp_path / "calib.toml"
    path.write_text(GOOD)
    (camera,) = load_cameras(path)
    assert (camera.name, camera.width, camera.height) == ("cam_01", 640, 480)
    np.testing.assert_array_equal(camera.distortion, [-0.1, 0.02, 0.001, -0.002, 0.0])
    np.testing.assert_allclose(camera.rotation, Rotation.from_rotvec([1.2, -0.4, 0.3]).as_matrix(), atol=1e-14)
    np.testing.assert_array_equal(camera.translation, [0.1, 0.2, 3.0])


def test_size_and_distortions_may_be_absent_and_a_matrix_flat(tmp_path, caplog):
    path, lines = tmp_path / "calib.toml", GOOD.split("\n")
    rest = [line for line in lines if not line.startswith(("size", "distortions"))]
    path.write_text("\n".join(rest).replace("], [", ", ").replace("[[", "[").replace("]]", "]"))
    assert "[[" not in path.read_text()
    (camera,) = load_cameras(path)
    assert (camera.width, camera.height, camera.distortion.any()) == (0, 0, False)
    assert camera.matrix[1].tolist() == [0.0, 510.0, 240.0]
    assert "distortions" in caplog.text


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[cam]", "[cam", "expected TOML"),
        ("size = [640.0, 480.0]", "size = 640", "'size' must hold 2 numbers, found 640"),
        ("[0.0, 510.0, 240.0], ", "", "'matrix' must hold 3×3 numbers"),
        ("[-0.1, 0.02, 0.001, -0.002]", "[-0.1, 0.02]", "'distortions' must hold 1 or 4 or 5 or 8 or 12 or 14 numbers"),
        ("[1.2, -0.4, 0.3]", "[1.2, nan, 0.3]", "'rotation' must hold 3 or 3×3 numbers"),
        ("[1.2, -0.4, 0.3]", "[[1, 0, 0], [0, 1, 0], [0, 0, -1]]", "expected a rotation, found [[1, 0, 0], [0, 1, 0]"),
        ("[1.2, -0.4, 0.3]", "[[1.006, 0, 0], [0, 1, 0], [0, 0, 1]]", "expected a rotation, found [[1.006, 0, 0]"),
    ],
)
def test_malformed_camera_files_are_rejected(tmp_path, old, new, message):
    assert GOOD.count(old) == 1
    path = tmp_path / "calib.toml"
    path.write_text(GOOD.replace(old, new))
    with pytest.raises(InputError, match=re.escape(message)) as error:
        load_cameras(path)
    assert str(path) in str(error.value)


def test_a_rotation_matrix_may_be_rounded_to_three_places(tmp_path):
    (tmp_path / "c.toml").write_text(GOOD.replace("[1.2, -0.4, 0.3]", "[[1.004, 0, 0], [0, 1, 0], [0, 0, 1]]"))
    assert load_cameras(tmp_path / "c.toml")[0].rotation[0, 0] == 1.004


def test_missing_and_empty_camera_files_are_rejected(tmp_path):
    with pytest.raises(InputError, match="no such camera file"):
        load_cameras(tmp_path / "nothing.toml")
    (tmp_path / "empty.toml").write_text("[metadata]\n")
    with pytest.raises(InputError, match="found none"):
        load_cameras(tmp_path / "empty.toml")


def test_the_distance_of_two_rays_is_that_of_their_lines():
    across, up = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    slanted = np.array([0.0, 0.6, 0.8])
    a = np.array([across, across, across, [np.nan] * 3])
    b = np.array([up, slanted, across, up])
    distances = ray_distances(a, b, np.array([5.0, 2.0, 1.0]))
    # along y for the first; along (0, -0.8, 0.6) for the second; parallel; missing
    np.testing.assert_allclose(distances, [2.0, 1.0, np.nan, np.nan], rtol=1e-12)
