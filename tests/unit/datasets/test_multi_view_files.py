"""Videos, keypoints and calibrations in the formats of other programs: triangulated joints are the true ones."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from crowd_scenes import CAMERAS, walkers
from openpose_scenes import points, write
from video_files import video, with_durations

from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.calibration import camera_named
from workbench.cameras.camera_file import write_cameras
from workbench.cameras.triangulation import triangulate
from workbench.datasets.multi_view import MultiView
from workbench.detections.readers.formats import LAYOUTS
from workbench.utils.errors import InputError

N, FINE_HZ = 24, 3000.0
VIEWS = {name: camera.scaled(0.25) for name, camera in CAMERAS.items()}
SIZE = (320, 240)
JOINTS = [f"{side}_{part}" for side in ("left", "right") for part in ("elbow", "wrist", "hip", "knee", "ankle")]
ROWS = [JOINT_NAMES.index(name) for name in JOINTS]
(WALK,) = walkers([((-0.6, 0.1), (0.9, 0.1))], n_frames=int(1.5 * FINE_HZ), rate_hz=FINE_HZ)


def true_joints(times_s):
    return WALK[np.round(np.asarray(times_s) * FINE_HZ).astype(int)][:, ROWS]


def person(camera, time_s, layout="BODY_25"):
    pixels = camera.project(WALK[round(time_s * FINE_HZ)])
    return points(layout, dict(zip(JOINT_NAMES, pixels, strict=True)))


def times_of(n=N, rate_hz=30.0, late_s=0.0):
    return np.arange(n) / rate_hz + late_s


def scene(folder, times=None, cameras=VIEWS, people=person, size=SIZE, rates=None, sources=True, number=0):
    """Write videos, keypoints and a calibration; times : of the frames, s, by camera."""
    folder.mkdir(exist_ok=True)
    times = {name: times_of() for name in VIEWS} | (times or {})
    for name, camera in VIEWS.items():
        frames = {number + k: [people(camera, time_s)] for k, time_s in enumerate(times[name])}
        write(folder / "json" / name, frames)
        if sources:
            video(folder / f"{name}.mp4", len(times[name]), (rates or {}).get(name, 30.0), size)
    write_cameras(folder / "calib.toml", list(cameras.values()), 0.1, {})
    return folder


def dataset(folder, **options):
    defaults = {
        "sources": {name: str(folder / f"{name}.mp4") for name in VIEWS},
        "calibration_file": str(folder / "calib.toml"),
        "keypoints": {name: str(folder / "json" / name) for name in VIEWS},
    }  # fmt: skip
    return MultiView(**defaults | options)


def error_mm(dataset):
    """Return the mean error of the triangulated joints at the times of the frames, and the number of frames."""
    frames = list(dataset.frames())
    assert len(frames) == dataset.info.n_frames
    cameras = [view.camera for view in frames[0].views]
    pixels = np.array([[frame.views[v].keypoints[ROWS, :2] for frame in frames] for v in range(len(cameras))])
    distances = np.linalg.norm(triangulate(cameras, pixels) - true_joints([frame.time_s for frame in frames]), axis=2)
    assert np.isfinite(distances).mean() > 0.9
    return 1e3 * float(np.nanmean(distances)), len(frames)


def camera_positions(dataset):
    """Return the positions (V, 3), m, of a dataset's cameras; without keypoints the people are not tracked."""
    return [camera.position for camera in dataset.info.cameras]


TRUE_POSITIONS = pytest.approx(np.array([camera.position for camera in VIEWS.values()]))


def test_synchronous_videos_need_no_correction(tmp_path, caplog):
    error, n = error_mm(dataset(scene(tmp_path)))
    assert (error, n) == (pytest.approx(0.0, abs=0.5), N)
    assert not [record for record in caplog.records if record.levelname == "WARNING"]


def test_a_late_camera_is_synchronized_by_keypoints_or_by_an_option(tmp_path, caplog):
    n_frames = 36  # offsets are estimated in videos of at least one second
    folder = scene(tmp_path, {name: times_of(n_frames, late_s=0.1 if name == "left" else 0.0) for name in VIEWS})
    error, n_paired = error_mm(dataset(folder))
    assert error < 3.0
    assert n_frames - 4 <= n_paired <= n_frames
    assert "left: 0.1" in caplog.text
    assert error_mm(dataset(folder, offsets_s={"left": 0.1}))[0] < 0.5
    assert error_mm(dataset(folder, offsets_s={"left": 0.0}))[0] > 15.0
    with pytest.raises(InputError, match="no source for camera 'right'"):
        dataset(folder, offsets_s={"right": 0.1})
    with pytest.raises(InputError, match="expected times with frames of all cameras"):
        _ = dataset(folder, offsets_s={"left": 100.0}).info


@pytest.mark.parametrize("late", ["front", "back"])
def test_an_offset_of_a_fraction_of_a_frame_is_interpolated(tmp_path, late):
    folder = scene(tmp_path, {late: times_of(late_s=0.05)})
    assert error_mm(dataset(folder, offsets_s={late: 0.05}))[0] < 2.5
    assert error_mm(dataset(folder, offsets_s={}))[0] > 5.0


def test_cameras_of_different_rates_are_paired_by_time(tmp_path, caplog):
    rates = {"front": 30.0, "left": 29.97, "back": 60.0}
    times = {name: times_of(n, rates[name]) for name, n in (("front", N), ("left", N), ("back", 2 * N))}
    error, n = error_mm(dataset(scene(tmp_path, times, rates=rates)))
    assert error < 1.5
    assert n == N
    assert "paired by time" in caplog.text


def test_frames_of_variable_rates_have_the_times_of_the_files(tmp_path):
    durations = [1.0] * 12 + [2.0] * (N - 12)
    times = np.concatenate([[0.0], np.cumsum(durations)[:-1]]) / 30.0
    folder = scene(tmp_path, dict.fromkeys(VIEWS, times))
    for name in VIEWS:
        with_durations(folder / f"{name}.mp4", durations)
    assert error_mm(dataset(folder)) == (pytest.approx(0.0, abs=1.0), N)
    one_variable = scene(tmp_path / "one", {"left": times})
    with_durations(one_variable / "left.mp4", durations)
    error, _ = error_mm(dataset(one_variable))
    assert error < 8.0


@pytest.mark.parametrize("start", [0, 1, 10])
def test_images_and_keypoints_are_paired_by_number(tmp_path, start):
    folder = scene(tmp_path, sources=False, number=1)
    for name in VIEWS:
        (folder / name).mkdir()
        for k in range(N):
            cv2.imwrite(str(folder / name / f"cam2_{start + k:04d}.png"), np.zeros((SIZE[1], SIZE[0], 3), np.uint8))
        (folder / name / "._cam2_0001.png").write_bytes(b"\x00")
    sources = {name: str(folder / name) for name in VIEWS}
    assert error_mm(dataset(folder, sources=sources, rate_hz=30.0)) == (pytest.approx(0.0, abs=0.5), N)


def test_keypoints_numbered_from_1_begin_at_the_first_frame_of_a_video(tmp_path):
    folder = scene(tmp_path, number=1)
    (folder / "json" / "left" / f"shot_{N:012d}_keypoints.json").unlink()  # all cameras are numbered from 1
    assert error_mm(dataset(folder, n_frames=N - 1)) == (pytest.approx(0.0, abs=0.5), N - 1)
    assert error_mm(dataset(folder, first_frame=10, n_frames=5)) == (pytest.approx(0.0, abs=0.5), 5)


@pytest.mark.parametrize("low", [0.0, -1.0])
def test_coordinates_relative_to_the_image_are_scaled(tmp_path, low, caplog):
    def relative(camera, time_s):
        keypoints = person(camera, time_s)
        keypoints[:, :2] = low + (1.0 - low) * keypoints[:, :2] / np.array(SIZE)
        return np.where(keypoints[:, 2:] > 0.0, keypoints, 0.0)

    assert error_mm(dataset(scene(tmp_path, people=relative)))[0] < 0.5
    assert f"coordinates of {low:g} to 1" in caplog.text


def test_missing_coordinates_are_undetected_points(tmp_path):
    folder = scene(tmp_path)
    for name, missing in zip(VIEWS, (float("nan"), None, 0.0), strict=True):
        for file in sorted((folder / "json" / name).iterdir())[5:9]:
            content = json.loads(file.read_text())
            for knee in (10, 13):
                content["people"][0]["pose_keypoints_2d"][3 * knee : 3 * knee + 2] = [missing, missing]
            file.write_text(json.dumps(content))
        (folder / "json" / name / "._shot_000000000001_keypoints.json").write_bytes(b"\x00\x05\x16\x07")
        (folder / "json" / name / "metadata.json").write_text("{}")
    views = dataset(folder)
    knee = JOINT_NAMES.index("left_knee")
    detected = [[np.isfinite(view.keypoints[knee, 0]) for view in frame.views] for frame in views.frames()]
    assert detected == [[not 5 <= t < 9] * 3 for t in range(N)]
    assert error_mm(views)[0] < 0.5


@pytest.mark.parametrize("layouts", [list(LAYOUTS)[k : k + 3] for k in range(0, len(LAYOUTS), 3)], ids="-".join)
def test_every_layout_gives_the_same_person(tmp_path, layouts):
    """Every camera has another layout."""
    layout_of = dict(zip(VIEWS, layouts, strict=False))
    folder = scene(
        tmp_path, people=lambda camera, time_s: person(camera, time_s, layout_of.get(camera.name, layouts[0]))
    )
    assert error_mm(dataset(folder))[0] < 0.5


def test_a_layout_can_be_chosen(tmp_path):
    folder = scene(tmp_path)
    assert error_mm(dataset(folder, keypoint_layout="BODY_25"))[0] < 0.5
    correct, other = (
        next(dataset(folder, keypoint_layout=name, offsets_s={}, unit="m").frames()).views[0].keypoints
        for name in ("BODY_25", "BODY_25B")
    )
    assert not np.array_equal(correct, other, equal_nan=True)
    for layout, message in (("COCO_17", "COCO_17 has 17 points, found 25"), ("BODY", "expected one of ")):
        with pytest.raises(InputError, match=message):
            _ = dataset(folder, keypoint_layout=layout).info


@pytest.mark.parametrize(("factor", "unit"), [(100.0, "cm"), (1000.0, "mm")])
def test_the_unit_of_a_calibration_is_inferred_from_the_persons_height(tmp_path, factor, unit, caplog):
    cameras = {name: replace(camera, translation=factor * camera.translation) for name, camera in VIEWS.items()}
    folder = scene(tmp_path, cameras=cameras)
    assert error_mm(dataset(folder))[0] < 0.5
    assert f"lengths are taken for {unit}" in caplog.text
    for known_unit in (unit, 1.0 / factor):
        assert camera_positions(dataset(folder, unit=known_unit, keypoints={})) == TRUE_POSITIONS


def test_a_calibration_without_a_plausible_unit_is_an_error(tmp_path):
    cameras = {name: replace(camera, translation=10.0 * camera.translation) for name, camera in VIEWS.items()}
    folder = scene(tmp_path, cameras=cameras)
    with pytest.raises(InputError, match=r"a person is 1\d(\.\d)? units tall.*set dataset.unit to its metres, 0.1"):
        _ = dataset(folder).info
    assert camera_positions(dataset(folder, unit=0.1, keypoints={})) == TRUE_POSITIONS
    with pytest.raises(InputError, match=r"dataset.unit: expected m, cm, mm"):
        _ = dataset(folder, unit="inch").info


@pytest.mark.parametrize("factor", [0.5, 4.0])
def test_a_calibration_at_another_image_size_is_scaled(tmp_path, factor, caplog):
    folder = scene(tmp_path, cameras={name: camera.scaled(factor) for name, camera in VIEWS.items()})
    assert error_mm(dataset(folder))[0] < 0.5
    assert "its matrix is scaled" in caplog.text


def test_a_world_frame_of_the_first_camera_is_reported_and_rotated_by_an_option(tmp_path, caplog):
    front = VIEWS["front"]
    cameras = {
        name: replace(camera, rotation=camera.rotation @ front.rotation.T,
                      translation=camera.translation - camera.rotation @ front.rotation.T @ front.translation)
        for name, camera in VIEWS.items()
    }  # fmt: skip
    folder = scene(tmp_path, cameras=cameras)
    first = next(dataset(folder).frames())
    assert "set dataset.up=-y" in caplog.text
    assert first.views[0].camera.rotation == pytest.approx(np.eye(3))
    caplog.clear()
    rotated = next(dataset(folder, up="-y").frames())
    assert "dataset.up" not in caplog.text
    assert rotated.views[0].camera.rotation[1] == pytest.approx([0.0, 0.0, -1.0])  # down in the image
    with pytest.raises(InputError, match=r"dataset.up: expected one of x, -x"):
        _ = dataset(folder, up="up").info


def test_camera_names_match_up_to_symbols_and_case(tmp_path):
    first, second = list(VIEWS.values())[:2]
    cameras = [replace(first, name="Cam_01"), replace(second, name="Cam_02")]
    assert camera_named(cameras, "cam02", "rig.toml").name == "cam02"
    np.testing.assert_array_equal(camera_named(cameras, "cam02", "rig.toml").position, second.position)
    assert camera_named(cameras, "cam2", "rig.toml").name == "cam2"
    numbered = [replace(first, name="cam10"), replace(second, name="cam100")]
    np.testing.assert_array_equal(camera_named(numbered, "cam_0100", "rig.toml").position, second.position)
    with pytest.raises(InputError, match="expected one of Cam_01, Cam_02"):
        camera_named(cameras, "cam03", "rig.toml")
    ambiguous = [*cameras, replace(first, name="cam-01")]
    with pytest.raises(InputError, match="no camera called 'cam01'"):
        camera_named(ambiguous, "cam01", "rig.toml")
