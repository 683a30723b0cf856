"""`workbench track` records and exports the person in a video, or reports missing input in one message."""

import json
import shutil
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from feet_scenes import side_camera, walker
from observed_walkers import camera_arc, walker_joints
from openpose_scenes import points, write

from workbench.body.kinematics import joints
from workbench.body.skeleton import FOOT_POINTS, JOINT_NAMES, JOINT_NAMES_WITH_FEET
from workbench.cameras.camera_file import load_cameras, write_cameras
from workbench.cli import track
from workbench.cli.main import main
from workbench.detections.detector import detection_files
from workbench.detections.detector.landmark_network import PersonLandmarks, Region
from workbench.motion.formats.markers import read_markers
from workbench.recording.read.reader import read
from workbench.utils.decode import count_frames


@pytest.fixture
def video(tmp_path):
    """A folder of grey images, and the detections of a walker in them, with the camera's file."""
    (camera,) = (camera.scaled(0.25) for camera in camera_arc(1))
    (tmp_path / "walk").mkdir()
    for t in range(8):
        cv2.imwrite(str(tmp_path / "walk" / f"{t:03d}.png"), np.full((camera.height, camera.width, 3), 90, np.uint8))
    pixels = camera.project(walker_joints()[:8]).tolist()
    people = [[points("BODY_25B", dict(zip(JOINT_NAMES, frame, strict=True)))] for frame in pixels]
    write(tmp_path / "keypoints", dict(enumerate(people)))
    write_cameras(tmp_path / "camera.toml", [camera], 0.0, {})
    return tmp_path / "walk"


@pytest.mark.slow
def test_a_video_is_recorded_and_exported(video, tmp_path, capsys):
    overrides = [f"dataset.keypoints={tmp_path / 'keypoints'}", "dataset.rate_hz=30", "training.motions=builtin"]
    assert main(["track", str(video), "--height", "1.75", "-o", str(tmp_path / "out"), *overrides]) == 0
    printed = capsys.readouterr().out
    assert "camera estimated" in printed
    assert printed.count("BODY_25B, 8 frames") == 1
    run = read(tmp_path / "out" / "run.rrd")
    assert len(run.poses[0]) == 8
    assert {path.suffix for path in (tmp_path / "out").iterdir()} >= {".rrd", ".json", ".trc", ".bvh", ".csv", ".mp4"}
    assert {"measures.csv", "angles.csv", "measures.html"} <= {path.name for path in (tmp_path / "out").iterdir()}
    assert (
        f"measured: ranges, speeds and repetitions of the joint angles: {tmp_path / 'out' / 'measures.html'}" in printed
    )
    assert count_frames(tmp_path / "out" / "overlay.mp4") == 8
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["status"] == "complete"


@pytest.mark.slow
@pytest.mark.parametrize("with_feet", [True, False])
def test_a_body_with_feet_is_recorded_and_exported(tmp_path, with_feet):
    """Ankles follow detected heels and toes; without them, exports have no feet."""
    times, body, poses = walker(24)
    camera, skeleton = side_camera().scaled(0.25), body.skeleton
    (tmp_path / "walk").mkdir()
    for t in range(len(times)):
        cv2.imwrite(str(tmp_path / "walk" / f"{t:03d}.png"), np.full((camera.height, camera.width, 3), 90, np.uint8))
    names = (*JOINT_NAMES, *FOOT_POINTS) if with_feet else JOINT_NAMES
    pixels = camera.project(joints(skeleton, poses)[:, [skeleton.joint(name) for name in names]]).tolist()
    people = [[points("BODY_25B", dict(zip(names, frame, strict=True)))] for frame in pixels]
    write(tmp_path / "keypoints", dict(enumerate(people)))
    write_cameras(tmp_path / "camera.toml", [camera], 0.0, {})
    overrides = [f"dataset.keypoints={tmp_path / 'keypoints'}", "dataset.rate_hz=30", "training.motions=builtin"]
    overrides += ["body.skeleton=feet", "--height", "1.7", "--camera", str(tmp_path / "camera.toml")]
    assert main(["track", str(tmp_path / "walk"), "-o", str(tmp_path / "out"), *overrides]) == 0
    run = read(tmp_path / "out" / "run.rrd")
    assert tuple(run.properties["body"]["joints"]) == JOINT_NAMES_WITH_FEET
    ankles = np.degrees(run.poses[1][:, 25:] - poses[:, 25:])
    assert (np.sqrt((ankles**2).mean()) < 5.0) == with_feet
    markers = read_markers(tmp_path / "out" / "person.trc")
    assert markers.names == names
    assert np.isfinite(markers.positions).all()
    assert main(["export", str(tmp_path / "out" / "run.rrd"), "-o", str(tmp_path / "walk.mot")]) == 0
    assert ("ankle_angle_r" in (tmp_path / "walk.mot").read_text()) == with_feet
    marked = [str(tmp_path / "out" / "run.rrd"), "-o", str(tmp_path / "tracked.csv"), "--min-state", "tracked"]
    assert main(["export", *marked]) == 0


def test_a_lens_calibration_is_used_with_the_persons_height(video, tmp_path, capsys):
    (camera,) = load_cameras(tmp_path / "camera.toml")
    storage = cv2.FileStorage(str(tmp_path / "lens.yml"), cv2.FileStorage_WRITE)
    for key, value in (("image_width", camera.width), ("image_height", camera.height), ("K", camera.matrix)):
        storage.write(key, value)
    storage.write("dist_coeffs", np.zeros(5))
    storage.release()
    arguments = ["--height", "1.75", "--camera", str(tmp_path / "lens.yml"), "-o", str(tmp_path / "out")]
    overrides = [f"dataset.keypoints={tmp_path / 'keypoints'}", "dataset.rate_hz=30", "training.motions=builtin"]
    assert main(["track", str(video), *arguments, *overrides]) == 0
    focal_px = f"{camera.matrix[0, 0]:.0f}"
    assert f"with the lens of {tmp_path / 'lens.yml'}: focal length {focal_px} " in capsys.readouterr().out
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert "height" in summary["assumptions"]
    assert "camera_calibration" not in summary["assumptions"]
    shutil.copytree(video, video.with_name("other"))
    with pytest.raises(SystemExit, match="2"):
        main(["track", str(video), str(video.with_name("other")), *arguments])
    assert "[lens] has no rotation and translation in the world" in capsys.readouterr().err


@pytest.mark.slow
def test_with_each_every_video_has_its_own_run_and_complete_runs_are_skipped(video, tmp_path, capsys):
    second = tmp_path / "walk, 2=b"
    video.with_name("walk").rename(second)
    shutil.copytree(second, video)
    videos = [str(video), str(second)]
    options = ["--each", "--camera", str(tmp_path / "camera.toml"), "-o", str(tmp_path / "out"), "dataset.n_frames=4"]
    keys = [f"dataset.keypoints={tmp_path / 'keypoints'}", "dataset.rate_hz=30", "training.motions=builtin"]
    keys += ["body=height", "body.height_m=1.75"]  # omits the fit of the limb lengths
    assert main(["track", *videos, *options, *keys]) == 0
    printed = capsys.readouterr()
    assert "camera estimated" not in printed.out
    assert "HYDRA" not in printed.out + printed.err
    runs = [read(tmp_path / "out" / job / "run.rrd") for job in ("0", "1")]
    assert [run.settings["dataset"]["source"] for run in runs] == [str(video), str(second)]
    assert all((tmp_path / "out" / job / "person.bvh").is_file() for job in ("0", "1"))
    before = (tmp_path / "out" / "0" / "run.rrd").stat().st_mtime_ns
    assert main(["track", *videos, *options, *keys, f"sweep.resume={tmp_path / 'out'}"]) == 0
    assert (tmp_path / "out" / "0" / "run.rrd").stat().st_mtime_ns == before


@pytest.fixture
def exported(monkeypatch):
    """Runs of `track` are replaced by a summary and their cameras; the names of the files they export."""
    written = []
    monkeypatch.setattr(track, "run", lambda arguments: 0)
    monkeypatch.setattr(track, "read_sound_run", lambda path: None)
    monkeypatch.setattr(track, "camera_names", lambda run: ["camera"])
    monkeypatch.setattr(track, "write_overlay", lambda run, path, camera, **_: written.append((path.name, camera)))
    monkeypatch.setattr(track, "_show_people", lambda folder: None)
    monkeypatch.setattr(track, "estimated_track", lambda run: SimpleNamespace(frames=[0, 1]))
    monkeypatch.setattr(track, "with_missing_frames", lambda motion: motion)
    monkeypatch.setattr(track, "export", lambda path, motion, metres: written.append((path.name, None)))
    monkeypatch.setattr(track, "_measure", lambda folder, run: None)
    return written


def summary(level):
    return lambda place: {"status": "complete", "verdict": {"level": level}}


MOTION = [(name, None) for name in ("person.trc", "person.bvh", "person.csv")]


@pytest.mark.parametrize("option", ["--each", "--everyone"])
@pytest.mark.parametrize(("level", "n_files"), [("doubtful", 3), ("not usable", 0)])
def test_in_a_sweep_the_motion_of_runs_that_are_not_usable_is_not_exported(
    option, level, n_files, video, tmp_path, exported, monkeypatch, capsys
):
    monkeypatch.setattr(track, "read_summary", summary(level))
    monkeypatch.setattr(track, "_people", lambda words: [0])
    assert main(["track", str(video), option, "-o", str(tmp_path / "out")]) == 0
    assert exported == [("overlay.mp4", "camera"), *MOTION[:n_files]]
    printed = capsys.readouterr().out
    assert (f"{tmp_path / 'out' / '0'}: not usable, so its motion is not exported" in printed) == (n_files == 0)


def test_a_run_that_is_not_usable_is_exported_if_it_is_the_only_one(video, tmp_path, exported, monkeypatch):
    monkeypatch.setattr(track, "read_summary", summary("not usable"))
    assert main(["track", str(video), "-o", str(tmp_path / "out")]) == 0
    assert exported == [("overlay.mp4", "camera"), *MOTION]


def test_a_single_frame_is_no_motion(video, tmp_path, exported, monkeypatch):
    monkeypatch.setattr(track, "read_summary", summary("doubtful"))
    monkeypatch.setattr(track, "estimated_track", lambda run: SimpleNamespace(frames=[0]))
    assert main(["track", str(video), "-o", str(tmp_path / "out")]) == 0
    assert exported == [("overlay.mp4", "camera")]


def test_every_camera_has_an_overlay(video, tmp_path, exported, monkeypatch):
    monkeypatch.setattr(track, "camera_names", lambda run: ["left", "right\\ 2"])
    monkeypatch.setattr(track, "read_summary", summary("trustworthy"))
    assert main(["track", str(video), "-o", str(tmp_path / "out")]) == 0
    assert exported[:2] == [("overlay_left.mp4", "left"), ("overlay_right 2.mp4", "right\\ 2")]


def test_everyone_who_is_detected_for_a_second_is_a_job_of_one_sweep(video, tmp_path, monkeypatch, capsys):
    """The sweep itself is replaced. At 8 frames/s the first person is seen for a second, the other for 7 frames."""
    (camera,) = load_cameras(tmp_path / "camera.toml")
    pixels = camera.project(walker_joints()[:8])
    both = [
        [points("BODY_25B", dict(zip(JOINT_NAMES, each.tolist(), strict=True))) for each in frame]
        for frame in ((one, np.add(one, [60.0, 0.0])) for one in pixels)
    ]
    write(tmp_path / "both", dict(enumerate([both[0][:1], *both[1:]])))
    words = []
    monkeypatch.setattr(track, "run", lambda arguments: words.extend(arguments) or 0)
    options = [f"dataset.keypoints={tmp_path / 'both'}", "-o", str(tmp_path / "out")]
    assert main(["track", str(video), "--everyone", *options, "dataset.rate_hz=8"]) == 0
    assert {"-m", "dataset.person=0"} <= set(words)
    words.clear()
    assert main(["track", str(video), "--everyone", *options, "dataset.rate_hz=7"]) == 0
    assert "dataset.person=0,1" in words
    assert main(["track", str(video), str(video), "--everyone"]) == 2


@pytest.mark.parametrize("arguments", [["none.mp4"], ["dataset.rate_hz=30"], ["one.mp4", "two.mp4"]])
def test_missing_input_is_reported_in_one_message(arguments, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name in ("one.mp4", "two.mp4"):
        (tmp_path / name).write_bytes(b"")
    assert main(["track", *arguments]) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_a_single_image_and_a_video_without_a_person_are_rejected(video, tmp_path, monkeypatch, capsys):
    no_person = PersonLandmarks(np.zeros((33, 2)), np.zeros(33), np.zeros((33, 3)), 0.0, Region(0.0, 0.0, 9.0))
    monkeypatch.setattr(detection_files, "LandmarkNetwork", lambda _: lambda image, region: no_person)
    (tmp_path / "model.tflite").write_bytes(b"model")
    overrides = ["--model", str(tmp_path / "model.tflite"), f"paths.cache={tmp_path / 'cache'}"]
    assert main(["track", str(video / "000.png"), *overrides]) == 2
    assert "workbench detect" in capsys.readouterr().err
    with pytest.raises(SystemExit) as raised:
        main(["track", str(video), "-o", str(tmp_path / "out"), *overrides, "dataset.rate_hz=30"])
    assert raised.value.code == 2
    message = capsys.readouterr().err
    assert f"{video}: expected a person" in message
    assert "8 frames" in message
