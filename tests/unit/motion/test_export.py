"""Exported tracks: TRC, CSV, C3D, BVH and MOT files, their missing frames and their rates."""

import csv
import io
import sys
from dataclasses import replace

import ezc3d
import numpy as np
import pytest
import trc

from workbench.body.kinematics import joints
from workbench.body.shape import from_height
from workbench.body.skeleton import FOOT_POINTS, JOINT_NAMES, POSE_NAMES, feet_skeleton, person_skeleton
from workbench.motion.formats.markers import read_markers
from workbench.motion.formats.motion_export import (
    SUFFIXES,
    Track,
    at_one_rate,
    csv_text,
    export,
    frame_rate,
    trc_text,
    with_missing_frames,
)
from workbench.utils.errors import InputError

SKELETON = person_skeleton(from_height(1.7))


def track(n=7):
    rng = np.random.default_rng(5)
    poses = rng.uniform(-1.0, 1.0, (n, 25))
    return Track(SKELETON, 40 + np.arange(n), 1.5 + np.arange(n) / 25.0, joints(SKELETON, poses), poses)


def test_trc_data_reader_reads_the_exported_file(tmp_path):
    """trc-data-reader is a package on PyPI."""
    exported, path = track(), tmp_path / "walk.trc"
    path.write_text(trc_text(path.name, JOINT_NAMES, exported.positions, 25.0))
    data = trc.TRCData()
    data.load(str(path))
    header = {"PathFileType": "4", "DataFormat": "(X/Y/Z)", "FileName": "walk.trc", "DataRate": 25.0,
              "CameraRate": 25.0, "NumFrames": 7, "NumMarkers": 15, "Units": "mm", "OrigDataRate": 25.0,
              "OrigDataStartFrame": 1, "OrigNumFrames": 7}  # fmt: skip
    assert {key: data[key] for key in header} == header
    assert data["Markers"] == list(JOINT_NAMES)
    assert data["Frame#"] == list(range(1, 8))
    assert data["Time"] == pytest.approx(np.arange(7) / 25.0)
    positions = np.stack([np.array(data[name]) for name in JOINT_NAMES], axis=1)
    np.testing.assert_allclose(positions[..., [0, 2, 1]] * [1, -1, 1] / 1000.0, exported.positions, atol=0.51e-7)


def test_omitted_frames_are_empty_rows_and_a_bvh_repeats_the_last_pose(tmp_path, caplog):
    rows = np.array([0, 1, 2, 5, 6])
    complete = track()
    gappy = replace(
        complete, frames=complete.frames[rows], times_s=complete.times_s[rows], positions=complete.positions[rows],
        poses=complete.poses[rows], bands={"low": np.arange(5.0)},
    )  # fmt: skip
    filled = with_missing_frames(gappy)
    np.testing.assert_array_equal(filled.frames, complete.frames)
    np.testing.assert_allclose(filled.times_s, complete.times_s)
    np.testing.assert_array_equal(filled.positions[rows], gappy.positions)
    assert np.isnan(filled.positions[[3, 4]]).all()
    assert np.isnan(filled.bands["low"][[3, 4]]).all()
    for suffix in SUFFIXES:
        export(tmp_path / f"walk{suffix}", filled)
    table = list(csv.reader(io.StringIO((tmp_path / "walk.csv").read_text())))
    assert [set(row[2:]) == {""} for row in table[1:]] == [False, False, False, True, True, False, False]
    assert set((tmp_path / "walk.trc").read_text().splitlines()[-3].split("\t")[2:]) == {""}
    motion = (tmp_path / "walk.bvh").read_text().splitlines()[-7:]
    assert motion[2] == motion[3] == motion[4] != motion[5]
    assert "2 frames between 43 and 44" in caplog.text
    markers = read_markers(tmp_path / "walk.c3d")
    np.testing.assert_array_equal(np.isnan(markers.positions).all(axis=(1, 2)), np.isin(np.arange(7), [3, 4]))
    times_s = np.loadtxt((tmp_path / "walk.mot").read_text().split("endheader\n")[1].splitlines()[1:])[:, 0]
    np.testing.assert_allclose(times_s, np.array([0, 1, 2, 5, 6]) / 25.0, atol=1e-9)


@pytest.mark.parametrize("metres", [False, True])
def test_points_are_read_back_from_every_format_of_points(tmp_path, metres):
    """They are exact to float32 in C3D, to a tenth of a micrometre in TRC and to a nanometre in CSV."""
    rng = np.random.default_rng(1)
    poses = np.zeros((9, 25)) + 0.2 * rng.uniform(-1.0, 1.0, (9, 25))
    exported = Track(SKELETON, np.arange(9), np.arange(9) / 29.97, joints(SKELETON, poses), poses)
    exported.positions[:, 5] = np.nan
    exported.positions[4, 2] = np.nan
    for suffix, last_digit in (
        (".trc", 0.51e-7),
        (".csv", 0.51e-9),
        (".c3d", 2.0**-24 * np.nanmax(np.abs(exported.positions))),
    ):
        export(tmp_path / f"walk{suffix}", exported, metres)
        assert [path.name for path in tmp_path.iterdir()] == [f"walk{suffix}"]
        markers = read_markers(tmp_path / f"walk{suffix}")
        assert markers.rate_hz == pytest.approx(29.97, rel=1e-7)
        assert markers.names == (*JOINT_NAMES[:5], *JOINT_NAMES[6:])  # the others are never measured
        np.testing.assert_allclose(markers.positions, np.delete(exported.positions, 5, 1), atol=last_digit, rtol=0.0)
        (tmp_path / f"walk{suffix}").unlink()


def test_heels_and_toes_are_read_back_by_independent_readers(tmp_path):
    """The joint that carries a foot, at the ankle, is no marker."""
    rng, skeleton = np.random.default_rng(2), feet_skeleton(from_height(1.7))
    poses = 0.2 * rng.uniform(-1.0, 1.0, (9, 27))
    exported = Track(skeleton, np.arange(9), np.arange(9) / 30.0, joints(skeleton, poses), poses)
    names = (*JOINT_NAMES, *FOOT_POINTS)
    expected = exported.positions[:, [skeleton.joint(name) for name in names]]
    assert exported.markers[0] == names
    for suffix in SUFFIXES:
        export(tmp_path / f"walk{suffix}", exported)
    data = trc.TRCData()
    data.load(str(tmp_path / "walk.trc"))
    assert data["Markers"] == list(names)
    found = np.stack([np.array(data[name]) for name in names], axis=1)[..., [0, 2, 1]] * [1, -1, 1] / 1000.0
    np.testing.assert_allclose(found, expected, atol=0.51e-7)
    points = ezc3d.c3d(str(tmp_path / "walk.c3d"))
    assert points["parameters"]["POINT"]["LABELS"]["value"] == list(names)
    np.testing.assert_allclose(points["data"]["points"][:3].transpose(2, 1, 0) / 1000.0, expected, atol=1e-6)
    for suffix in (".trc", ".c3d", ".csv"):
        markers = read_markers(tmp_path / f"walk{suffix}")
        assert markers.names == names
        np.testing.assert_allclose(markers.positions, expected, atol=1e-6)


def test_c3d_holds_at_most_65535_frames(tmp_path):
    n = 65_536
    long = Track(SKELETON, np.arange(n), np.arange(n) / 30.0, np.zeros((n, 15, 3)))
    with pytest.raises(InputError, match="at most 65535 frames, found 65536"):
        export(tmp_path / "walk.c3d", long)
    assert not list(tmp_path.iterdir())


def test_a_missing_library_is_named_before_anything_is_read(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    for call in (lambda path: export(path, track()), read_markers):
        with pytest.raises(InputError, match=r"walk.c3d: C3D requires ezc3d: pip install -e '.\[c3d\]'"):
            call(tmp_path / "walk.c3d")


def test_frames_of_a_constant_step_are_complete():
    complete = track()
    assert len(with_missing_frames(replace(complete, frames=5 * complete.frames))) == len(complete)
    sparse = replace(complete, frames=np.array([0, 1, 2, 3, 4, 5, 10**9]))
    assert with_missing_frames(sparse) is sparse


def test_a_table_has_named_columns_of_joints_and_poses():
    exported = track()
    exported.positions[2, 3] = np.nan
    rows = list(csv.DictReader(io.StringIO(csv_text(exported))))
    assert [int(row["frame"]) for row in rows] == exported.frames.tolist()
    assert [float(row["time_s"]) for row in rows] == pytest.approx(exported.times_s)
    assert len(rows[0]) == 2 + 45 + 25
    for j, joint in enumerate(JOINT_NAMES):
        for a, axis in enumerate("xyz"):
            cells = [row[f"{joint}_{axis}_m"] for row in rows]
            assert (cells[2] == "") == (j == 3)
            values = [float(cell or "nan") for cell in cells]
            np.testing.assert_allclose(values, exported.positions[:, j, a], atol=0.51e-9)
    for k, name in enumerate(POSE_NAMES):
        values = [float(row[f"{name}_{'m' if k < 3 else 'rad'}"]) for row in rows]
        np.testing.assert_allclose(values, exported.poses[:, k], atol=0.51e-9)


@pytest.mark.parametrize("rate_hz", [14.0, 25.0, 30.0, 120.0, 240.0])
@pytest.mark.parametrize("n", [2, 3, 50, 2000])
def test_an_integer_rate_is_recovered_from_nanoseconds(rate_hz, n):
    assert frame_rate(7.0 + np.round(np.arange(n) / rate_hz, 9)) == rate_hz


def test_a_fractional_rate_and_a_rate_from_milliseconds():
    assert frame_rate(np.arange(100) / 29.97) == pytest.approx(29.97, rel=1e-9)
    milliseconds = np.round(np.arange(91) / 30.0, 3)
    assert frame_rate(milliseconds) == 30.0  # intervals of 0.033 and 0.034 s, 3.000 s in total


@pytest.mark.parametrize(
    ("times_s", "message"),
    [
        ([0.0, 0.1, 0.2, 0.2, 0.3], r"increase, found 0 s after 0\.200 s"),
        ([1.0], "two frames or more to determine their rate, found 1"),
        ([2.0, 1.0, 0.0], "times that increase"),
        ([0.0, 1e-4, 2e-4, 1e4], "at most 1000000 frames"),
    ],
)
def test_times_without_a_rate_are_rejected(times_s, message):
    n = len(times_s)
    with pytest.raises(InputError, match=message):
        at_one_rate(replace(track(n), times_s=np.array(times_s)))


def moving_at(times_s):
    """Return a track whose pelvis moves at 2 m/s along x and turns at 1 rad/s, through half a turn, at these times."""
    poses = np.zeros((len(times_s), 25))
    poses[:, 0], poses[:, 2] = 2.0 * times_s, 0.9
    poses[:, 3] = (3.0 + times_s + np.pi) % (2.0 * np.pi) - np.pi
    return Track(SKELETON, np.arange(len(times_s)), times_s, joints(SKELETON, poses), poses)


def test_a_variable_rate_gives_the_same_moments_in_every_format(tmp_path, caplog):
    """Half of the frames come at 30 Hz and half at 20 Hz."""
    times_s = np.concatenate([np.arange(20) / 30.0, 20.0 / 30.0 + np.arange(13) / 20.0])
    exported = moving_at(times_s)
    pelvis_m, resampled = {}, at_one_rate(exported)
    for suffix in (".trc", ".c3d"):
        export(tmp_path / f"walk{suffix}", exported)
        markers = read_markers(tmp_path / f"walk{suffix}")
        assert markers.rate_hz == pytest.approx(30.0)
        np.testing.assert_allclose(markers.positions, resampled.positions, atol=1e-6)
        pelvis_m[suffix] = np.arange(len(markers.positions)) / markers.rate_hz, markers.positions[:, 0, 0]
    export(tmp_path / "walk.mot", exported)
    rows = np.loadtxt((tmp_path / "walk.mot").read_text().split("endheader\n")[1].splitlines()[1:])
    pelvis_m[".mot"] = rows[:, 0], rows[:, 4]
    table = list(csv.DictReader(io.StringIO(csv_text(exported))))
    pelvis_m[".csv"] = tuple(np.array([float(row[key]) for row in table]) for key in ("time_s", "pelvis_x_m"))
    for moments_s, places_m in pelvis_m.values():
        assert moments_s[-1] == pytest.approx(times_s[-1], abs=1.0 / 30.0)
        np.testing.assert_allclose(places_m, 2.0 * moments_s, atol=1e-4)
    assert "resampled at 30 Hz" in caplog.text


def test_the_trc_reader_restores_the_world_axes_of_a_person_who_walks_sideways(tmp_path):
    """The pelvis moves along y, at a bend in the heading, with a missing frame."""
    exported = moving_at(np.arange(10) / 30.0)
    exported.poses[:, :2] = exported.poses[:, 1::-1]
    positions = joints(SKELETON, exported.poses)
    positions[4] = np.nan
    export(tmp_path / "walk.trc", replace(exported, positions=positions))
    np.testing.assert_allclose(read_markers(tmp_path / "walk.trc").positions, positions, atol=1e-6)


def test_a_frame_beside_a_missing_one_keeps_its_place(tmp_path):
    """New times that are those of a frame have its values; those between it and a missing frame are missing."""
    times_s = np.concatenate([np.arange(8) / 20.0, 0.4 + np.arange(8) / 40.0])
    exported = moving_at(times_s)
    exported.positions[3] = np.nan
    resampled = at_one_rate(exported)
    missing = np.isnan(resampled.positions).any(axis=(1, 2))
    since_s = resampled.times_s[missing]
    assert len(since_s) > 0
    assert ((since_s > times_s[2] + 1e-9) & (since_s < times_s[4] - 1e-9)).all()
    assert not missing[np.abs(resampled.times_s[:, None] - times_s[[2, 4]]).min(axis=1) < 1e-9].any()


def test_a_resampled_heading_does_not_turn_back():
    resampled = at_one_rate(moving_at(np.concatenate([np.arange(20) / 30.0, 20.0 / 30.0 + np.arange(13) / 20.0])))
    np.testing.assert_allclose(np.diff(resampled.poses[:, 3]), 1.0 / 30.0, atol=1e-9)


@pytest.mark.parametrize(("late_s", "resampled"), [(0.9e-3, False), (1.1e-3, True)])
def test_times_are_equal_within_the_rounding_of_containers(late_s, resampled):
    times_s = np.arange(50) / 30.0
    times_s[20] += late_s
    exported = moving_at(times_s)
    assert (at_one_rate(exported) is not exported) == resampled


@pytest.mark.parametrize(("gap_s", "missing"), [(0.45, False), (0.55, True)])
def test_longer_intervals_than_the_bridged_one_are_missing(gap_s, missing):
    times_s = np.concatenate([np.arange(20) / 30.0, 19.0 / 30.0 + gap_s + np.arange(20) / 30.0])
    assert np.isnan(at_one_rate(moving_at(times_s)).positions).any() == missing
