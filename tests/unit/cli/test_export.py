"""workbench export: from a recording, whole or cut off, to files; and what it says where it cannot."""

import csv
import os
import shutil
from dataclasses import replace

import numpy as np
import pytest
from recording_steps import BODY, SPACE, steps

from workbench.body.kinematics import joints
from workbench.cli.export import estimated_track, main, true_track
from workbench.motion.formats.bvh import read_bvh
from workbench.motion.formats.export import export
from workbench.recording.read.reader import read
from workbench.recording.write.recorder import Recorder
from workbench.utils.errors import InputError

N = 12  # more than one flush, and a rest


def recorder(path):
    return Recorder(path, BODY, SPACE, run_id=path.name, config_yaml="", provenance={})


def record(path, run):
    with recorder(path) as recording:
        for step in run:
            recording.log(step, {})
    return path


def without_truth(step):
    return replace(step, frame=replace(step.frame, truth=None))


def at(step, time_s):
    return replace(step, frame=replace(step.frame, time_s=time_s))


@pytest.fixture(scope="module")
def run():
    """Steps without images, which no export looks at."""
    return [replace(step, frame=replace(step.frame, views=())) for step in steps(N, n_particles=20)]


@pytest.fixture(scope="module")
def recorded(run, tmp_path_factory):
    return record(tmp_path_factory.mktemp("export") / "run.rrd", run)


@pytest.fixture(scope="module")
def estimated(run):
    return joints(BODY.skeleton, np.stack([step.expected_pose for step in run]))


def failure(capsys, *arguments):
    """The one line that a failing export prints."""
    assert main([str(argument) for argument in arguments]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    (line,) = printed.err.splitlines()
    return line


@pytest.mark.parametrize(("options", "unit"), [([], "cm"), (["--metres"], "m")])
def test_bvh_of_the_estimate(recorded, estimated, tmp_path, capsys, options, unit):
    output = tmp_path / "OUT.BVH"
    assert main([str(recorded), str(output), *options]) == 0
    printed = capsys.readouterr()
    axes = "y is up, z ahead where the world has x"
    assert (printed.err, printed.out) == ("", f"{output}: 12 frames, 0.000 to 0.367 s; {axes}\n")
    clip = read_bvh(output, unit)
    assert clip.rate_hz == 30.0
    np.testing.assert_allclose(clip.positions, estimated, atol=4e-6)  # six decimals of metres
    assert [path.name for path in tmp_path.iterdir()] == ["OUT.BVH"]


def test_trc_of_the_estimate_and_of_the_truth(recorded, run, estimated, tmp_path):
    true = np.stack([step.frame.truth.joints for step in run])
    for options, expected in (([], estimated), (["--truth"], true)):
        output = tmp_path / "out.trc"
        assert main([str(recorded), str(output), *options]) == 0
        rows = np.loadtxt(output, skiprows=6)
        np.testing.assert_allclose(rows[:, 1], np.arange(N) / 30.0, atol=1e-9)
        # the recording keeps the true joints to float32
        np.testing.assert_allclose(rows[:, 2:].reshape(N, 15, 3)[..., [2, 0, 1]] / 1000.0, expected, atol=1e-6)
    assert np.abs(estimated - true).max() > 0.01  # or the two could be mixed up


def test_csv_keeps_frames_times_and_poses(recorded, run, tmp_path):
    output = tmp_path / "out.csv"
    assert main([str(recorded), str(output)]) == 0
    with output.open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row, step in zip(rows, run, strict=True):
        assert (int(row["frame"]), float(row["time_s"])) == (step.frame.index, pytest.approx(step.frame.time_s))
        assert float(row["left_knee_flexion_rad"]) == pytest.approx(
            step.expected_pose[BODY.skeleton.dof("left_knee_flexion")], abs=1e-9
        )
        assert float(row["root_x_m"]) == float(row["pelvis_x_m"])


def test_csv_has_bands_where_they_are_asked_for(recorded, tmp_path):
    output = tmp_path / "out.csv"
    assert main([str(recorded), str(output), "--bands"]) == 0
    with output.open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        low, high = float(row["left_knee_flexion_low"]), float(row["left_knee_flexion_high"])
        assert low < high


def test_a_run_cut_off_is_exported_and_said_to_be(run, tmp_path, capsys):
    def broken():
        yield from run[:4]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        record(tmp_path / "run.rrd", broken())
    part, output = tmp_path / "run.rrd.part", tmp_path / "out.bvh"
    assert main([str(part), str(output)]) == 0
    printed = capsys.readouterr()
    assert printed.err == f"{part}: the run is not complete (status: interrupted)\n"
    assert "4 frames" in printed.out
    assert len(read_bvh(output)) == 4


def test_a_run_still_at_work_is_exported_as_far_as_it_is_written(run, estimated, tmp_path, capsys, recwarn):
    with recorder(tmp_path / "run.rrd") as recording:
        for step in run[:11]:
            recording.log(step, {})
        part = shutil.copy(recording.part, tmp_path / "killed.rrd.part")
    for options in ([], ["--truth"]):
        assert main([str(part), str(tmp_path / "out.csv"), *options]) == 0
        assert capsys.readouterr().err == f"{part}: the run is not complete (status: running)\n"
        rows = np.loadtxt(tmp_path / "out.csv", skiprows=1, delimiter=",")
        assert rows[:, 0].tolist() == [step.frame.index for step in run[:9]]  # three flushes
    assert len(recwarn) == 0


def test_frames_without_truth_are_left_out_and_counted(run, tmp_path, capsys):
    partly = record(tmp_path / "run.rrd", [*run[:7], *map(without_truth, run[7:])])
    assert main([str(partly), str(tmp_path / "out.trc"), "--truth"]) == 0
    assert "5 frames have no truth and are left out" in capsys.readouterr().err
    assert len(np.loadtxt(tmp_path / "out.trc", skiprows=6)) == 7


def test_a_gap_in_the_truth_has_no_rate_but_a_table(run, tmp_path, capsys):
    gappy = record(tmp_path / "run.rrd", [*run[:5], without_truth(run[5]), *run[6:]])
    line = failure(capsys, gappy, tmp_path / "out.trc", "--truth")
    assert "0.0667 s after 0.133 s" in line
    assert main([str(gappy), str(tmp_path / "out.csv"), "--truth"]) == 0
    assert len((tmp_path / "out.csv").read_text().splitlines()) == 1 + N - 1


def test_uneven_times_and_one_frame(run, tmp_path, capsys):
    uneven = record(tmp_path / "uneven.rrd", [*run[:5], *[at(step, step.frame.time_s + 0.5) for step in run[5:]]])
    assert "expected frames at even times" in failure(capsys, uneven, tmp_path / "out.bvh")
    single = record(tmp_path / "single.rrd", run[:1])
    assert "expected two frames or more" in failure(capsys, single, tmp_path / "out.bvh")
    assert not (tmp_path / "out.bvh").exists()
    assert main([str(single), str(tmp_path / "out.csv")]) == 0


def test_what_cannot_be_read_or_written_is_told(recorded, run, tmp_path, capsys):
    output, junk = tmp_path / "out.bvh", tmp_path / "junk.rrd"
    output.write_text("keep me")
    junk.write_bytes(b"no recording" * 100)
    assert f"{tmp_path / 'none.rrd'}: no such recording" in failure(capsys, tmp_path / "none.rrd", output)
    assert f"{junk}: expected a whole Rerun recording" in failure(capsys, junk, output)
    assert "ends in .bvh, .trc, .csv" in failure(capsys, recorded, tmp_path / "out.fbx")
    assert "in a folder that exists" in failure(capsys, recorded, tmp_path / "none" / "out.bvh")
    empty = record(tmp_path / "empty.rrd", [])
    assert "expected a recording with poses (estimate/pose), found none" in failure(capsys, empty, output)
    assert "expected a recording of a tracked person" in failure(capsys, empty, output, "--truth")
    blind = record(tmp_path / "blind.rrd", [without_truth(step) for step in run[:3]])
    assert "with true joints (world/truth/joints), found none" in failure(capsys, blind, output, "--truth")
    assert output.read_text() == "keep me"
    with pytest.raises(SystemExit, match="2"):
        main([str(recorded)])


def test_bvh_of_the_truth_is_refused_since_only_joints_are_known(recorded, tmp_path, capsys):
    line = failure(capsys, recorded, tmp_path / "out.bvh", "--truth")
    assert "BVH holds angles, but only joints are known here" in line


def test_another_body_or_shape_is_refused(recorded):
    found = read(recorded)

    def having(**properties):
        return replace(found, properties={**found.properties, **properties})

    shape = dict(found.properties["shape"])
    assert estimated_track(having(shape=shape)).poses.shape == (N, 25)
    for wrong, sentence in (
        (having(body={"joints": ["pelvis"], "pose": ["root_x"]}), "joints and pose numbers of this version's body"),
        (having(body={}), "of this version's body"),
        (having(shape={}), "lacks the length 'neck'"),
        (having(shape={**shape, "thigh": "long"}), "lacks the length 'thigh'"),
        (having(shape={**shape, "thigh": np.nan}), "lacks the length 'thigh'"),
        (having(shape={**shape, "hip": [0.1, 0.2]}), "lacks the length 'hip'"),
        (having(shape={**shape, "calf": -0.4}), "calf must be a positive length"),
    ):
        for track in (estimated_track, true_track):
            with pytest.raises(InputError, match=sentence):
                track(wrong)


@pytest.mark.parametrize("poses", [np.full((3, 25), np.nan), np.zeros((3, 24))])
def test_poses_that_are_none_are_refused(recorded, monkeypatch, poses):
    monkeypatch.setattr("workbench.cli.export.timed_poses", lambda path: (np.arange(3), np.arange(3) / 30.0, poses))
    with pytest.raises(InputError, match="expected poses of 25 finite numbers"):
        estimated_track(read(recorded))


def test_a_file_appears_whole_or_not_at_all(recorded, tmp_path, monkeypatch):
    track = estimated_track(read(recorded))
    (tmp_path / f"out.csv.{os.getpid()}.part").mkdir()
    with pytest.raises(InputError, match=r"out\.csv: cannot be written"):
        export(tmp_path / "out.csv", track)
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"out.csv.{os.getpid()}.part"]

    def refuse(source, target):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "replace", refuse)
    with pytest.raises(InputError, match=r"out\.bvh: cannot be written: Permission denied"):
        export(tmp_path / "out.bvh", track)
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"out.csv.{os.getpid()}.part"]
