"""The support that the accelerations of a swaying body need, and the thresholds of the finding on both sides."""

from dataclasses import replace

import numpy as np
import pytest
from verdict_scenes import BODY, HEIGHT_M, RATE_HZ, scene, walk

from workbench.body.centre_of_mass import centre_of_mass
from workbench.body.kinematics import joints
from workbench.body.shape import ANKLE_HEIGHT
from workbench.body.skeleton import JOINT_NAMES
from workbench.evaluation.verdict import support_findings
from workbench.evaluation.verdict.support_findings import support_distances

WEIGHTS = centre_of_mass(JOINT_NAMES)
ANKLES = [JOINT_NAMES.index("left_ankle"), JOINT_NAMES.index("right_ankle")]
STANDING = joints(BODY.skeleton, np.eye(1, 25, 2) * 0.95)[0]
REACH_M = support_findings._REACH * HEIGHT_M
RATE = 100.0


def swaying(amplitude_m, hz, n=300, rate_hz=RATE):
    """Return joints (n, J, 3) of a person whose centre of mass swings along x, on ankles at rest, and times (n,)."""
    times_s, above = np.arange(n) / rate_hz, np.ones(len(JOINT_NAMES))
    above[ANKLES] = 0.0
    shift = amplitude_m * np.sin(2.0 * np.pi * hz * times_s) / (WEIGHTS @ above)
    return STANDING + shift[:, None, None] * above[:, None] * [1.0, 0.0, 0.0], times_s


def test_the_support_is_that_of_a_pendulum():
    """At rest, x = A sin ωt needs A (1 + ω² h / g) sin ωt."""
    places, times_s = swaying(0.05, 0.5)
    pressure_m, mass_m = support_distances(places, times_s, HEIGHT_M)
    resting = float(WEIGHTS @ (STANDING[:, 0] - STANDING[ANKLES[0], 0]))
    height_m = WEIGHTS @ STANDING[:, 2] - STANDING[ANKLES[0], 2] + ANKLE_HEIGHT * HEIGHT_M
    sway = 0.05 * np.sin(np.pi * times_s)
    known = np.isfinite(pressure_m)
    assert known.sum() == 300 - 24
    expected = np.abs(resting + sway * (1.0 + np.pi**2 * height_m / 9.81))
    np.testing.assert_allclose(pressure_m[known], expected[known], atol=1e-3)
    np.testing.assert_allclose(mass_m[known], np.abs(resting + sway)[known], atol=1e-9)


def test_a_turned_person_needs_the_same_support():
    places, times_s = swaying(0.05, 0.5)
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    for turned, straight in zip(
        support_distances(places @ turn.T + [1.0, 2.0, 3.0], times_s, HEIGHT_M),
        support_distances(places, times_s, HEIGHT_M), strict=True,
    ):  # fmt: skip
        np.testing.assert_allclose(turned, straight, atol=1e-9)


def test_nothing_supports_a_flying_body():
    places, times_s = swaying(0.0, 1.0)
    falling = places + (-0.5 * 9.81 * times_s**2)[:, None, None] * [0.0, 0.0, 1.0]
    assert np.isnan(support_distances(falling, times_s, HEIGHT_M)[0]).all()


@pytest.mark.parametrize(("share", "is_known"), [(0.51, True), (0.49, False)])
def test_half_the_weight_must_be_on_the_feet(share, is_known):
    places, times_s = swaying(0.0, 1.0)
    sinking = places - (0.5 * (1.0 - share) * 9.81 * times_s**2)[:, None, None] * [0.0, 0.0, 1.0]
    assert np.isfinite(support_distances(sinking, times_s, HEIGHT_M)[0]).any() == is_known


@pytest.mark.parametrize(("rate_hz", "is_known"), [(11.9, False), (12.1, True)])
def test_slow_frames_show_no_accelerations(rate_hz, is_known):
    """A window of a quarter of a second has five frames from 12 Hz on, by rounding."""
    places, times_s = swaying(0.05, 0.5, n=60, rate_hz=rate_hz)
    assert np.isfinite(support_distances(places, times_s, HEIGHT_M)[0]).any() == is_known


@pytest.mark.parametrize(("late", "is_known"), [(0.09, True), (0.11, False)])
def test_uneven_steps_are_omitted(late, is_known):
    places, times_s = swaying(0.05, 0.5)
    times_s[150:] += late / RATE
    assert np.isfinite(support_distances(places, times_s, HEIGHT_M)[0][150]) == is_known


def of_swaying(amplitude_m, hz=1.5, n=120, mass_m=0.0):
    """Return measurements of a person who sways, at RATE_HZ, with a centre of mass that is on average mass_m ahead."""
    intact, poses = scene(1), np.repeat(walk()[:1], n, axis=0)
    keypoints = np.repeat(intact.keypoints[:, :1], n, axis=1)
    measured = replace(intact, keypoints=keypoints, poses=poses, times_s=np.arange(n) / RATE_HZ).measurements()
    places, _ = swaying(amplitude_m, hz, n, RATE_HZ)
    resting = float(WEIGHTS @ (STANDING[:, 0] - STANDING[ANKLES[0], 0]))
    places[:, ANKLES, 0] += (resting - mass_m) / (1.0 - WEIGHTS[ANKLES].sum())
    return replace(measured, estimated_joints=places)


def median_support_m(measured):
    pressure_m, _ = support_distances(measured.estimated_joints, measured.times_s, HEIGHT_M)
    return float(np.nanmedian(pressure_m))


@pytest.mark.parametrize(("factor", "is_reported"), [(0.98, False), (1.02, True)])
def test_a_support_beyond_the_toes_is_reported(factor, is_reported):
    amplitude_m = 0.02 * factor * REACH_M / median_support_m(of_swaying(0.02))
    measured = of_swaying(amplitude_m)
    findings = list(support_findings.support_findings(measured))
    assert [finding.kind for finding in findings] == ["frame-rate mismatch"] * is_reported


@pytest.mark.parametrize(("share", "is_reported"), [(0.8, True), (1.2, False)])
def test_a_centre_of_mass_that_is_not_over_the_feet_is_supported_elsewhere(share, is_reported):
    """Such as by a chair."""
    measured = of_swaying(0.02, hz=3.0, mass_m=share * REACH_M)
    assert median_support_m(measured) > REACH_M
    assert len(list(support_findings.support_findings(measured))) == is_reported


@pytest.mark.parametrize(("n", "is_reported"), [(25, False), (26, True)])
def test_twenty_frames_show_a_support(n, is_reported):
    """At 25 Hz, three frames at each end have no window."""
    measured = of_swaying(0.05, hz=3.0, n=n)
    assert len(list(support_findings.support_findings(measured))) == is_reported


def test_a_walk_is_on_its_feet():
    assert not list(support_findings.support_findings(scene(1).measurements()))


def test_true_positions_decide_instead():
    measured = of_swaying(0.05, hz=3.0)
    assert list(support_findings.support_findings(measured))
    with_truth = replace(measured, errors={"mpjpe_abs_mm": np.zeros(len(measured.frames))})
    assert not list(support_findings.support_findings(with_truth))
