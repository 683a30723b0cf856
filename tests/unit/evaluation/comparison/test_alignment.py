"""Alignment of two motions in time and in space, against known transformations."""

import numpy as np
import pytest
import scipy
from scipy.spatial.transform import Rotation

from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.skeleton import JOINT_NAMES
from workbench.evaluation.comparison.alignment import (
    MAX_OFFSET_S,
    MIN_GAIN,
    NONE,
    RIGID,
    ROOT,
    SIMILARITY,
    aligned,
    offset_s,
    similarity,
)
from workbench.evaluation.comparison.joint_motion import JointMotion, with_pelvis
from workbench.motion.sources import find_motion

ROTATION = Rotation.from_euler("xyz", [0.3, -1.2, 2.0]).as_matrix()
AWAY_M = np.array([3.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def walk():
    motion = find_motion("builtin", data=None, rate_hz=100.0)
    places = joints(person(motion.shape).skeleton, motion.poses[:500])
    return motion_of(np.arange(500) / 100.0, places)


def motion_of(times_s, places, samples=None):
    samples = np.empty((0, *places.shape)) if samples is None else samples
    return JointMotion("file", JOINT_NAMES, times_s, places, samples)


@pytest.mark.parametrize("scaled", [False, True])
def test_a_similarity_is_recovered(scaled):
    rng = np.random.default_rng(0)
    own = rng.standard_normal((5, 4, 3))
    own[0, 0] = np.nan
    scale = 1.3 if scaled else 1.0
    found = similarity(own, scale * own @ ROTATION.T + [1.0, 2.0, 3.0], scaled)
    np.testing.assert_allclose(found.rotation, ROTATION, atol=1e-12)
    np.testing.assert_allclose([found.scale, *found.translation], [scale, 1.0, 2.0, 3.0], atol=1e-12)
    assert found.angle_deg == pytest.approx(np.degrees(Rotation.from_matrix(ROTATION).magnitude()))


def test_a_mirrored_person_is_not_reflected():
    own = np.random.default_rng(0).standard_normal((20, 3))
    assert np.linalg.det(similarity(own, own * [1.0, 1.0, -1.0], scaled=True).rotation) == pytest.approx(1.0)


def test_fewer_than_three_points_determine_nothing():
    assert similarity(np.zeros((2, 3)), np.zeros((2, 3)), scaled=False) is None


def test_each_alignment_removes_what_it_names(walk):
    places = walk.positions[::10]
    moved = places @ ROTATION.T + AWAY_M
    true = motion_of(walk.times_s[::10], places)

    def error(own, kind):
        estimate, truth, samples = aligned(motion_of(true.times_s, own, own[None]), true, kind)
        np.testing.assert_allclose(samples[0], estimate)
        return np.abs(estimate - truth).max()

    assert error(places + AWAY_M, NONE) == pytest.approx(3.0)
    assert error(places + AWAY_M, ROOT) < 1e-12
    assert error(moved, ROOT) > 0.1
    assert error(moved, RIGID) < 1e-12
    assert error(1.1 * moved, RIGID) > 0.01
    assert error(1.1 * moved, SIMILARITY) < 1e-12


@pytest.mark.parametrize("offset", [-0.5, -0.1, 0.33, 0.55])
def test_the_offset_of_two_clocks_is_found_whatever_the_axes(walk, offset):
    times_s = np.arange(1.5, 3.5, 1.0 / 30.0)
    own = walk.at(times_s)
    noisy = own.positions @ ROTATION.T + 0.005 * np.random.default_rng(0).standard_normal(own.positions.shape)
    assert offset_s(motion_of(times_s - offset, noisy), walk) == pytest.approx(offset, abs=0.005)


def test_of_equal_cycles_the_smallest_offset_is_taken(walk):
    own = walk.at(np.arange(1.5, 3.5, 1.0 / 30.0))
    cycle_s = 1.196  # of the generated walker
    found = offset_s(motion_of(own.times_s - cycle_s, own.positions), walk)
    assert abs(found) < 0.1


def test_equal_rates_give_whole_frames(walk):
    own = motion_of(walk.times_s[:-7], walk.positions[7:])
    assert offset_s(own, walk) == pytest.approx(0.07, abs=1e-12)


def difference(estimate, truth):
    """Return the root mean square difference of all distances between joints, less each pair's mean."""
    pairs = [(a, b) for a in range(15) for b in range(a)]
    own, true = (
        np.stack([np.linalg.norm(each[:, a] - each[:, b], axis=1) for a, b in pairs]) for each in (estimate, truth)
    )
    residuals = own - true
    return np.sqrt(np.mean((residuals - residuals.mean(axis=1, keepdims=True)) ** 2))


@pytest.mark.parametrize(("gain", "accepted"), [(MIN_GAIN - 0.02, False), (MIN_GAIN + 0.02, True)])
def test_an_offset_is_accepted_if_it_clearly_helps(gain, accepted):
    shift, times_s, rng = 10, np.arange(200) / 50.0, np.random.default_rng(1)
    places = np.tile(5.0 * rng.standard_normal((15, 3)), (200, 1, 1))
    places[:, 0, 0] += np.cumsum(rng.standard_normal(200)) * 0.02
    own, noise = places[shift:], rng.standard_normal((200 - shift, 15, 3))

    def excess(size):
        noisy = own + size * noise
        return 1.0 - difference(noisy, own) / difference(noisy, places[:-shift]) - gain

    size = scipy.optimize.brentq(excess, 1e-6, 1.0)
    found = offset_s(motion_of(times_s[:-shift], own + size * noise), motion_of(times_s, places))
    assert found == pytest.approx(shift / 50.0 if accepted else 0.0, abs=1e-9)


@pytest.mark.parametrize("offset", [-MAX_OFFSET_S, MAX_OFFSET_S])
def test_offsets_are_searched_up_to_a_limit(offset):
    times_s, places = np.arange(300) / 64.0, np.random.default_rng(1).standard_normal((300, 15, 3)).cumsum(axis=0)
    for factor, is_reached in ((1.0, True), (1.0 + 1.0 / 64.0 / MAX_OFFSET_S, False)):  # or beyond it by a frame
        found = offset_s(motion_of(times_s - factor * offset, places), motion_of(times_s, places))
        assert (found == pytest.approx(factor * offset, abs=1e-9)) == is_reached


def test_positions_are_interpolated_and_gaps_are_not():
    times_s = np.array([0.0, 0.1, 0.2, 0.35, 0.51, 0.6])
    places = np.tile(times_s[:, None, None], (1, 15, 3))
    motion = motion_of(times_s, places, places[None])
    found = motion.at(np.array([-0.01, 0.0, 0.05, 0.3, 0.44, 0.6, 0.61]))
    expected = [np.nan, 0.0, 0.05, 0.3, np.nan, 0.6, np.nan]  # 0.15 s is 1.5 intervals, 0.16 s is more
    np.testing.assert_allclose(found.positions[:, 0, 0], expected)
    np.testing.assert_allclose(found.samples[0, :, 3, 1], expected)


def test_the_pelvis_is_between_the_hips_where_no_joint_has_its_name():
    places = np.arange(9.0).reshape(1, 3, 3)
    names, found = with_pelvis(("left_knee", "right_hip", "left_hip"), places)
    assert names == ("pelvis", "left_hip", "left_knee", "right_hip")
    np.testing.assert_allclose(found[0], [places[0, 1:].mean(axis=0), places[0, 2], places[0, 0], places[0, 1]])
