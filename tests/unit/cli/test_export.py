"""`workbench export` writes motion files from complete and partial recordings and rejects invalid input."""

import csv
import shutil
from dataclasses import replace

import numpy as np
import pytest
from recorded import record
from recording_steps import BODY, SPACE, steps, without_images

from workbench.body.kinematics import joints
from workbench.body.skeleton import JOINT_NAMES
from workbench.cli.main import main
from workbench.evaluation.verdict.joint_states import JOINT_GROUPS
from workbench.evaluation.verdict.run_measurements import MeasurementCollector
from workbench.evaluation.verdict.run_verdict import Verdict
from workbench.motion.formats.bvh import read_bvh
from workbench.motion.formats.markers import read_markers
from workbench.recording.write.recorder import Recorder
from workbench.utils.finding import Finding

N = 12  # more than one flush


def recorder(path):
    return Recorder(path, BODY, SPACE, run_id=path.name, config_yaml="", provenance={})


def without_truth(step):
    return replace(step, frame=replace(step.frame, truth=None))


@pytest.fixture(scope="module")
def run():
    """Steps without images, which no export reads."""
    return without_images(steps(N, n_particles=20))


@pytest.fixture(scope="module")
def recorded(run, tmp_path_factory):
    return record(tmp_path_factory.mktemp("export") / "run.rrd", run)


@pytest.fixture(scope="module")
def estimated(run):
    return joints(BODY.skeleton, np.stack([step.expected_pose for step in run]))


def exported(recording, output, *options):
    """Run the command and return its exit code."""
    return main(["export", str(recording), "-o", str(output), *options])


@pytest.mark.parametrize(("options", "unit"), [([], "cm"), (["--metres"], "m")])
def test_bvh_contains_the_estimate(recorded, estimated, tmp_path, capsys, options, unit):
    output = tmp_path / "OUT.BVH"
    assert exported(recorded, output, *options) == 0
    output_text = capsys.readouterr()
    assert output_text.err == ""
    assert output_text.out.startswith(f"{output}: 12 frames, 0.000 to 0.367 s; ")
    clip = read_bvh(output, unit)
    assert clip.rate_hz == 30.0
    np.testing.assert_allclose(clip.positions, estimated, atol=4e-6)  # six decimals of metres
    assert [path.name for path in tmp_path.iterdir()] == ["OUT.BVH"]


def test_trc_contains_the_estimate_or_the_truth(recorded, run, estimated, tmp_path):
    true = np.stack([step.frame.truth.joints for step in run])
    for options, expected in (([], estimated), (["--truth"], true)):
        assert exported(recorded, tmp_path / "out.trc", *options) == 0
        rows = np.loadtxt(tmp_path / "out.trc", skiprows=6)
        np.testing.assert_allclose(rows[:, 1], np.arange(N) / 30.0, atol=1e-9)
        # the recording has float32 joints
        np.testing.assert_allclose(
            rows[:, 2:].reshape(N, 15, 3)[..., [0, 2, 1]] * [1, -1, 1] / 1000.0, expected, atol=1e-6
        )
    assert np.abs(estimated - true).max() > 0.01  # estimate and truth can be distinguished


def test_csv_contains_frames_times_poses_and_intervals(recorded, run, tmp_path):
    output = tmp_path / "out.csv"
    assert exported(recorded, output, "--intervals") == 0
    with output.open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row, step in zip(rows, run, strict=True):
        assert (int(row["frame"]), float(row["time_s"])) == (step.frame.index, pytest.approx(step.frame.time_s))
        assert float(row["left_knee_flexion_rad"]) == pytest.approx(
            step.expected_pose[BODY.skeleton.dof("left_knee_flexion")], abs=1e-9
        )
        assert float(row["root_x_m"]) == float(row["pelvis_x_m"])
        assert float(row["left_knee_flexion_low"]) < float(row["left_knee_flexion_high"])


def test_c3d_and_mot_contain_the_estimate(recorded, run, estimated, tmp_path, capsys):
    assert exported(recorded, tmp_path / "out.C3D") == 0
    assert exported(recorded, tmp_path / "out.mot") == 0
    assert "x ahead where the world has x, as in OpenSim's models" in capsys.readouterr().out
    np.testing.assert_allclose(read_markers(tmp_path / "out.C3D").positions, estimated, atol=1e-6)
    labels, *rows = (tmp_path / "out.mot").read_text().split("endheader\n")[1].splitlines()
    knee = [float(row.split("\t")[labels.split("\t").index("knee_angle_l")]) for row in rows]
    expected = [np.degrees(step.expected_pose[BODY.skeleton.dof("left_knee_flexion")]) for step in run]
    assert knee == pytest.approx(expected, abs=1e-7)
    assert exported(recorded, tmp_path / "true.mot", "--truth") == 2
    assert "MOT requires joint angles" in capsys.readouterr().err


HIDDEN = ("right_elbow", "right_wrist")


def with_keypoints(path, likelihood):
    """Record steps that show no joint of HIDDEN: the wrist's keypoints lie outside the image or have a low weight."""
    run = []
    for step in steps(4, n_particles=20):
        (view,) = step.frame.views
        keypoints = np.column_stack([view.camera.project(step.frame.truth.joints), np.ones(15)])
        keypoints[JOINT_NAMES.index("right_elbow")] = np.nan
        keypoints[JOINT_NAMES.index("right_wrist")] = [-5.0, 100.0, 1.0] if step.frame.index < 12 else [9.0, 9.0, 0.1]
        run.append(replace(step, frame=replace(step.frame, views=(replace(view, keypoints=keypoints),))))
    return record(path, run, config_yaml=f"likelihood: {{_target_: {likelihood}}}\n")


def test_joints_without_keypoints_are_exported_as_missing(tmp_path, caplog):
    run = with_keypoints(tmp_path / "run.rrd", "workbench.likelihoods.keypoints.KeypointLikelihood")
    for suffix in (".trc", ".c3d", ".csv"):
        assert exported(run, tmp_path / f"out{suffix}") == 0
        markers = read_markers(tmp_path / f"out{suffix}")
        hidden = np.isin(markers.names, HIDDEN)
        assert np.isnan(markers.positions[:, hidden]).all()
        assert np.isfinite(markers.positions[:, ~hidden]).all()
    assert caplog.text.count("no keypoint shows right_elbow, right_wrist in any frame") == 3
    with (tmp_path / "out.csv").open(newline="") as file:
        (row, *_) = csv.DictReader(file)
    empty = {name for name, cell in row.items() if cell == ""}
    arm = ("shoulder_abduction", "shoulder_flexion", "shoulder_twist", "elbow_flexion")
    assert empty == {f"{joint}_{axis}_m" for joint in HIDDEN for axis in "xyz"} | {f"right_{name}_rad" for name in arm}
    assert exported(run, tmp_path / "out.mot") == 0
    labels = (tmp_path / "out.mot").read_text().split("endheader\n")[1].splitlines()[0].split("\t")
    assert {"arm_flex_l", "hip_flexion_r"} <= set(labels)
    assert not {"arm_flex_r", "arm_add_r", "arm_rot_r", "elbow_flex_r"} & set(labels)
    assert exported(run, tmp_path / "out.bvh") == 0
    assert np.isfinite(read_bvh(tmp_path / "out.bvh").positions).all()


def test_the_written_frames_of_an_incomplete_run_are_exported(run, tmp_path, capsys, recwarn, monkeypatch):
    monkeypatch.setattr("workbench.recording.write.recorder.FLUSH_S", np.inf)
    monkeypatch.setattr("workbench.recording.write.recorder.MAX_FLUSH_EVERY", 3)
    with recorder(tmp_path / "run.rrd") as recording:
        for step in run[:11]:
            recording.log(step, {})
        running = shutil.copy(recording.part, tmp_path / "running.rrd.part")

    def interrupted():
        yield from run[:4]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        record(tmp_path / "interrupted.rrd", interrupted())
    for part, status, n in (
        (running, "running", 9),  # three flushes
        (tmp_path / "interrupted.rrd.part", "interrupted", 4),
    ):
        for options in ([], ["--truth"]):
            assert exported(part, tmp_path / "out.csv", *options) == 0
            assert capsys.readouterr().err == f"{part}: the run is not complete (status: {status})\n"
            rows = np.loadtxt(tmp_path / "out.csv", skiprows=1, delimiter=",")
            assert rows[:, 0].tolist() == [step.frame.index for step in run[:n]]
    assert len(recwarn) == 0


def test_unreadable_recordings_and_invalid_outputs_are_rejected(recorded, run, tmp_path, capsys):
    output, junk = tmp_path / "out.bvh", tmp_path / "junk.rrd"
    (tmp_path / "folder.trc").mkdir()
    output.write_text("existing")
    junk.write_bytes(b"no recording" * 100)
    empty = record(tmp_path / "empty.rrd", [])
    untrue = record(tmp_path / "without_truth.rrd", [without_truth(step) for step in run[:3]])
    for arguments, message in (
        ((tmp_path / "none.rrd", output), f"{tmp_path / 'none.rrd'}: no such recording"),
        ((junk, output), f"{junk}: expected a whole Rerun recording"),
        ((recorded, tmp_path / "out.fbx"), "with the extension .bvh, .trc, .csv"),
        ((recorded, tmp_path / "folder.trc"), "expected an output file, found a folder"),
        ((empty, output), "expected a recording with poses (estimate/pose), found none"),
        ((empty, output, "--truth"), "expected a recording of a tracked person"),
        ((untrue, output, "--truth"), "with true joints (world/truth/joints), found none"),
        ((recorded, output, "--truth"), "BVH requires joint angles, but only joint positions are known"),
    ):
        assert exported(*arguments) == 2
        printed = capsys.readouterr()
        assert message in printed.err
        assert (printed.out, printed.err.count("\n")) == ("", 1)
    assert output.read_text() == "existing"


def test_a_frame_without_truth_is_an_empty_row(run, tmp_path):
    gap = record(tmp_path / "gap.rrd", [*run[:5], without_truth(run[5]), *run[6:]])
    assert exported(gap, tmp_path / "out.trc", "--truth") == 0
    rows = [line.split("\t")[2:] for line in (tmp_path / "out.trc").read_text().splitlines()[6:]]
    assert [set(row) == {""} for row in rows] == [k == 5 for k in range(len(run))]


@pytest.fixture(scope="module")
def judged(run, tmp_path_factory):
    """A recording whose left leg is doubtful from the fifth frame on and lost in the last."""
    states = dict.fromkeys(JOINT_GROUPS, ["tracked"] * N)
    states["left_leg"] = [*["tracked"] * 4, *["doubtful"] * (N - 5), "lost"]
    collector = MeasurementCollector(BODY)
    path = tmp_path_factory.mktemp("judged") / "run.rrd"
    with recorder(path) as recording:
        for step in run:
            recording.log(step, {})
            collector.add(step, {})
        verdict = Verdict((), Finding("tracked", "tracked", "trustworthy"), ("tracked",) * N, states)
        recording.set_verdict(verdict, collector.measurements())
    return path


@pytest.mark.parametrize(("min_state", "n_shown"), [("tracked", 4), ("doubtful", N - 1)])
def test_joints_below_a_state_are_left_out(judged, estimated, tmp_path, min_state, n_shown):
    output = tmp_path / "out.csv"
    assert exported(judged, output, "--min-state", min_state) == 0
    rows = list(csv.DictReader(output.open()))
    for name in ("left_knee_x_m", "left_ankle_z_m", "left_knee_flexion_rad", "left_hip_flexion_rad"):
        assert [k for k, row in enumerate(rows) if row[name]] == list(range(n_shown))
    assert all(row["right_ankle_x_m"] and row["right_knee_flexion_rad"] and row["pelvis_x_m"] for row in rows)
    shown = [float(row["left_ankle_y_m"]) for row in rows[:n_shown]]
    np.testing.assert_allclose(shown, estimated[:n_shown, JOINT_NAMES.index("left_ankle"), 1], atol=1e-6)


@pytest.mark.parametrize(
    ("name", "state", "message"),
    [("a.bvh", "tracked", "a.bvh"), ("a.trc", "lost", "--min-state"), ("a.mot", "doubtful", "a.mot")],
)
def test_an_impossible_state_or_format_is_rejected(judged, tmp_path, capsys, name, state, message):
    assert exported(judged, tmp_path / name, "--min-state", state) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / name).exists()
