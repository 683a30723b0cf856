"""Foot strikes, toe-offs and steps agree with force plates and recorded walks."""

import numpy as np
import pytest
from walking_scenes import scene

from workbench.body.skeleton import JOINT_NAMES
from workbench.evaluation.gait.foot_events import foot_events
from workbench.evaluation.gait.stretches import stretch_of
from workbench.motion.formats.markers import read_markers
from workbench.motion.sources import load_motion

LOADED_N = 20.0
"""Force from which on a foot is on a plate."""


def bmc(data):
    folder = data / "bmc"
    if not folder.is_dir():
        pytest.skip(f"no recordings with force plates in {folder}")
    return folder


def stretch_of_markers(times_s, points, height_m):
    """Return the stretch of markers (F, 3) by joint, z up, low-passed and without gaps."""
    names = [*JOINT_NAMES, *(name for name in points if name not in JOINT_NAMES)]
    joints = np.zeros((1, len(times_s), len(names), 3))
    for name, places in points.items():
        joints[0, :, names.index(name)] = places
    return stretch_of(names, joints, np.zeros((1, len(times_s), 1)), times_s, np.arange(len(times_s)))


def nearest(times_s, expected_s):
    return float(np.abs(np.asarray(times_s) - expected_s).min())


def points_of(markers, rows, names):
    """Return the places (F, 3) of pelvis, hips, ankles and heels from markers, by their names without the side."""
    points = {}
    for side, letter in (("left", "L"), ("right", "R")):
        for joint, marker in names.items():
            points[f"{side}_{joint}"] = markers.positions[rows, markers.names.index(letter + marker)]
    points["pelvis"] = 0.5 * (points["left_hip"] + points["right_hip"])
    return points


@pytest.mark.parametrize("striking", ["ANK", "HEE"])
def test_strikes_and_toe_offs_of_a_walker_agree_with_force_plates(data, striking):
    ezc3d = pytest.importorskip("ezc3d")
    path = bmc(data) / "Gait.c3d"
    markers = read_markers(path)
    file = ezc3d.c3d(str(path), extract_forceplat_data=True)
    loaded = [np.flatnonzero(np.abs(plate["force"][2]) > LOADED_N) for plate in file["data"]["platform"]]
    rate_hz = file["parameters"]["ANALOG"]["RATE"]["value"][0]
    rows = np.arange(133, 327)  # with all markers
    points = points_of(markers, rows, {"hip": "ASI", "ankle": "ANK", "heel": striking})
    left, right = foot_events(stretch_of_markers(rows / markers.rate_hz, points, 1.75), 1.75, runs=False)
    for events, contact in ((left, loaded[0]), (right, loaded[1])):
        assert nearest(events.strikes_s[0], contact[0] / rate_hz) < 0.015
    # the left toe-off follows the last strike
    assert nearest(right.toe_offs_s[0], loaded[1][-1] / rate_hz) < 0.03


@pytest.mark.parametrize("striking", ["LMALv", "CAL"])
def test_strikes_and_toe_offs_of_a_runner_agree_with_force_plates(data, striking):
    markers = read_markers(bmc(data) / "motion_capture_run.trc")
    times_s = np.arange(len(markers.positions)) / markers.rate_hz
    points = points_of(markers, slice(None), {"hip": "ASI", "ankle": "LMALv", "heel": striking})
    left, right = foot_events(stretch_of_markers(times_s, points, 1.75), 1.75, runs=True)
    forces = np.loadtxt(bmc(data) / "grf_run.mot", skiprows=7)
    left_on, right_on = (forces[forces[:, column] > LOADED_N, 0] for column in (8, 2))
    assert nearest(left.strikes_s[0], left_on[0]) < 0.015
    assert nearest(right.toe_offs_s[0], right_on[-1]) < 0.04


@pytest.fixture(scope="module")
def walks(data):
    """Return recorded walks of nine people, at 30 Hz."""
    clips = ("02_01", "05_01", "06_01", "07_01", "08_01", "16_15", "35_02", "38_01", "39_01")
    return [load_motion(data / "cmu" / clip[:2] / f"{clip}.amc").resampled(30.0) for clip in clips]


def test_recorded_walks_have_usual_steps(walks):
    for motion in walks:
        walk = scene(motion).walk()
        assert not walk.is_run
        assert not walk.on_belt
        measures = {
            name: {side: float(each[0]) for side, each in sides.items()} for name, sides in walk.parameters.items()
        }
        assert 0.9 < measures["speed_m_s"]["both"] < 1.9
        assert 85.0 < measures["cadence_steps_min"]["both"] < 135.0
        assert 0.05 < measures["double_support_fraction"]["both"] < 0.3
        for side in ("left", "right"):
            assert 0.5 < measures["stance_fraction"][side] < 0.7
            travelled = measures["speed_m_s"]["both"] * measures["stride_time_s"][side]
            assert measures["stride_length_m"][side] == pytest.approx(travelled, rel=0.05)


def test_the_speed_of_a_treadmill_is_that_of_the_ground(walks):
    """The same walks, seen by a camera that travels along."""
    for motion in walks:
        ground = scene(motion)
        pelvis = ground.poses[0, :, :2]
        seconds = ground.times_s[-1] - ground.times_s[0]
        velocity = (pelvis[-1] - pelvis[0]) / seconds
        belt = scene(motion)
        belt.poses[0, :, :2] -= velocity * belt.times_s[:, None]
        expected, found = ground.walk().parameters, belt.walk()
        assert found.on_belt
        assert found.parameters["speed_m_s"]["both"][0] == pytest.approx(expected["speed_m_s"]["both"][0], rel=0.05)
        length, true_length = (each["step_length_m"]["left"][0] for each in (found.parameters, expected))
        assert length == pytest.approx(true_length, abs=0.04) or np.isnan(true_length)
