"""A recording's numbers as arrays and data frames."""

import sys

import numpy as np
import pytest
from recorded import record
from recording_steps import BODY, errors, steps

from workbench.recording.read.frame_tables import TABLES, data_frame
from workbench.recording.read.reader import read
from workbench.utils.errors import InputError

N = 3


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    path = tmp_path_factory.mktemp("tables") / "run.rrd"
    record(path, steps(N, n_particles=20), errors, config_yaml="seed: 3", provenance={"seed": 3})
    return read(path.parent)  # by the run's folder


def test_poses_and_joints_are_those_of_the_arrays(run):
    poses, joints = run.table("poses"), run.table("joints")
    frames, values = run.poses
    np.testing.assert_array_equal(poses["frame"], frames)
    np.testing.assert_array_equal(poses["left_knee_flexion"], values[:, BODY.skeleton.dof("left_knee_flexion")])
    ankle = joints["joint"] == "left_ankle"
    np.testing.assert_array_equal(joints["frame"][ankle], run.joints.frames)
    np.testing.assert_array_equal(joints["z"][ankle], run.joints.positions[:, run.joints.names.index("left_ankle"), 2])


def test_intervals_are_the_recorded_curves(run):
    intervals, table = run.intervals, run.table("intervals")
    k = intervals.names.index("root_x")
    for edge in ("low", "mean", "high", "truth"):
        recorded = run.scalars[f"posterior/parameters/root_x/{edge}"]
        np.testing.assert_array_equal(getattr(intervals, edge)[:, k], recorded.values[:, 0])
        np.testing.assert_array_equal(table[edge][table["parameter"] == "root_x"], recorded.values[:, 0])
    assert np.all(intervals.low[:, k] <= intervals.high[:, k])
    assert np.isnan(intervals.truth[:, intervals.names.index("c1")]).all()  # coefficients have no ground truth


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_data_frames_have_the_same_columns_and_values(run, library):
    pytest.importorskip(library)
    for name in TABLES:
        table, frame = run.table(name), getattr(run, library)(name)
        assert list(frame.columns) == list(table)
        for column, values in table.items():
            np.testing.assert_array_equal(frame[column].to_numpy(), values)


def test_a_missing_library_and_an_unknown_table_are_rejected_by_name(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "polars", None)
    with pytest.raises(InputError, match="needs the package polars"):
        data_frame("polars", {"frame": [0]})
    with pytest.raises(InputError, match="one of poses, joints, true_joints, intervals, metrics, found 'pose'"):
        run.table("pose")
