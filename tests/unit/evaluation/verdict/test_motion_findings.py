"""Findings on the estimated motion, and their thresholds on both sides."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from verdict_scenes import BODY, HEIGHT_M, RATE_HZ, scene, walk

from workbench.body.kinematics import joints
from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES
from workbench.evaluation.verdict.walk_ratio import steps_of
from workbench.motion.synthetic.run_gait import average_runner, runner

ONE = scene(1)


def kinds(intact):
    """Return the messages of a scene's findings by kind."""
    return {finding.kind: finding.message for finding in intact.verdict().findings}


def moving(poses, rate_hz=RATE_HZ, body=BODY):
    """Return the scene of other poses, which begin 2 m left of the camera, without errors of the detector."""
    poses = poses.copy()
    poses[:, :2] -= poses[0, :2] + [2.0, 0.0]
    keypoints = ONE.cameras[0].project(joints(body.skeleton, poses))
    keypoints = np.concatenate([keypoints, np.ones_like(keypoints[..., :1])], axis=-1)[None]
    times_s = np.arange(len(poses)) / rate_hz
    return replace(ONE, keypoints=keypoints, poses=poses, times_s=times_s, body=body)


@pytest.mark.parametrize("rate_hz", [15.0, 30.0, 60.0])
def test_a_run_with_flight_phases_has_no_findings(rate_hz):
    subject = replace(average_runner(), shape=from_height(HEIGHT_M))
    run = runner(subject, 1.4, rate_hz)
    assert kinds(replace(moving(run.poses, rate_hz), inputs=replace(ONE.inputs, rate_hz=rate_hz))) == {}


def stepping(length_m, per_min, n_steps, height_m=1.7, apart_m=None):
    """Return joints (F, J, 3) and times (F,) of a person who steps along x, with feet up to 0.8 steps apart."""
    apart_m = 0.8 * length_m if apart_m is None else apart_m
    times_s = np.arange(0.0, (n_steps + 1.0) * 60.0 / per_min, 0.01)
    places = np.zeros((len(times_s), len(JOINT_NAMES), 3))
    places[..., 0] = (length_m * per_min / 60.0 * times_s)[:, None]
    for side, sign in (("left", 1.0), ("right", -1.0)):
        places[:, JOINT_NAMES.index(f"{side}_hip"), 1] = sign * 0.05 * height_m
        swing = 0.5 * apart_m * np.cos(np.pi * times_s * per_min / 60.0)
        places[:, JOINT_NAMES.index(f"{side}_ankle"), 0] += sign * swing
    return places, times_s


@pytest.mark.parametrize("heading_deg", [0.0, 60.0])
@pytest.mark.parametrize("height_m", [1.2, 1.7])
def test_the_walk_ratio_is_step_length_over_cadence(height_m, heading_deg):
    length_m = 0.65 * height_m / 1.7
    places, times_s = stepping(length_m, 100.0, 6, height_m)
    places = places @ Rotation.from_euler("z", heading_deg, degrees=True).as_matrix().T
    steps = steps_of(places, times_s, height_m)
    assert (steps.length_m, steps.cadence_per_min) == pytest.approx((length_m, 100.0))
    assert steps.relative_ratio == pytest.approx((1.7 / height_m) ** 0.5)


@pytest.mark.parametrize(("length_m", "n_steps", "known"), [(0.7, 2, False), (0.7, 3, True), (0.16, 9, False)])
def test_few_or_small_steps_have_no_walk_ratio(length_m, n_steps, known):
    """Between four crossings of the ankles there are three steps."""
    assert (steps_of(*stepping(length_m, 100.0, n_steps), 1.7) is not None) == known


@pytest.mark.parametrize(
    ("length_m", "apart_m", "known"), [(0.7, 0.168, False), (0.7, 0.172, True), (0.168, 0.5, False), (0.172, 0.5, True)]
)
def test_steps_and_the_distance_of_the_feet_are_a_tenth_of_the_height(length_m, apart_m, known):
    assert (steps_of(*stepping(length_m, 100.0, 6, 1.7, apart_m), 1.7) is not None) == known


@pytest.mark.parametrize(
    ("ratio", "rate"), [(1.57, ""), (1.63, "low"), (1.0 / 1.57, ""), (1.0 / 1.63, "high"), (0.25, "high")]
)
def test_a_rate_that_does_not_fit_the_steps_is_reported(ratio, rate):
    usual = steps_of(joints(BODY.skeleton, walk()), ONE.times_s, HEIGHT_M).relative_ratio
    inputs = replace(ONE.inputs, rate_hz=None)
    found = kinds(replace(ONE, times_s=ratio / usual * ONE.times_s, inputs=inputs)).get("frame-rate mismatch", "")
    assert f"the rate of the frames is too {rate}" in found if rate else not found
