"""Findings on the estimated motion, and their thresholds on both sides."""

from dataclasses import replace

import numpy as np
import pytest
from verdict_scenes import BODY, HEIGHT_M, RATE_HZ, N, scene, walk

from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
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


@pytest.mark.parametrize(("drift_m_s", "percent"), [(0.0, 0), (1.0, 0), (1.1, 50)])
def test_a_standing_foot_that_slides_at_half_the_speed_is_reported(drift_m_s, percent):
    poses = walk().copy()
    poses[:, 0] += drift_m_s * np.arange(N) / RATE_HZ
    message = kinds(replace(ONE, poses=poses)).get("ground contact", "")
    assert (f"slides at {percent}%" in message) if percent else not message


@pytest.mark.parametrize(("factor", "is_finding"), [(1.33, False), (1.36, True), (0.75, False), (0.73, True)])
def test_a_limb_out_of_proportion_is_reported(factor, is_finding):
    """A limb counts as a quarter of the expected height: 1.35 is 1.25 of the expected length, 0.74 the inverse."""
    body = person(from_height(HEIGHT_M, forearm=factor * from_height(HEIGHT_M).forearm))
    assert ("implausible limb lengths" in kinds(replace(ONE, body=body))) == is_finding
