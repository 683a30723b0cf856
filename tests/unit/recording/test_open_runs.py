"""Many recordings at once, and what a `Run` tells of one."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recording_steps import BODY, SPACE, errors, steps

from workbench.body.kinematics import joints
from workbench.recording.condense import condense
from workbench.recording.read.crash_probe import open_sound_runs
from workbench.recording.read.reader import find_recordings, read
from workbench.recording.side_by_side import write_side_by_side
from workbench.recording.write.file import FORMAT, RecordingFile
from workbench.recording.write.recorder import Recorder
from workbench.utils.errors import InputError

FORMAT_1 = Path(__file__).parent / "recordings" / "format_1.rrd"
N = 3


@pytest.fixture(scope="module")
def run():
    return list(steps(N, n_particles=20))


@pytest.fixture(scope="module")
def recorded(run, tmp_path_factory):
    return record(tmp_path_factory.mktemp("open") / "run.rrd", run, config_yaml="seed: 3\nprior: {sigma: 1.0e-05}")


def record(path, run, config_yaml="seed: 3"):
    with Recorder(path, BODY, SPACE, run_id=path.name, config_yaml=config_yaml, provenance={"seed": 3}) as recording:
        for step in run:
            recording.log(step, errors(step))
        recording.set_result({"error_mm": 1.0})
    return path


@pytest.fixture
def folder(recorded, tmp_path):
    """Two good runs, one cut off, one that is none, and files that are no recordings."""
    for name in ("b/run.rrd", "a/0/run.rrd", "a/1/run.rrd.part"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(recorded, tmp_path / name)
    (tmp_path / "a" / "junk.rrd").write_bytes(b"junk" * 100)
    (tmp_path / "a" / "run.rrd.txt").write_text("no recording")
    (tmp_path / "summary.json").write_text("{}")
    return tmp_path


def test_all_are_found_sorted_and_one_that_cannot_be_read_does_not_stop_the_others(folder):
    runs, problems = open_sound_runs(folder)
    assert [str(run.path.relative_to(folder)) for run in runs] == ["a/0/run.rrd", "a/1/run.rrd.part", "b/run.rrd"]
    assert [problem.path.name for problem in problems] == ["junk.rrd"]
    assert "junk.rrd: expected a whole Rerun recording" in problems[0].reason


def test_files_and_folders_may_overlap(folder):
    runs, problems = open_sound_runs(folder / "b", folder / "b" / "run.rrd", folder / "a" / "junk.rrd")
    assert ([run.path.parent.name for run in runs], len(problems)) == (["b"], 1)


def test_a_folder_without_recordings_and_a_place_that_is_not_there(tmp_path):
    assert open_sound_runs(tmp_path) == ([], [])
    with pytest.raises(InputError, match="nowhere: expected a recording or a folder"):
        find_recordings(tmp_path / "nowhere")


def test_joints_are_those_of_the_poses_and_of_the_truth(recorded, run):
    found = read(recorded)
    assert found.joints.names == found.true_joints.names == BODY.skeleton.names
    assert found.joints.frames.tolist() == found.true_joints.frames.tolist() == [step.frame.index for step in run]
    # recorded to float32, coordinates of some metres: 2e-7 m
    np.testing.assert_allclose(found.joints.positions, joints(BODY.skeleton, found.poses[1]), atol=1e-6)
    np.testing.assert_allclose(found.true_joints.positions, [step.frame.truth.joints for step in run], atol=1e-6)


def test_a_run_without_frames_has_joints_of_no_frame(tmp_path):
    found = read(record(tmp_path / "run.rrd", []))
    assert found.joints.positions.shape == found.true_joints.positions.shape == (0, len(BODY.skeleton.names), 3)


def test_settings_are_the_configuration_as_plain_values(recorded):
    found = read(recorded)
    assert found.settings == {"seed": 3, "prior": {"sigma": 1e-5}}
    assert found.result == {"error_mm": 1.0}
    assert found.provenance["seed"] == 3
    assert not found.is_study
    assert found.format == FORMAT
    assert found.environment.keys() >= {"system", "blas", "numba_cpu", "numpy"}


def test_a_recording_without_a_format_number_is_of_format_1():
    found = read(FORMAT_1)
    assert (found.format, found.environment, found.status) == (1, {}, "complete")
    assert found.poses[1].shape == (4, 25)
    assert found.joints.positions.shape == found.true_joints.positions.shape == (4, 15, 3)
    assert found.marginals.log_mass.shape[2] == 4
    assert found.settings["inference"]["n_particles"] == 40
    assert found.result["error_abs_mm"] == pytest.approx(found.metric("error_abs_mm")[1][1:].mean())


@pytest.mark.parametrize("version", [FORMAT + 1, "two"])
def test_a_newer_format_is_refused(tmp_path, version):
    with RecordingFile(tmp_path / "run.rrd", run_id="x", config_yaml="", provenance={}) as file:
        file.send_property("run", {"format": version})
    with pytest.raises(InputError, match=f"format 1 to {FORMAT}, found {version!r}"):
        read(tmp_path / "run.rrd")


def test_a_run_whose_id_is_lost_is_laid_beside_another_and_condensed(recorded, tmp_path, trusted):
    run = read(recorded)
    properties = {**run.properties, "run": {key: run.properties["run"][key] for key in ("status", "format")}}
    lost = replace(run, properties=properties)
    assert (lost.id, run.id) == ("", run.properties["run"]["id"])
    write_side_by_side(tmp_path / "both.rrd", lost, run)
    condense(lost, tmp_path / "condensed.rrd")
    assert read(tmp_path / "condensed.rrd").metrics.keys() == run.metrics.keys()
