"""Calibration files of OpenCV and ROS, against OpenCV's projection."""

import json

import cv2
import numpy as np
import pytest
import yaml
from valid_files import write_storage

from workbench.cameras import distortion
from workbench.cameras.camera_file import load_cameras, load_lenses
from workbench.utils.errors import InputError

MATRIX = np.array([[500.0, 0.0, 322.5], [0.0, 510.0, 238.25], [0.0, 0.0, 1.0]])
DISTORTION = np.array([-0.1, 0.02, 0.001, -0.002, 0.003])
RVEC, TVEC = np.array([1.2, -0.4, 0.3]), np.array([0.1, 0.2, 3.0])
TURN, SHIFT = cv2.Rodrigues(np.array([0.02, 0.3, -0.01]))[0], np.array([-0.25, 0.01, 0.02])
POSE = {"rvec": RVEC, "tvec": TVEC}


def write_opencv(path, matrix="camera_matrix", distortion="distortion_coefficients", coefficients=DISTORTION, **values):
    lens = {matrix: MATRIX, distortion: coefficients[None]}
    return write_storage(
        path, calibration_time="Mon 1 Jun", image_width=640, image_height=480, flags=0, **lens, **values
    )


def check_lens(camera):
    assert (camera.width, camera.height) == (640, 480)
    np.testing.assert_array_equal(camera.matrix, MATRIX)
    np.testing.assert_array_equal(camera.distortion, DISTORTION)


@pytest.mark.parametrize(
    ("suffix", "matrix", "distortion"),
    [
        ("yaml", "camera_matrix", "distortion_coefficients"),
        ("yml", "K", "dist_coeffs"),
        ("xml", "cameraMatrix", "distCoeffs"),
        ("json", "mtx", "dist"),
        ("YML", "camera_matrix", "distortion_coefficients"),
    ],
)
def test_a_file_of_opencv_gives_one_camera(tmp_path, suffix, matrix, distortion):
    path = write_opencv(tmp_path / f"cam.{suffix.lower()}", matrix, distortion, rvec=RVEC, tvec=TVEC[:, None])
    path = path.rename(tmp_path / f"cam.{suffix}")
    (camera,) = load_cameras(path)
    assert camera.name == "cam"
    check_lens(camera)
    np.testing.assert_allclose(camera.rotation, cv2.Rodrigues(RVEC)[0], atol=1e-14)
    np.testing.assert_array_equal(camera.translation, TVEC)
    assert load_lenses(path) == ()


@pytest.mark.parametrize(
    ("suffix", "matrix", "distortion", "labels", "names"),
    [
        ("yaml", "cameraMatrix{}", "distCoeffs{}", ("1", "2"), ["cam1", "cam2"]),
        ("xml", "M{}", "D{}", ("1", "2"), ["cam1", "cam2"]),
        ("yaml", "mtx{}", "dist{}", ("L", "R"), ["left", "right"]),
        ("xml", "{}_camera_matrix", "{}_distortion", ("left", "right"), ["left", "right"]),
        ("yaml", "K_{}", "dist_{}", ("cam0", "cam1"), ["cam0", "cam1"]),
    ],
)
def test_the_first_camera_of_a_stereo_pair_is_the_world(tmp_path, suffix, matrix, distortion, labels, names):
    rectification = {f"R{k}": TURN for k in (1, 2)} | {"Q": np.eye(4)}
    values = {matrix.format(label): MATRIX for label in labels[::-1]}
    values |= {distortion.format(label): DISTORTION for label in labels}
    path = write_storage(
        tmp_path / f"s.{suffix}", imageSize=(640, 480), **values, R=TURN, T=SHIFT[:, None], **rectification
    )
    first, second = load_cameras(path)
    assert [first.name, second.name] == names
    check_lens(first)
    check_lens(second)
    point = np.array([0.3, -0.2, 4.0])
    np.testing.assert_allclose(first.to_camera(point), point, atol=1e-12)
    np.testing.assert_allclose(second.to_camera(point), TURN @ point + SHIFT, atol=1e-12)


def camera_info(**changes):
    def matrix(rows, values):
        return {"rows": rows, "cols": len(values) // rows, "data": values}

    return {
        "image_width": 640, "image_height": 480, "camera_name": "narrow", "distortion_model": "plumb_bob",
        "camera_matrix": matrix(3, MATRIX.ravel().tolist()), "distortion_coefficients": matrix(1, DISTORTION.tolist()),
        "rectification_matrix": matrix(3, np.eye(3).ravel().tolist()), "projection_matrix": matrix(3, [1.0] * 12),
    } | changes  # fmt: skip


MESSAGE = """header:
  seq: 4
  frame_id: optical
height: 480
width: 640
distortion_model: plumb_bob
d: [-0.1, 0.02, 0.001, -0.002, 3e-3]
k: [500.0, 0.0, 322.5, 0.0, 510.0, 238.25, 0.0, 0.0, 1.0]
r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
p: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]
roi: {x_offset: 0, y_offset: 0, height: 0, width: 0, do_rectify: false}
---
"""


@pytest.mark.parametrize(
    ("text", "names"),
    [
        (yaml.safe_dump(camera_info()), ["narrow"]),
        (MESSAGE, ["c"]),
        (yaml.safe_dump({"cameras": [camera_info(), camera_info(camera_name="wide")]}), ["narrow", "wide"]),
        (yaml.safe_dump({"a": camera_info(camera_name=None), "notes": {"by": ["me"]}}), ["a"]),
        ("cam0: {camera_model: pinhole, distortion_model: radtan, resolution: [640, 480],\n  intrinsics: "
         "[500.0, 510.0, 322.5, 238.25],\n  distortion_coeffs: [-0.1, 0.02, 0.001, -0.002, 0.003]}\n", ["cam0"]),
    ],
)  # fmt: skip
def test_a_ros_file_gives_lenses_without_poses(tmp_path, text, names):
    (tmp_path / "c.yaml").write_text(text)
    lenses = load_lenses(tmp_path / "c.yaml")
    assert [lens.name for lens in lenses] == names
    for lens in lenses:
        check_lens(lens)
    with pytest.raises(InputError, match=r"\[\w+\] has no rotation and translation in the world"):
        load_cameras(tmp_path / "c.yaml")


def test_a_list_of_cameras_in_xml(tmp_path):
    storage = cv2.FileStorage(str(tmp_path / "c.xml"), cv2.FileStorage_WRITE)
    storage.startWriteStruct("cameras", cv2.FileNode_SEQ)
    for name in ("left", "right"):
        storage.startWriteStruct("", cv2.FileNode_MAP)
        for key, value in (("name", name), ("K", MATRIX), ("D", DISTORTION), ("width", 640), ("height", 480)):
            storage.write(key, value)
        storage.endWriteStruct()
    storage.endWriteStruct()
    storage.release()
    lenses = load_lenses(tmp_path / "c.xml")
    assert [lens.name for lens in lenses] == ["left", "right"]
    for lens in lenses:
        check_lens(lens)


@pytest.mark.parametrize("n", [4, 5, 8, 12, 14])
def test_all_lens_models_project_as_by_opencv(tmp_path, n):
    """The thin prism and the tilt are small, so that five coefficients suffice."""
    higher = np.array([0.01, 0.002, 0.001, 2e-4, 1e-4, 1e-4, 1e-4, 3e-4, 2e-4])
    coefficients = np.concatenate([DISTORTION, higher])[:n]
    (camera,) = load_cameras(write_opencv(tmp_path / "c.yml", coefficients=coefficients, **POSE))
    points = np.random.default_rng(0).uniform([-2.0, -1.5, 4.0], [2.0, 1.5, 6.0], (200, 3))
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), MATRIX, coefficients)[0][:, 0]
    pixels = camera.pixels(points, -np.inf)
    inside = ((expected >= 0.0) & (expected < [640.0, 480.0])).all(axis=1)
    assert inside.sum() > 50
    error_px = distortion.five_coefficients((640, 480), MATRIX, coefficients, False)[2] if n > 5 else 1e-9
    assert np.linalg.norm(pixels[inside] - expected[inside], axis=1).max() < 1.02 * error_px < 0.5


@pytest.mark.parametrize("declared", [{"fisheye_model": 1}, {"distortion_model": "equidistant"}])
def test_fisheye_lenses_project_as_by_opencv(tmp_path, declared):
    coefficients = np.array([-0.02, 0.004, -0.001, 0.0002])
    (camera,) = load_cameras(write_opencv(tmp_path / "c.yml", coefficients=coefficients, **POSE, **declared))
    points = np.random.default_rng(0).uniform([-1.0, -1.0, 1.0], [1.0, 1.0, 1.0], (500, 3))
    expected = cv2.fisheye.projectPoints(points[:, None], np.zeros(3), np.zeros(3), MATRIX, coefficients)[0][:, 0]
    inside = ((expected >= 0.0) & (expected <= [639.0, 479.0])).all(axis=1)
    errors_px = np.linalg.norm(camera.pixels(points[inside], -np.inf) - expected[inside], axis=1)
    assert errors_px.max() < 1.02 * distortion.five_coefficients((640, 480), MATRIX, coefficients, True)[2] < 0.5


def test_a_lens_is_fitted_up_to_every_side_of_the_image(monkeypatch):
    monkeypatch.setattr(distortion, "fitted_coefficients", lambda rays, pixels, matrix: (rays, pixels, matrix))
    rays, pixels, _ = distortion.five_coefficients((640, 480), MATRIX, np.zeros(4), False)
    np.testing.assert_allclose(rays @ MATRIX[:2, :2] + MATRIX[:2, 2], pixels)
    x, y = 639.0 * np.arange(9) / 8, 479.0 * np.arange(9) / 8
    border = [
        *((each, end) for each in x for end in (0.0, 479.0)),
        *((end, each) for each in y for end in (0.0, 639.0)),
    ]
    distances = np.linalg.norm(pixels - np.array(border)[:, None], axis=2).min(axis=1)
    assert distances.max() < 3.0 * 405.0 / 192.0  # a step of the radius, which reaches to three times that of a corner


def test_a_rational_lens_of_a_pair_without_image_size_is_approximated_about_its_principal_point(tmp_path):
    """OpenCV's sample stereo_calib writes 14 coefficients and no size."""
    coefficients = np.zeros(14)
    coefficients[[0, 1, 7]] = -0.3, -0.1, -0.4
    lenses = {f"{key}{k}": value for k in (1, 2) for key, value in (("M", MATRIX), ("D", coefficients[None]))}
    write_storage(tmp_path / "intrinsics.yml", **lenses)
    write_storage(tmp_path / "extrinsics.yml", R=TURN, T=SHIFT[:, None])
    first, second = load_cameras(tmp_path / "intrinsics.yml")
    np.testing.assert_array_equal(second.translation, SHIFT)
    points = np.random.default_rng(0).uniform([-2.0, -1.5, 4.0], [2.0, 1.5, 6.0], (200, 3))
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), MATRIX, coefficients)[0][:, 0]
    np.testing.assert_allclose(first.pixels(points, 0.0), expected, atol=0.25)


def test_lens_and_pose_may_be_in_mappings_of_their_own(tmp_path):
    lens = {"camera_matrix": MATRIX.tolist(), "distortion_coefficients": DISTORTION.tolist()}
    poses = {"a": {"rvec": RVEC.tolist(), "tvec": TVEC.tolist()}, "b": {"R": TURN.tolist(), "T": SHIFT.tolist()}}
    nested = {name: {"image_size": [640, 480], "intrinsics": lens, "extrinsics": pose} for name, pose in poses.items()}
    apart = {"intrinsics": {name: {**lens, "image_size": [640, 480]} for name in poses}, "extrinsics": poses}
    for content in (nested, apart):
        (tmp_path / "c.json").write_text(json.dumps(content))
        first, second = load_cameras(tmp_path / "c.json")
        check_lens(first)
        np.testing.assert_allclose(first.rotation, cv2.Rodrigues(RVEC)[0], atol=1e-14)
        np.testing.assert_array_equal(second.translation, SHIFT)


def test_a_file_without_distortion_has_none(tmp_path, caplog):
    path = tmp_path / "c.yaml"
    path.write_text(yaml.safe_dump(camera_info(distortion_coefficients=[])))
    assert not load_lenses(path)[0].distortion.any()
    assert "camera [narrow] has no distortion coefficients" in caplog.text


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("c.yaml", "camera_matrix: [1, 2", "expected YAML"),
        ("c.yaml", "a: {b: [1, 2]}\n", "expected a camera with a camera_matrix or K"),
        ("c.yaml", "- 3\n", "expected a camera with a camera_matrix or K"),
        ("c.yaml", yaml.safe_dump(camera_info(image_width=None)), "'size' must hold 2 numbers"),
        ("c.yaml", yaml.safe_dump(camera_info(camera_matrix=[1.0, 2.0])), "'matrix' must hold 3×3 numbers"),
        ("c.yaml", yaml.safe_dump(camera_info(distortion_coefficients=[1.0] * 7)), "4 or 5 or 8 or 12 or 14"),
        ("c.yaml", yaml.safe_dump(camera_info(distortion_model="omni")), "expected a lens model"),
        (
            "c.yaml",
            yaml.safe_dump([camera_info(), camera_info()]),
            "different names of the cameras, found 'narrow' twice",
        ),
        ("c.yaml", "K: !!python/object:os.system {}\n", "expected YAML"),
        ("c.xml", "<opencv_storage><K>", "expected XML"),
        ("c.xml", "<a>" * 60 + "</a>" * 60, "more than 50 nested levels"),
        ("c.xml", '<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "without entities"),
        ("c.json", "{", "expected JSON"),
    ],
)
def test_an_invalid_calibration_is_rejected_with_its_file(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message) as error:
        load_lenses(tmp_path / name)
    assert str(tmp_path / name) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("key", ["extrinsic", "RT", "extrinsics", "world_to_cam"])
@pytest.mark.parametrize("n_rows", [3, 4])
def test_a_pose_may_be_a_matrix_of_rotation_and_translation(tmp_path, key, n_rows):
    pose = np.eye(4)
    pose[:3] = np.column_stack([cv2.Rodrigues(RVEC)[0], TVEC])
    lens = {"K": MATRIX.tolist(), "dist": DISTORTION.tolist(), "image_size": [640, 480]}
    path = tmp_path / "a.json"
    path.write_text(json.dumps({"left": lens | {key: pose[:n_rows].tolist()}}))
    (camera,) = load_cameras(path)
    check_lens(camera)
    np.testing.assert_array_equal(camera.rotation, pose[:3, :3])
    np.testing.assert_array_equal(camera.translation, TVEC)
    path.write_text(json.dumps({"left": lens | {key: pose[:2].tolist()}}))
    with pytest.raises(InputError, match=r"a\.json: camera \[left\]"):
        load_cameras(path)
