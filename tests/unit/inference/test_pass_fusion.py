"""Fusion of two passes as two samples, with weights of each limb by its distance and its image likelihood."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stub_likelihoods import StubFrameLikelihood

from tests.oracles.kinematics import forward as forward_oracle
from workbench.body.shape import from_height
from workbench.body.skeleton import POSE_NAMES, person_skeleton
from workbench.core.frame import Frame
from workbench.core.likelihood import DenseLikelihood, Derivatives
from workbench.inference.ekf.gaussian_state import LIKELIHOOD_POWER, PASS_STD_M, first_pass_weights, fuse_passes
from workbench.inference.ekf.iterated_ekf import IteratedEkf
from workbench.priors.smooth import Smooth
from workbench.utils.rng import stream

N = len(POSE_NAMES)
SKELETON = person_skeleton(from_height(1.75))
ARM, LEG = (
    np.array([k for k, name in enumerate(POSE_NAMES) if name.startswith(prefixes)])
    for prefixes in (("left_shoulder", "left_elbow"), ("right_hip", "right_knee"))
)


class Image(StubFrameLikelihood):
    """A log likelihood that is the sum of the angles of the arm, twice those of the leg, and an interaction."""

    def __init__(self, interaction=0.0):
        self.interaction = interaction

    def compare(self, poses, moved):
        assert moved.all()
        arm, leg = poses[:, ARM].sum(axis=1), poses[:, LEG].sum(axis=1)
        return 100.0 * poses[:, 0] + arm + 2.0 * leg + self.interaction * arm * leg


def two_poses(seed):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (2, N))


def distance_odds(pose, other):
    first, second = forward_oracle(SKELETON, np.stack([pose, other])).positions
    return PASS_STD_M**2 / (PASS_STD_M**2 + np.linalg.norm(first - second, axis=1).mean() ** 2)


@pytest.mark.parametrize("seed", range(3))
def test_limbs_are_weighted_by_their_image_likelihood(seed):
    pose, other = two_poses(seed)
    assert isinstance(Image(), DenseLikelihood)
    other = pose + 0.02 * other  # a typical difference of two passes
    weights, prior_odds = first_pass_weights(Image(), SKELETON, [ARM, LEG], pose, other), distance_odds(pose, other)
    for limb, gradient in ((ARM, 1.0), (LEG, 2.0)):
        odds = prior_odds * np.exp(LIKELIHOOD_POWER * gradient * (other[limb] - pose[limb]).sum())
        np.testing.assert_allclose(weights[limb], odds / (1.0 + odds))
    rest = np.setdiff1d(np.arange(N), [*ARM, *LEG])
    np.testing.assert_allclose(weights[rest], prior_odds / (1.0 + prior_odds))


@pytest.mark.parametrize(
    ("distance_m", "weight"), [(0.0, 0.5), (PASS_STD_M, 1.0 / 3.0), (10.0 * PASS_STD_M, 1.0 / 102.0)]
)
def test_the_weight_of_the_first_pass_decreases_with_the_distance(distance_m, weight):
    pose, _ = two_poses(0)
    other = pose.copy()
    other[1] += distance_m
    np.testing.assert_allclose(first_pass_weights(Image(), SKELETON, [ARM], pose, other), weight)


@pytest.mark.parametrize("seed", range(3))
def test_the_image_likelihood_treats_both_passes_alike(seed):
    """The arm is compared in the middle of both poses of the leg."""
    pose, other = two_poses(seed)
    odds, reversed_odds = (
        weights[ARM] / (1.0 - weights[ARM])
        for weights in (
            first_pass_weights(Image(interaction=3.0), SKELETON, [ARM, LEG], *poses)
            for poses in ((pose, other), (other, pose))
        )
    )
    prior_odds, leg = distance_odds(pose, other), 0.5 * (pose[LEG].sum() + other[LEG].sum())
    image_odds = np.exp(LIKELIHOOD_POWER * (1.0 + 3.0 * leg) * (other[ARM] - pose[ARM]).sum())
    np.testing.assert_allclose(odds, prior_odds * image_odds)
    np.testing.assert_allclose(reversed_odds, prior_odds / image_odds)


def test_a_pass_of_negligible_image_likelihood_has_weight_zero():
    (pose, other), image = two_poses(0), Image()
    pose[ARM], other[ARM] = 0.0, 1.0
    image.compare = lambda poses, moved: 1e5 * poses[:, ARM].sum(axis=1)
    for poses, weight in (((pose, other), 1.0), ((other, pose), 0.0)):
        np.testing.assert_array_equal(first_pass_weights(image, SKELETON, [ARM], *poses)[ARM], weight)


def test_whole_turns_do_not_change_weights_or_means():
    pose, other = two_poses(0)
    turned = other.copy()
    turned[[5, ARM[1]]] += 2.0 * np.pi
    weights, turned_weights = (first_pass_weights(Image(), SKELETON, [ARM, LEG], pose, end) for end in (other, turned))
    np.testing.assert_allclose(turned_weights, weights)
    state, unit = np.linspace(-1.0, 1.0, 2 * N), np.eye(2 * N)
    turned = state.copy()
    turned[5] += 2.0 * np.pi
    mean, covariance = fuse_passes(turned, state, unit, weights)
    np.testing.assert_allclose(mean, state)
    np.testing.assert_allclose(covariance, unit)


@given(weight=st.floats(0.01, 0.99), seed=st.integers(0, 1000))
def test_the_fused_moments_are_those_of_weighted_samples(weight, seed):
    first, second = np.random.default_rng(seed).uniform(-1.0, 1.0, (2, 2 * N))
    mean, covariance = fuse_passes(first, second, np.zeros((2 * N, 2 * N)), np.full(N, weight))
    np.testing.assert_allclose(mean[:N], weight * first[:N] + (1.0 - weight) * second[:N])
    np.testing.assert_allclose(mean[N:], 0.5 * (first[N:] + second[N:]))  # velocities have equal weights
    samples = np.stack([first, second]).T
    expected = 2.0 * np.cov(samples[:N], aweights=[weight, 1.0 - weight], ddof=0)
    np.testing.assert_allclose(covariance[:N, :N], expected, atol=1e-12)
    np.testing.assert_allclose(covariance[N:, N:], np.cov(samples[N:]), atol=1e-12)


class TwoPasses(Image):
    """A likelihood with another mode of the arm in the second pass, whose image prefers the mode of the first."""

    def __init__(self, mode, image_precision, n_passes=2):
        super().__init__()
        self.mode, self.image_precision, self.n_passes = mode, image_precision, n_passes

    def refitted(self, frame, poses):
        return TwoPasses(-self.mode, self.image_precision, n_passes=1)

    def compare(self, poses, moved):
        precision = 0.0 if self.n_passes == 2 else self.image_precision
        return -precision * ((poses[:, ARM] - 0.1) ** 2).sum(axis=1)

    def derivatives(self, pose, level, derive=True):
        deviation, precision = np.zeros(N), np.zeros((N, N))
        deviation[ARM] = pose[ARM] - self.mode
        precision[ARM, ARM] = 1e4
        return Derivatives(-0.5 * 1e4 * float(deviation @ deviation), -1e4 * deviation, precision)


@pytest.mark.parametrize("image_precision", [0.0, 50.0])
def test_the_reported_limb_is_the_weighted_mean_of_both_passes(image_precision):
    frames, body = [Frame(k, k / 30.0, (), None) for k in range(4)], SimpleNamespace(skeleton=SKELETON)
    start = np.clip(np.zeros(N), *SKELETON.limits.T)
    start[ARM] = 0.2
    streams = {name: stream(0, name) for name in ("resampling", "prior")}
    likelihood = TwoPasses(np.full(len(ARM), 0.1), image_precision)
    tracker = IteratedEkf(Smooth(), likelihood, body, n_particles=2, curvature_weight=1.0)
    arms = np.array([step.expected_pose[ARM] for step in tracker.run(frames, start, streams)])
    first, second = start.copy(), start.copy()
    first[ARM], second[ARM] = 0.1, -0.1
    odds = distance_odds(second, first) * np.exp(LIKELIHOOD_POWER * image_precision * len(ARM) * 0.2**2)
    np.testing.assert_allclose(arms[1:], 0.1 * (odds - 1.0) / (odds + 1.0), atol=0.003)
