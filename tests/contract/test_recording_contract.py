"""The contract of a run's recording: its paths, its values and when it is published."""

import logging
import os
import shutil
import signal
import socket
import subprocess
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import rerun_cli
from recorded import column, components, values
from recording_steps import BODY, CAMERA, SPACE, errors, steps
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from workbench.body.kinematics import joints
from workbench.core.frame import Truth
from workbench.recording.read.reader import read
from workbench.recording.write import file
from workbench.recording.write import recorder as module
from workbench.recording.write.recorder import Recorder
from workbench.utils.errors import InputError

RERUN = Path(rerun_cli.__file__).with_name("rerun")
N_FRAMES = 13
CONFIG = "seed: 7\nprior:\n  sigma: 0.05  # ö\n"
PROVENANCE = {"seed": 7, "version": "0.1.0", "height_m": 1.75}
SETTINGS = {"seed": 7, "prior": {"sigma": 0.05, "name": "wide"}}


def recorder(path, run_id="a run", **options):
    defaults = {"config_yaml": CONFIG, "settings": SETTINGS, "provenance": PROVENANCE, **options}
    return Recorder(path, BODY, SPACE, run_id=run_id, **defaults)


def record(path, run, **options):
    with recorder(path, **options) as recording:
        for step in run:
            recording.log(step, errors(step) if step.frame.truth is not None else {})
        recording.set_perturbations({"radius_calf": np.array([1.05, 0.95]), "camera_focal": np.array([1.002])})
        recording.set_result({"error_mm": 12.5, "frames": 13})
    return path


def log_all(recording, run):
    """Record steps without metrics, raise the exceptions among them, and return the path."""
    with recording:
        for step in run:
            if isinstance(step, BaseException):
                raise step
            recording.log(step, {})
    return recording.path


@pytest.fixture(scope="module", autouse=True)
def _no_flush_by_time():
    """Frames and bytes cause a flush, and not the time, of which a busy machine needs more than FLUSH_S."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "FLUSH_S", np.inf)
        yield


@pytest.fixture(scope="module")
def run():
    return list(steps(N_FRAMES, n_particles=60))


@pytest.fixture(scope="module")
def recorded(run, tmp_path_factory):
    return record(tmp_path_factory.mktemp("recording") / "new folder" / "run.rrd", run)


CONTRACT = [
    ("/world", True, "ViewCoordinates:xyz"),
    ("/world/camera", True, "Transform3D:translation"),
    ("/world/camera", True, "Transform3D:mat3x3"),
    ("/world/camera/image", True, "Pinhole:image_from_camera"),
    ("/world/camera/image", False, "EncodedImage:blob"),
    ("/world/camera/image/annotations", False, "Points2D:positions"),
    ("/world/estimate/skeleton", False, "LineStrips3D:strips"),
    ("/world/estimate/joints", False, "Points3D:positions"),
    ("/world/estimate/joints", True, "Points3D:labels"),
    ("/world/estimate/body", False, "Ellipsoids3D:centers"),
    ("/world/estimate/body", True, "Ellipsoids3D:half_sizes"),
    ("/world/truth/skeleton", False, "LineStrips3D:strips"),
    ("/world/truth/joints", False, "Points3D:positions"),
    ("/world/particles", False, "LineStrips3D:strips"),
    ("/world/particles", False, "LineStrips3D:colors"),
    ("/posterior/marginals", True, "Tensor:data"),
    *[(f"/posterior/parameters/{name}/{row}", False, "Scalars:scalars")
      for name in (*SPACE.names, "left_knee_flexion") for row in ("mean", "low", "high")],
    ("/posterior/parameters/left_knee_flexion/truth", False, "Scalars:scalars"),
    ("/posterior/parameters/root_x/truth", False, "Scalars:scalars"),
    *[(f"/coefficients/{k}", False, "BarChart:values") for k in (1, 2, 3)],
    *[(f"/coefficients/{k}/model", True, "BarChart:values") for k in (1, 2, 3)],
    *[(f"/metrics/{name}", False, "Scalars:scalars")
      for name in ("error_mm", "error_relative_mm", "ess", "log_evidence", "visible_limbs")],
    ("/estimate/pose", False, "Scalars:scalars"),
    ("/estimate/draws", False, "Draws:poses"),
    ("/log", False, "TextLog:text"),
    ("/__properties/config", True, "TextDocument:text"),
    *[(f"/__properties/{name}", True, key)
      for name, key in (("run", "status"), ("provenance", "seed"), ("metrics", "error_mm"), ("marginals", "names"))],
]  # fmt: skip


def test_a_recording_has_every_path_of_the_contract(recorded):
    recorded_components = components(recorded)
    missing = [row for row in CONTRACT if row[2] not in recorded_components.get(row[:2], set())]
    assert not missing


def test_times_are_those_of_the_frames(recorded, run):
    timelines = {name for chunk in RrdReader(recorded).stream() for name in chunk.timeline_names}
    assert timelines == {"frame", "time"}
    times = column(recorded, "/world/estimate/joints", "time")
    for step in run:
        assert times[step.frame.index] == round(step.frame.time_s * 1e9)
    assert times == column(recorded, "/estimate/pose", "time")  # row by row and as a column


def test_poses_and_metrics_are_read_bitwise_identical(recorded, run):
    result = read(recorded)
    frames, poses = result.poses
    assert frames.tolist() == [step.frame.index for step in run]
    assert poses.tobytes() == np.stack([step.expected_pose for step in run]).tobytes()
    assert result.metric("ess")[1].tolist() == [step.ess for step in run]
    assert result.metric("error_mm")[1].tolist() == [errors(step)["error_mm"] for step in run]


def test_samples_of_the_motion_are_read_as_written_in_single_precision(recorded, run):
    expected = np.stack([step.draws for step in run], axis=1)
    assert read(recorded).draws.tobytes() == expected.astype(np.float32).astype(np.float64).tobytes()


def test_a_run_without_samples_of_the_motion_has_none(run, tmp_path):
    path = record(tmp_path / "run.rrd", [replace(step, draws=None) for step in run[:3]])
    assert read(path).draws is None
    assert not any("Draws:poses" in names for names in components(path).values())


def test_samples_of_the_motion_in_some_frames_only_are_rejected(run, tmp_path):
    path = record(tmp_path / "run.rrd", [run[0], replace(run[1], draws=None)])
    with pytest.raises(
        InputError, match=r"run\.rrd: expected samples of 25 numbers in 2 frames .*found 125 .*1 frames"
    ):
        _ = read(path).draws


def test_properties_are_read_as_written(recorded):
    result = read(recorded)
    assert result.config == CONFIG
    assert result.status == "complete"
    assert result.properties["provenance"] == PROVENANCE
    assert result.properties["metrics"] == {"error_mm": 12.5, "frames": 13.0}
    assert result.properties["settings"] == {"seed": 7.0, "prior.sigma": 0.05}
    assert result.properties["choices"] == {"prior.name": "wide"}
    assert result.properties["perturbations"] == {"radius_calf": [1.05, 0.95], "camera_focal": 1.002}
    assert tuple(result.properties["body"]["pose"]) == BODY.skeleton.dof_names
    assert result.properties["shape"]["torso_radii_low"] == list(BODY.shape.torso_radii_low)


def test_images_and_skeletons_are_those_of_the_step(recorded, run):
    blobs = column(recorded, "/world/camera/image", "EncodedImage:blob")
    positions = column(recorded, "/world/estimate/joints", "Points3D:positions")
    for step in run[::4]:
        jpeg = np.array(blobs[step.frame.index][0], dtype=np.uint8)
        image = cv2.imdecode(jpeg, cv2.IMREAD_GRAYSCALE)
        difference = np.abs(image.astype(int) - step.frame.views[0].image)
        assert difference.mean() < 2.0  # grey levels; the error of JPEG at quality 80 for this noise
        expected = joints(BODY.skeleton, step.expected_pose[None])[0]
        assert np.array(positions[step.frame.index]) == pytest.approx(expected, abs=1e-6)  # float32


def test_coefficient_histograms_sum_to_one(recorded):
    values = column(recorded, "/coefficients/2", "BarChart:values")
    assert len(values) == N_FRAMES
    for (value,) in values.values():
        assert sum(value["buffer"]) == pytest.approx(1.0, abs=1e-9)


def test_warnings_of_steps_are_recorded(recorded):
    assert values(recorded, "/log", "TextLog:text") == ["limb left_hand left the image"]


def test_the_rerun_command_verifies_the_recording(recorded):
    environment = {**os.environ, "RERUN_ANALYTICS": "false"}
    done = subprocess.run([RERUN, "rrd", "verify", recorded], capture_output=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    assert len(RrdReader(recorded).blueprints()) == 1  # although the first warning precedes the first flush


def test_a_recording_is_published_only_after_a_complete_run(run, tmp_path, caplog):
    with recorder(tmp_path / "complete.rrd") as recording:
        recording.log(run[0], {})
        assert (recording.path.exists(), recording.part.exists()) == (False, True)
    assert (recording.path.exists(), recording.part.exists()) == (True, False)
    recording = recorder(tmp_path / "run.rrd")
    with caplog.at_level(logging.WARNING), pytest.raises(KeyboardInterrupt):
        log_all(recording, [*run[:3], KeyboardInterrupt()])
    assert not recording.path.exists()
    assert str(recording.part) in caplog.text
    part = read(recording.part)
    assert part.status == "interrupted"
    assert len(part.poses[0]) == len(part.marginals.frames) == 3


def chunk_frames(path, entity="/estimate/pose"):
    """Return the frames of each chunk of an entity."""
    chunks = RrdReader(path).store().stream().filter(content=[entity]).to_chunks()
    tables = [chunk.to_record_batch() for chunk in chunks if not chunk.is_static]
    return sorted(table.column("frame").to_pylist() for table in tables)


@pytest.mark.parametrize(
    ("fraction", "max_frames", "sizes"),
    [(0.0, 60, [2, 2, 2, 2, 2, 2, 1]), (0.5, 60, [2, 2, 4, 5]), (0.5, 3, [2, 2, 3, 3, 3])],
)
def test_frames_are_flushed_at_time_intervals(run, tmp_path, monkeypatch, fraction, max_frames, sizes):
    clock = [0.0]

    def one_step_per_second():
        for step in run:
            clock[0] += 1.0
            yield step

    monkeypatch.setattr(module, "monotonic", lambda: clock[0])
    monkeypatch.setattr(module, "FLUSH_S", 2.0)
    monkeypatch.setattr(module, "FLUSH_FRACTION", fraction)
    monkeypatch.setattr(module, "MAX_FLUSH_EVERY", max_frames)
    path = record(tmp_path / "run.rrd", one_step_per_second())
    assert [len(frames) for frames in chunk_frames(path)] == sizes
    written = [frame for frames in chunk_frames(path) for frame in frames]
    assert written == [step.frame.index for step in run]


def test_large_images_are_flushed_before_the_other_columns(run, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "MAX_FLUSH_EVERY", 5)
    monkeypatch.setattr(module, "MAX_BUFFERED_BYTES", 5000)
    path = record(tmp_path / "run.rrd", run)
    assert chunk_frames(path, "/world/camera/image") == [[step.frame.index] for step in run]
    assert [len(frames) for frames in chunk_frames(path)] == [5, 5, 3]


@pytest.mark.parametrize("n_bytes", [1, 40, 100_000])
def test_a_truncated_file_is_not_published(run, tmp_path, monkeypatch, n_bytes):
    def truncated(path):
        os.truncate(path, path.stat().st_size - n_bytes)
        return RrdReader(path)

    monkeypatch.setattr(file, "RrdReader", truncated)
    with pytest.raises((RuntimeError, RerunWarning)):
        record(tmp_path / "run.rrd", run)
    assert not (tmp_path / "run.rrd").exists()


def test_a_nearly_full_disk_ends_the_run(run, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "MAX_FLUSH_EVERY", 2)
    free = iter([10**9, 10**6])
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=next(free)))
    recording = recorder(tmp_path / "run.rrd")
    with pytest.raises(OSError, match=r"only 1\.0 MB"):
        log_all(recording, run)
    assert not recording.path.exists()
    part = read(recording.part)
    assert part.status == "failed"
    assert len(part.poses[0]) == 4


def test_two_recorders_in_one_process_are_independent(run, tmp_path):
    other = list(steps(4, n_particles=40, seed=1))
    # The key has another type in the second run.
    with (
        recorder(tmp_path / "a.rrd", "a", provenance={"seed": 1}) as a,
        recorder(tmp_path / "b.rrd", "b", provenance={"seed": 2}) as b,
    ):
        for step_a, step_b in zip(run[:4], other, strict=True):
            a.log(step_a, {"error_mm": 1.0})
            b.log(step_b, {"score": 2.0})
        a.set_result({"final": 1})
        b.set_result({"final": 0.5})
    first, second = read(tmp_path / "a.rrd"), read(tmp_path / "b.rrd")
    assert first.poses[1].tolist() == [step.expected_pose.tolist() for step in run[:4]]
    assert second.poses[1].tolist() == [step.expected_pose.tolist() for step in other]
    assert "score" not in first.metric_names
    assert "error_mm" not in second.metric_names
    assert (first.properties["provenance"]["seed"], second.properties["provenance"]["seed"]) == (1, 2)
    assert (first.properties["metrics"]["final"], second.properties["metrics"]["final"]) == (1.0, 0.5)


def test_truth_is_cleared_in_a_frame_without_truth(run, tmp_path):
    without_truth = replace(run[1], frame=replace(run[1].frame, truth=None))
    path = record(tmp_path / "run.rrd", [run[0], without_truth])
    for entity, name in (
        ("/world/truth/joints", "Points3D:positions"),
        ("/world/truth/skeleton", "LineStrips3D:strips"),
        ("/world/camera/image/truth", "LineStrips2D:strips"),
        ("/world/camera/image/annotations", "Points2D:positions"),
    ):
        rows = column(path, entity, name)
        assert rows[run[0].frame.index]
        assert rows[run[1].frame.index] == []


def test_missing_annotations_are_omitted_and_occluded_ones_have_another_colour(run, tmp_path):
    annotations = run[0].frame.truth.annotations.copy()
    annotations[3] = np.nan
    visible = np.arange(len(annotations)) != 5
    truth = Truth(annotations=annotations, annotations_visible=visible)
    step = replace(run[0], frame=replace(run[0].frame, truth=truth))
    path = log_all(recorder(tmp_path / "run.rrd"), [step])
    (points,), (colours,) = (
        values(path, "/world/camera/image/annotations", f"Points2D:{name}") for name in ("positions", "colors")
    )
    assert np.array(points) == pytest.approx(np.delete(annotations, 3, axis=0), abs=1e-3)
    assert len(set(colours)) == 2
    assert colours.count(colours[4]) == 1  # joint 5, because joint 3 is missing


def test_images_of_a_distorted_camera_are_undistorted(tmp_path):
    distorted = replace(CAMERA, distortion=np.array([-0.25, 0.05, 0.003, -0.002, 0.0]))
    (step,) = steps(1, n_particles=20, camera=distorted)
    path = log_all(recorder(tmp_path / "run.rrd"), [step])
    undistorted = CAMERA.project(step.frame.truth.joints)
    (annotations,) = column(path, "/world/camera/image/annotations", "Points2D:positions").values()
    assert np.array(annotations) == pytest.approx(
        undistorted, abs=0.02
    )  # px; OpenCV inverts the distortion in 5 iterations
    (blob,) = column(path, "/world/camera/image", "EncodedImage:blob").values()
    image = cv2.imdecode(np.array(blob[0], dtype=np.uint8), cv2.IMREAD_GRAYSCALE)
    u, v = np.rint(undistorted).astype(int).T
    assert (image[v, u] > 140).all()  # the limbs have level 165, the background 95


def test_colour_images_keep_their_colours(tmp_path):
    (step,) = steps(1, n_particles=20, colour=True)
    view = step.frame.views[0]
    red = np.full_like(view.image, (200, 60, 20))
    step = replace(step, frame=replace(step.frame, views=(replace(view, image=red),)))
    path = log_all(recorder(tmp_path / "run.rrd"), [step])
    (blob,) = column(path, "/world/camera/image", "EncodedImage:blob").values()
    image = cv2.imdecode(np.array(blob[0], dtype=np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    assert image[240, 320] == pytest.approx([200, 60, 20], abs=4)  # the error of JPEG's chroma subsampling


def test_every_camera_has_an_entity(run, tmp_path):
    view = run[0].frame.views[0]
    views = tuple(replace(view, camera=replace(view.camera, name=name)) for name in ("left", "cam 2/b"))
    step = replace(run[0], frame=replace(run[0].frame, views=views))
    recorded = components(log_all(recorder(tmp_path / "run.rrd"), [step]))
    cameras = {entity for (entity, _), names in recorded.items() if "Pinhole:image_from_camera" in names}
    assert cameras == {"/world/left/image", "/world/cam\\ 2\\/b/image"}


def test_a_camera_with_a_reserved_name_is_rejected(run, tmp_path):
    view = run[0].frame.views[0]
    reserved = replace(view, camera=replace(view.camera, name="truth"))
    step = replace(run[0], frame=replace(run[0].frame, views=(reserved,)))
    with pytest.raises(InputError, match="truth"):
        log_all(recorder(tmp_path / "run.rrd"), [step])


@pytest.mark.parametrize(
    ("field", "value"), [("particles", np.nan), ("poses", np.inf), ("log_weights", np.nan), ("log_weights", 0.0)]
)
def test_non_finite_particles_and_unnormalised_weights_are_rejected(run, tmp_path, field, value):
    broken = getattr(run[1], field).copy()
    broken[3] = value
    recording = recorder(tmp_path / "run.rrd")
    with pytest.raises(ValueError, match="frame 11"):
        log_all(recording, [run[0], replace(run[1], **{field: broken})])
    assert len(read(recording.part).poses[0]) == 1


def test_a_path_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "run.rrd.part").mkdir()
    with pytest.raises(InputError, match=r"run\.rrd\.part"):
        log_all(recorder(tmp_path / "run.rrd"), [])


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_streaming_without_a_viewer_warns_and_records(run, tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(file, "PORT", free_port())
    with caplog.at_level(logging.WARNING):
        path = record(tmp_path / "run.rrd", run[:2], stream=True)
    assert "no viewer listens" in caplog.text
    (message,) = values(path, "/log", "TextLog:text")
    assert str(file.PORT) in message
    assert read(path).status == "complete"


def test_the_file_does_not_wait_for_an_unresponsive_viewer(run, tmp_path, monkeypatch, caplog):
    monkeypatch.setattr("workbench.recording.write.viewer.PATIENCE_S", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        monkeypatch.setattr(file, "PORT", listener.getsockname()[1])
        began = time.monotonic()
        with caplog.at_level(logging.WARNING):
            path = record(tmp_path / "run.rrd", run, stream=True)
    assert time.monotonic() - began < 40.0  # on a busy machine
    assert caplog.text.count("does not answer") == 1
    assert read(path).poses[1].tolist() == [step.expected_pose.tolist() for step in run]


def wait_for(condition, seconds=30.0):
    """Wait until the condition holds; an unreadable file counts as False."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        with suppress(InputError):
            if condition():
                return
        time.sleep(0.2)
    pytest.fail("the condition did not become true in time")


@pytest.mark.slow
def test_a_viewer_receives_the_recording_and_may_stop_during_a_run(run, tmp_path, monkeypatch, caplog):
    port, options = free_port(), {"env": {**os.environ, "RERUN_ANALYTICS": "false"}, "stdout": -3, "stderr": -3}
    monkeypatch.setattr(file, "PORT", port)
    server_command = [RERUN, "--serve-grpc", "--bind", "127.0.0.1", "--port", str(port)]
    saved, url = tmp_path / "saved.rrd.part", f"rerun+http://127.0.0.1:{port}/proxy"
    save_command = [RERUN, url, "--bind", "127.0.0.1", "--port", str(free_port()), "--save", saved]
    with subprocess.Popen(server_command, **options) as server:
        try:
            while not file.viewer_listens():
                assert server.poll() is None
            complete = record(tmp_path / "complete.rrd", run, run_id="complete", stream=True)
            assert not caplog.messages
            with subprocess.Popen(save_command, **options) as save:
                wait_for(lambda: saved.is_file() and read(saved).poses[0].tolist() == read(complete).poses[0].tolist())
                save.kill()
            with caplog.at_level(logging.WARNING), recorder(tmp_path / "run.rrd", stream=True) as recording:
                for step in run[:3]:
                    recording.log(step, {})
                server.send_signal(signal.SIGSTOP)
                for step in run[3:]:
                    recording.log(step, {})
                began = time.monotonic()
            assert time.monotonic() - began < 15.0
        finally:
            server.kill()
    assert caplog.text.count("does not answer") == 1
    assert read(recording.path).poses[1].tolist() == [step.expected_pose.tolist() for step in run]
