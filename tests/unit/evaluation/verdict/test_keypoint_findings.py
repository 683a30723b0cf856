"""Findings on keypoints that no person has, and their thresholds on both sides."""

from dataclasses import replace

import numpy as np
import pytest
from verdict_scenes import N, scene

from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES
from workbench.evaluation.verdict.keypoint_findings import _disorder, _longest_limb, _speed, keypoint_findings
from workbench.motion.synthetic.run_gait import average_runner, runner

ONE, FOUR = scene(1), scene(4)
RNG = np.random.default_rng(7)


def levels(intact):
    """Return the levels of a scene's findings by kind."""
    return {finding.kind: finding.level for finding in intact.verdict().findings}


def with_pixels(intact, change):
    """Return the scene with changed pixels (N, J, 2) of each camera."""
    keypoints = intact.keypoints.copy()
    keypoints[..., :2] = [change(pixels) for pixels in keypoints[..., :2]]
    return replace(intact, keypoints=keypoints)


@pytest.mark.parametrize("intact", [ONE, FOUR])
def test_shuffled_frames_random_points_and_permuted_joints_are_reported(intact):
    order, permuted = RNG.permutation(N), np.roll(np.arange(len(JOINT_NAMES)), 7)
    assert levels(with_pixels(intact, lambda pixels: pixels[order]))["impossible motion"] == "not usable"
    drawn = levels(with_pixels(intact, lambda pixels: RNG.uniform(0.0, 900.0, pixels.shape)))
    assert (drawn["impossible motion"], drawn["impossible proportions"]) == ("not usable", "not usable")
    assert "impossible proportions" in levels(with_pixels(intact, lambda pixels: pixels[:, permuted]))


@pytest.mark.parametrize(("step_s", "n_findings"), [(0.04, 2), (0.0, 0), (-0.04, 0)])
def test_times_that_do_not_increase_give_no_findings(step_s, n_findings):
    drawn = with_pixels(ONE, lambda pixels: RNG.uniform(0.0, 900.0, pixels.shape))
    times_s = ONE.times_s.copy()
    times_s[30:] += times_s[29] + step_s - times_s[30]
    findings = [each.kind for each in keypoint_findings(replace(drawn, times_s=times_s).measurements())]
    assert findings.count("impossible proportions") == n_findings // 2
    assert bool(findings) == bool(n_findings)


@pytest.mark.parametrize("rate_hz", [15.0, 30.0, 60.0])
@pytest.mark.parametrize("sigma", [0.0, 0.015])
def test_a_run_on_a_treadmill_is_in_order(rate_hz, sigma):
    subject = average_runner()
    places = joints(person(subject.shape).skeleton, runner(subject, 4.0, rate_hz).poses)[..., [0, 2]]
    places = 1.5 * (places - places[:, :1]) / 1.75 + RNG.normal(0.0, sigma, places.shape)
    assert 0.0 < _disorder(places, np.arange(len(places)) / rate_hz) < 0.6
    assert _disorder(RNG.permutation(places), np.arange(len(places)) / rate_hz) > 0.75


@pytest.mark.parametrize(
    ("n", "rate_hz", "amplitude", "is_known"),
    [(14, 30.0, 1.0, False), (15, 30.0, 1.0, True), (30, 14.0, 1.0, False), (30, 16.0, 1.0, True),
     (1000, 30.0, 0.038, False), (1000, 30.0, 0.053, True)],
)  # fmt: skip
def test_the_order_of_few_slow_or_still_frames_is_unknown(n, rate_hz, amplitude, is_known):
    """The distance between two draws of deviation σ in the plane is 1.18 √2 σ in the median."""
    drawn = np.repeat(np.random.default_rng(3).normal(0.0, amplitude, (n, 1, 2)), 15, axis=1)
    assert (_disorder(drawn, np.arange(n) / rate_hz) > 0.0) == is_known


@pytest.mark.parametrize(("speed", "is_finding"), [(6.9, False), (7.1, True)])
def test_nobody_moves_faster_than_a_sprinter(speed, is_finding):
    times_s = np.arange(60) / 30.0
    places = np.zeros((60, 15, 2)) + (speed * times_s)[:, None, None] * [1.0, 0.0]
    assert _speed(places, times_s) == pytest.approx(speed)
    heights = np.ptp(ONE.keypoints[0, :, :, 1], axis=1)
    keypoints = ONE.keypoints.copy()
    keypoints[..., 0] += speed * np.median(heights) * np.arange(N)[:, None] / 25.0 - 3e3
    walking = float(_speed(ONE.keypoints[0, ..., :2] / np.median(heights), ONE.times_s))
    keypoints[..., 0] -= walking * np.median(heights) * np.arange(N)[:, None] / 25.0
    text = replace(ONE, keypoints=keypoints).verdict().message
    assert ("heights of the person per second" in text) == is_finding


@pytest.mark.parametrize(("ratio", "level"), [(1.9, None), (2.1, "doubtful"), (2.9, "doubtful"), (3.1, "not usable")])
def test_a_limb_too_long_for_the_height_is_no_persons(ratio, level):
    intact = ONE.keypoints[0, ..., :2]
    elbow, wrist = JOINT_NAMES.index("left_elbow"), JOINT_NAMES.index("left_wrist")
    heights = np.ptp(intact[..., 1], axis=1)

    def stretched(pixels):
        pixels = pixels.copy()
        pixels[:, wrist] = pixels[:, elbow] + [0.0, 1.0] * (ratio * from_height(1.0).forearm * heights)[:, None]
        return pixels

    pixels = stretched(intact)
    assert _longest_limb(pixels) == pytest.approx(ratio, rel=0.01)
    assert levels(with_pixels(ONE, stretched)).get("impossible proportions") == level


def test_a_person_without_feet_has_unknown_proportions():
    pixels = ONE.keypoints[0, ..., :2].copy()
    pixels[:, [JOINT_NAMES.index("left_ankle"), JOINT_NAMES.index("right_ankle")]] = np.nan
    assert _longest_limb(pixels) == 0.0
