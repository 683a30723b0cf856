"""Reading recordings: complete, truncated, rewritten by Rerun, of other programs, and all of a folder."""

import os
import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
import rerun_cli
from recorded import record
from recording_steps import BODY, errors, steps

from workbench.body.kinematics import joints
from workbench.recording.format import FORMAT, check_format
from workbench.recording.read.crash_probe import open_sound_runs
from workbench.recording.read.reader import read
from workbench.recording.write.file import RecordingFile
from workbench.utils.errors import InputError


@pytest.fixture(scope="module")
def run():
    return list(steps(12, n_particles=30))


@pytest.fixture(scope="module")
def recorded(run, tmp_path_factory):
    path = tmp_path_factory.mktemp("reader") / "run.rrd"
    labels = {"config_yaml": "seed: 3\nprior: {sigma: 1.0e-05}", "provenance": {"seed": 3}}
    return record(path, run, errors, {"error_mm": 1.0}, run_id="read", **labels)


def optimize(path, out):
    rerun = Path(rerun_cli.__file__).with_name("rerun")
    environment = {**os.environ, "RERUN_ANALYTICS": "false"}
    subprocess.run([rerun, "rrd", "optimize", path, "-o", out], check=True, capture_output=True, env=environment)
    return out


def assert_equal(first, second):
    assert first.properties == second.properties
    assert first.scalars.keys() == second.scalars.keys()
    for path, curve in first.scalars.items():
        assert curve.frames.tolist() == second.scalars[path].frames.tolist()
        assert curve.values.tobytes() == second.scalars[path].values.tobytes()
    assert first.marginals.log_mass.tobytes() == second.marginals.log_mass.tobytes()


def test_an_optimized_recording_is_read_equally(recorded, tmp_path):
    """`rerun rrd optimize` merges several rows of a property, an image or a curve into one chunk."""
    assert_equal(read(recorded), read(optimize(recorded, tmp_path / "optimized.rrd")))


def test_metrics_poses_and_marginals_have_names_and_shapes(recorded):
    run = read(recorded)
    assert run.metric_names == ("error_mm", "error_relative_mm", "ess", "log_evidence", "visible_limbs")
    frames, values = run.metric("log_evidence")
    assert frames.tolist() == list(range(10, 22))
    assert values.tolist() == [-3.0 * k for k in range(1, 13)]
    assert run.poses[1].shape == (12, 25)
    assert run.marginals.names[:5] == ("c1", "c2", "c3", "c4", "c5")
    assert run.marginals.units[5:7] == ("cycle", "cycle/s")
    assert (run.marginals.low < run.marginals.high).all()


def test_a_missing_file_and_a_folder_without_a_recording_are_rejected(tmp_path):
    for path in (tmp_path / "missing.rrd", tmp_path):
        with pytest.raises(InputError, match=r"\.rrd: no such recording"):
            read(path)


def test_a_recording_of_another_program_is_rejected(tmp_path):
    stream = rr.RecordingStream("other", recording_id="other")
    stream.set_sinks(rr.FileSink(tmp_path / "other.rrd"))
    stream.log("x", rr.Scalars(1.0))
    stream.flush()
    stream.disconnect()
    with pytest.raises(InputError, match="without the property 'run'"):
        read(tmp_path / "other.rrd")


def test_the_message_on_a_truncated_recording_has_the_command_that_recovers_it(recorded, tmp_path):
    truncated = tmp_path / "truncated.rrd"
    content = recorded.read_bytes()
    truncated.write_bytes(content[: len(content) * 3 // 4])
    with pytest.raises(InputError, match="rerun rrd optimize"):
        read(truncated)
    recovered = read(optimize(truncated, tmp_path / "recovered.rrd"))
    assert recovered.config == read(recorded).config
    frames, poses = recovered.poses
    expected = read(recorded).poses[1]
    assert len(frames) >= 10  # the first flush precedes the cut
    assert np.array_equal(poses, expected[: len(frames)])


def message_ends(content):
    """Return where the messages of a recording end. 12 bytes precede them; a message has a header of 16 bytes, the last
    8 of which are its length, or 0 for the footer."""
    ends = [12]
    while (header := content[ends[-1] : ends[-1] + 16]) and not header.startswith(bytes(8)):
        ends.append(ends[-1] + 16 + struct.unpack("<8xQ", header)[0])
    return ends


def test_a_recording_truncated_anywhere_is_rejected(recorded, tmp_path):
    """Rerun itself reads a recording without error that ends between two messages or lacks the last bytes."""
    truncated, content = tmp_path / "truncated.rrd", recorded.read_bytes()
    shutil.copy(recorded, truncated)
    ends = [end + k for end in message_ends(content)[1::7] for k in (-1, 0, 15, 16)]
    last = [len(content) - k for k in (1, 4, 31, 32, 33, 48)]
    for size in sorted([*ends, *range(len(content) // 9, len(content), len(content) // 9), *last], reverse=True):
        os.truncate(truncated, size)
        with pytest.raises(InputError, match=r"truncated\.rrd: expected a whole Rerun recording"):
            read(truncated)


def test_the_part_of_a_killed_run_is_read_without_its_footer(recorded, tmp_path):
    part, content = tmp_path / "run.rrd.part", recorded.read_bytes()
    part.write_bytes(content[: message_ends(content)[-1]])
    assert read(part).poses[1].tobytes() == read(recorded).poses[1].tobytes()


@pytest.fixture
def folder(recorded, tmp_path):
    """A folder with two complete runs, the part of one, a damaged recording, and other files."""
    for name in ("b/run.rrd", "a/0/run.rrd", "a/1/run.rrd.part"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(recorded, tmp_path / name)
    (tmp_path / "a" / "junk.rrd").write_bytes(b"junk" * 100)
    (tmp_path / "a" / "run.rrd.txt").write_text("no recording")
    (tmp_path / "summary.json").write_text("{}")
    return tmp_path


def test_runs_of_a_folder_are_sorted_and_unreadable_ones_are_reported(folder):
    runs, problems = open_sound_runs(folder)
    assert [str(run.path.relative_to(folder)) for run in runs] == ["a/0/run.rrd", "a/1/run.rrd.part", "b/run.rrd"]
    assert [problem.path.name for problem in problems] == ["junk.rrd"]
    assert "junk.rrd: expected a whole Rerun recording" in problems[0].reason


def test_recorded_joints_are_those_of_the_poses_and_of_the_truth(recorded, run):
    recording = read(recorded)
    assert recording.joints.names == recording.true_joints.names == BODY.skeleton.names
    frames = [step.frame.index for step in run]
    assert recording.joints.frames.tolist() == recording.true_joints.frames.tolist() == frames
    # float32 coordinates of some metres: 2e-7 m
    np.testing.assert_allclose(recording.joints.positions, joints(BODY.skeleton, recording.poses[1]), atol=1e-6)
    np.testing.assert_allclose(recording.true_joints.positions, [step.frame.truth.joints for step in run], atol=1e-6)


def test_settings_are_the_configuration_as_plain_values(recorded):
    recording = read(recorded)
    assert recording.settings == {"seed": 3, "prior": {"sigma": 1e-5}}
    assert recording.result == {"error_mm": 1.0}
    assert recording.provenance["seed"] == 3
    assert not recording.is_study
    assert recording.properties["run"]["format"] == FORMAT
    assert recording.environment.keys() >= {"system", "blas", "numba_cpu", "numpy"}


@pytest.mark.parametrize("version", [FORMAT - 1, FORMAT + 1, "two"])
def test_another_format_is_refused_with_the_version_that_wrote_it(tmp_path, version):
    provenance = {"workbench": "0.0.1"}
    with RecordingFile(tmp_path / "run.rrd", run_id="x", config_yaml="", provenance=provenance) as file:
        file.send_property("run", {"format": version})
    with pytest.raises(InputError) as error:
        read(tmp_path / "run.rrd")
    assert str(error.value) == (
        f"{tmp_path}/run.rrd: expected format {FORMAT}, found format {version}, written by workbench 0.0.1; "
        "repeat its experiment, or use that version"
    )


def test_a_recording_without_a_number_has_format_1():
    with pytest.raises(InputError, match="found format 1, written by an unknown version of workbench"):
        check_format("run.rrd", None, None)
