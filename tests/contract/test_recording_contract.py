"""What a run's recording holds, and when it is published."""

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
N_FRAMES = 13  # more than one flush, and a rest
CONFIG = "seed: 7\nprior:\n  sigma: 0.05  # ö\n"
PROVENANCE = {"seed": 7, "version": "0.1.0", "height_m": 1.75}
SETTINGS = {"seed": 7, "prior": {"sigma": 0.05, "name": "wide"}}


def recorder(path, run_id="a run", **options):
    given = {
        "config_yaml": CONFIG,
        "settings": SETTINGS,
        "provenance": PROVENANCE,
        **options,
    }
    return Recorder(path, BODY, SPACE, run_id=run_id, **given)


def record(path, run, **options):
    with recorder(path, **options) as recording:
        for step in run:
            recording.log(step, errors(step) if step.frame.truth is not None else {})
        recording.set_perturbations({"radius_calf": np.array([1.05, 0.95]), "camera_focal": np.array([1.002])})
        recording.set_result({"error_mm": 12.5, "frames": 13})
    return path


def log_all(recording, run):
    """Record steps without metrics; whatever is raised on the way is raised."""
    with recording:
        for step in run:
            if isinstance(step, BaseException):
                raise step
            recording.log(step, {})
    return recording.path


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
    ("/log", False, "TextLog:text"),
    ("/__properties/config", True, "TextDocument:text"),
    *[(f"/__properties/{name}", True, key)
      for name, key in (("run", "status"), ("provenance", "seed"), ("metrics", "error_mm"), ("marginals", "names"))],
]  # fmt: skip


def test_every_path_of_the_contract_is_there(recorded):
    found = components(recorded)
    missing = [row for row in CONTRACT if row[2] not in found.get(row[:2], set())]
    assert not missing


def test_times_are_the_frames_own(recorded, run):
    timelines = {name for chunk in RrdReader(recorded).stream() for name in chunk.timeline_names}
    assert timelines == {"frame", "time"}
    seen = column(recorded, "/world/estimate/joints", "time")
    for step in run:
        assert seen[step.frame.index] == round(step.frame.time_s * 1e9)
    assert seen == column(recorded, "/estimate/pose", "time")  # written one by one, and as a column


def test_poses_and_metrics_come_back_bit_for_bit(recorded, run):
    found = read(recorded)
    frames, poses = found.poses
    assert frames.tolist() == [step.frame.index for step in run]
    assert poses.tobytes() == np.stack([step.expected_pose for step in run]).tobytes()
    assert found.metric("ess")[1].tolist() == [step.ess for step in run]
    assert found.metric("error_mm")[1].tolist() == [errors(step)["error_mm"] for step in run]


def test_properties_come_back(recorded):
    found = read(recorded)
    assert found.config == CONFIG
    assert found.status == "complete"
    assert found.properties["provenance"] == PROVENANCE
    assert found.properties["metrics"] == {"error_mm": 12.5, "frames": 13.0}
    assert found.properties["settings"] == {"seed": 7.0, "prior.sigma": 0.05}
    assert found.properties["choices"] == {"prior.name": "wide"}
    assert found.properties["perturbations"] == {"radius_calf": [1.05, 0.95], "camera_focal": 1.002}
    assert tuple(found.properties["body"]["pose"]) == BODY.skeleton.dof_names
    assert found.properties["shape"]["torso_radii_low"] == list(BODY.shape.torso_radii_low)


def test_images_and_skeletons_are_those_of_the_step(recorded, run):
    blobs = column(recorded, "/world/camera/image", "EncodedImage:blob")
    places = column(recorded, "/world/estimate/joints", "Points3D:positions")
    for step in run[::4]:
        jpeg = np.array(blobs[step.frame.index][0], dtype=np.uint8)
        image = cv2.imdecode(jpeg, cv2.IMREAD_GRAYSCALE)
        difference = np.abs(image.astype(int) - step.frame.views[0].image)
        assert difference.mean() < 2.0  # grey levels; what JPEG at quality 80 does to mild noise
        expected = joints(BODY.skeleton, step.expected_pose[None])[0]
        assert np.array(places[step.frame.index]) == pytest.approx(expected, abs=1e-6)  # float32


def test_coefficients_sum_to_one_beside_their_model(recorded):
    values = column(recorded, "/coefficients/2", "BarChart:values")
    assert len(values) == N_FRAMES
    for (value,) in values.values():
        assert sum(value["buffer"]) == pytest.approx(1.0, abs=1e-9)


def test_warnings_are_recorded(recorded):
    assert values(recorded, "/log", "TextLog:text") == ["limb left_hand left the image"]


def test_the_viewer_tool_accepts_it_and_finds_a_blueprint(recorded):
    environment = {**os.environ, "RERUN_ANALYTICS": "false"}
    done = subprocess.run([RERUN, "rrd", "verify", recorded], capture_output=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    assert len(RrdReader(recorded).blueprints()) == 1  # the first warning came before anything was written


def test_published_only_when_the_run_ends_well_else_the_part_is_kept(run, tmp_path, caplog):
    with recorder(tmp_path / "well.rrd") as recording:
        recording.log(run[0], {})
        assert (recording.path.exists(), recording.part.exists()) == (False, True)
    assert (recording.path.exists(), recording.part.exists()) == (True, False)
    recording = recorder(tmp_path / "run.rrd")
    with caplog.at_level(logging.WARNING), pytest.raises(KeyboardInterrupt):
        log_all(recording, [*run[:3], KeyboardInterrupt()])
    assert not recording.path.exists()
    assert str(recording.part) in caplog.text
    found = read(recording.part)
    assert found.status == "interrupted"
    assert len(found.poses[0]) == len(found.marginals.frames) == 3


def pieces(path, entity="/estimate/pose"):
    """The frames of each piece in which something was written."""
    chunks = RrdReader(path).store().stream().filter(content=[entity]).to_chunks()
    tables = [chunk.to_record_batch() for chunk in chunks if not chunk.is_static]
    return sorted(table.column("frame").to_pylist() for table in tables)


@pytest.mark.parametrize(
    ("fraction", "most", "sizes"),
    [(0.0, 60, [2, 2, 2, 2, 2, 2, 1]), (0.5, 60, [2, 2, 4, 5]), (0.5, 3, [2, 2, 3, 3, 3])],
)
def test_a_run_is_written_at_intervals_of_time(run, tmp_path, monkeypatch, fraction, most, sizes):
    clock = [0.0]

    def one_a_second():
        for step in run:
            clock[0] += 1.0
            yield step

    monkeypatch.setattr(module, "monotonic", lambda: clock[0])
    monkeypatch.setattr(module, "FLUSH_S", 2.0)
    monkeypatch.setattr(module, "FLUSH_FRACTION", fraction)
    monkeypatch.setattr(module, "MAX_FLUSH_EVERY", most)
    path = record(tmp_path / "run.rrd", one_a_second())
    assert [len(frames) for frames in pieces(path)] == sizes
    shown = [frame for frames in pieces(path) for frame in frames]
    assert shown == [step.frame.index for step in run]


def test_large_images_do_not_wait_for_the_rest(run, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "MAX_FLUSH_EVERY", 5)
    monkeypatch.setattr(module, "MAX_BUFFERED_BYTES", 5000)
    path = record(tmp_path / "run.rrd", run)
    shown = pieces(path, "/world/camera/image")
    assert shown == [[step.frame.index] for step in run]
    assert [len(frames) for frames in pieces(path)] == [5, 5, 3]


@pytest.mark.parametrize("lost", [1, 40, 100_000])
def test_a_file_whose_end_did_not_reach_the_disk_is_not_published(run, tmp_path, monkeypatch, lost):
    def cut(path):
        os.truncate(path, path.stat().st_size - lost)
        return RrdReader(path)

    monkeypatch.setattr(file, "RrdReader", cut)
    with pytest.raises((RuntimeError, RerunWarning)):
        record(tmp_path / "run.rrd", run)
    assert not (tmp_path / "run.rrd").exists()


def test_a_disk_that_fills_up_ends_the_run_in_time(run, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "MAX_FLUSH_EVERY", 2)
    free = iter([10**9, 10**6])
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=next(free)))
    recording = recorder(tmp_path / "run.rrd")
    with pytest.raises(OSError, match=r"only 1\.0 MB"):
        log_all(recording, run)
    assert not recording.path.exists()
    found = read(recording.part)
    assert found.status == "failed"
    assert len(found.poses[0]) == 4


def test_two_recorders_in_one_process_do_not_mix(run, tmp_path):
    other = list(steps(4, n_particles=40, seed=1))
    # The same key with another type in the second run: neither run may bend the other's.
    with (
        recorder(tmp_path / "a.rrd", "a", provenance={"seed": 1}) as a,
        recorder(tmp_path / "b.rrd", "b", provenance={"seed": 2}) as b,
    ):
        for mine, theirs in zip(run[:4], other, strict=True):
            a.log(mine, {"error_mm": 1.0})
            b.log(theirs, {"score": 2.0})
        a.set_result({"final": 1})
        b.set_result({"final": 0.5})
    first, second = read(tmp_path / "a.rrd"), read(tmp_path / "b.rrd")
    assert first.poses[1].tolist() == [step.expected_pose.tolist() for step in run[:4]]
    assert second.poses[1].tolist() == [step.expected_pose.tolist() for step in other]
    assert "score" not in first.metric_names
    assert "error_mm" not in second.metric_names
    assert (first.properties["provenance"]["seed"], second.properties["provenance"]["seed"]) == (1, 2)
    assert (first.properties["metrics"]["final"], second.properties["metrics"]["final"]) == (1.0, 0.5)


def test_truth_that_ends_is_not_shown_any_longer(run, tmp_path):
    blind = replace(run[1], frame=replace(run[1].frame, truth=None))
    path = record(tmp_path / "run.rrd", [run[0], blind])
    for entity, name in (
        ("/world/truth/joints", "Points3D:positions"),
        ("/world/truth/skeleton", "LineStrips3D:strips"),
        ("/world/camera/image/truth", "LineStrips2D:strips"),
        ("/world/camera/image/annotations", "Points2D:positions"),
    ):
        shown = column(path, entity, name)
        assert shown[run[0].frame.index]
        assert shown[run[1].frame.index] == []


def test_missing_and_hidden_marks(run, tmp_path):
    marks = run[0].frame.truth.annotations.copy()
    marks[3] = np.nan
    visible = np.arange(len(marks)) != 5
    step = replace(run[0], frame=replace(run[0].frame, truth=Truth(annotations=marks, annotations_visible=visible)))
    path = log_all(recorder(tmp_path / "run.rrd"), [step])
    (points,), (colours,) = (
        values(path, "/world/camera/image/annotations", f"Points2D:{name}") for name in ("positions", "colors")
    )
    assert np.array(points) == pytest.approx(np.delete(marks, 3, axis=0), abs=1e-3)
    assert len(set(colours)) == 2
    assert colours.count(colours[4]) == 1  # joint 5, the fifth that is left


def test_images_of_a_bent_lens_are_straightened(tmp_path):
    bent = replace(CAMERA, distortion=np.array([-0.25, 0.05, 0.003, -0.002, 0.0]))
    (step,) = steps(1, n_particles=20, camera=bent)
    path = log_all(recorder(tmp_path / "run.rrd"), [step])
    straight = CAMERA.project(step.frame.truth.joints)
    (marks,) = column(path, "/world/camera/image/annotations", "Points2D:positions").values()
    assert np.array(marks) == pytest.approx(straight, abs=0.02)  # px; OpenCV inverts the lens in five iterations
    (blob,) = column(path, "/world/camera/image", "EncodedImage:blob").values()
    image = cv2.imdecode(np.array(blob[0], dtype=np.uint8), cv2.IMREAD_GRAYSCALE)
    u, v = np.rint(straight).astype(int).T
    assert (image[v, u] > 140).all()  # the drawn limbs, 165, lie where the straight camera sees them; ground 95


def test_colour_images_keep_their_colours(tmp_path):
    (step,) = steps(1, n_particles=20, colour=True)
    red = step.frame.views[0].image.copy()
    red[...] = (200, 60, 20)
    step = replace(step, frame=replace(step.frame, views=(replace(step.frame.views[0], image=red),)))
    path = log_all(recorder(tmp_path / "run.rrd"), [step])
    (blob,) = column(path, "/world/camera/image", "EncodedImage:blob").values()
    image = cv2.imdecode(np.array(blob[0], dtype=np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    assert image[240, 320] == pytest.approx([200, 60, 20], abs=4)  # JPEG's chroma


def test_several_cameras_each_get_an_entity(run, tmp_path):
    view = run[0].frame.views[0]
    views = tuple(replace(view, camera=replace(view.camera, name=name)) for name in ("left", "cam 2/b"))
    step = replace(run[0], frame=replace(run[0].frame, views=views))
    found = components(log_all(recorder(tmp_path / "run.rrd"), [step]))
    cameras = {entity for (entity, _), names in found.items() if "Pinhole:image_from_camera" in names}
    assert cameras == {"/world/left/image", "/world/cam\\ 2\\/b/image"}


def test_a_camera_may_not_take_another_things_place(run, tmp_path):
    view = run[0].frame.views[0]
    taken = replace(view, camera=replace(view.camera, name="truth"))
    step = replace(run[0], frame=replace(run[0].frame, views=(taken,)))
    with pytest.raises(InputError, match="truth"):
        log_all(recorder(tmp_path / "run.rrd"), [step])


@pytest.mark.parametrize(
    ("field", "value"), [("particles", np.nan), ("poses", np.inf), ("log_weights", np.nan), ("log_weights", 0.0)]
)
def test_particles_that_are_not_finite_or_not_normalised_are_refused(run, tmp_path, field, value):
    broken = getattr(run[1], field).copy()
    broken[3] = value
    recording = recorder(tmp_path / "run.rrd")
    with pytest.raises(ValueError, match="frame 11"):
        log_all(recording, [run[0], replace(run[1], **{field: broken})])
    assert len(read(recording.part).poses[0]) == 1


def test_a_path_that_cannot_be_written_is_told(tmp_path):
    (tmp_path / "run.rrd.part").mkdir()
    with pytest.raises(InputError, match=r"run\.rrd\.part"):
        log_all(recorder(tmp_path / "run.rrd"), [])


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_live_without_a_viewer_says_so_and_records(run, tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(file, "PORT", free_port())
    with caplog.at_level(logging.WARNING):
        path = record(tmp_path / "run.rrd", run[:2], stream=True)
    assert "no viewer listens" in caplog.text
    (sentence,) = values(path, "/log", "TextLog:text")
    assert str(file.PORT) in sentence
    assert read(path).status == "complete"


def test_the_file_does_not_wait_for_a_viewer_that_never_answers(run, tmp_path, monkeypatch, caplog):
    monkeypatch.setattr("workbench.recording.write.viewer.PATIENCE_S", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        monkeypatch.setattr(file, "PORT", listener.getsockname()[1])
        began = time.monotonic()
        with caplog.at_level(logging.WARNING):
            path = record(tmp_path / "run.rrd", run, stream=True)
    assert time.monotonic() - began < 40.0  # on a busy machine; it was for ever
    assert caplog.text.count("does not answer") == 1
    assert read(path).poses[1].tolist() == [step.expected_pose.tolist() for step in run]


def until(condition, seconds=30.0):
    """Wait until it holds; what cannot be read yet does not."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        with suppress(InputError):
            if condition():
                return
        time.sleep(0.2)
    pytest.fail("it never came to hold")


@pytest.mark.slow
def test_a_viewer_gets_what_the_file_gets_and_may_stop_in_the_middle(run, tmp_path, monkeypatch, caplog):
    port, given = free_port(), {"env": {**os.environ, "RERUN_ANALYTICS": "false"}, "stdout": -3, "stderr": -3}
    monkeypatch.setattr(file, "PORT", port)
    server_command = [RERUN, "--serve-grpc", "--bind", "127.0.0.1", "--port", str(port)]
    got, url = tmp_path / "got.rrd.part", f"rerun+http://127.0.0.1:{port}/proxy"
    save_command = [RERUN, url, "--bind", "127.0.0.1", "--port", str(free_port()), "--save", got]
    with subprocess.Popen(server_command, **given) as server:
        try:
            while not file.viewer_listens():
                assert server.poll() is None
            whole = record(tmp_path / "whole.rrd", run, run_id="whole", stream=True)
            assert not caplog.messages
            with subprocess.Popen(save_command, **given) as save:
                until(lambda: got.is_file() and read(got).poses[0].tolist() == read(whole).poses[0].tolist())
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
