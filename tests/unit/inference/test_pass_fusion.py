"""Fusion of two passes: weighted samples, with weights by limb from the image likelihood."""

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
    np.array([k for k, name in enumerate(POSE_NAMES) if name.startswith(words)])
    for words in (("left_shoulder", "left_elbow"), ("right_hip", "right_knee"))
)
PIXELS = 50.0


class Image(StubFrameLikelihood):
    """Pixels that are likelier by the sum of a pose's arm, twice that of its leg, and what these do to each other."""

    def __init__(self, together=0.0):
        self.together = together

    def compare(self, poses, moved):
        assert moved.all()
        arm, leg = poses[:, ARM].sum(axis=1), poses[:, LEG].sum(axis=1)
        return 100.0 * poses[:, 0] + arm + 2.0 * leg + self.together * arm * leg


def two_poses(seed):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (2, N))


def odds_by_distance(pose, other):
    one, another = forward_oracle(SKELETON, np.stack([pose, other])).positions
    return PASS_STD_M**2 / (PASS_STD_M**2 + np.linalg.norm(one - another, axis=1).mean() ** 2)


@pytest.mark.parametrize("seed", range(3))
def test_limbs_are_weighed_by_how_likely_the_pixels_are_with_them(seed):
    pose, other = two_poses(seed)
    assert isinstance(Image(), DenseLikelihood)
    other = pose + 0.02 * other  # as far apart as looks are
    told, apart = first_pass_weights(Image(), SKELETON, [ARM, LEG], pose, other), odds_by_distance(pose, other)
    for limb, likelier in ((ARM, 1.0), (LEG, 2.0)):
        odds = apart * np.exp(LIKELIHOOD_POWER * likelier * (other[limb] - pose[limb]).sum())
        np.testing.assert_allclose(told[limb], odds / (1.0 + odds))
    rest = np.setdiff1d(np.arange(N), [*ARM, *LEG])
    np.testing.assert_allclose(told[rest], apart / (1.0 + apart))  # wherever the pixels would have the body


@pytest.mark.parametrize(("metres", "share"), [(0.0, 0.5), (PASS_STD_M, 1.0 / 3.0), (10.0 * PASS_STD_M, 1.0 / 102.0)])
def test_the_earlier_look_counts_less_the_farther_it_is(metres, share):
    pose, _ = two_poses(0)
    other = pose.copy()
    other[1] += metres
    np.testing.assert_allclose(first_pass_weights(Image(), SKELETON, [ARM], pose, other), share)


@pytest.mark.parametrize("seed", range(3))
def test_neither_body_is_preferred(seed):
    pose, other = two_poses(seed)
    frame_likelihood = Image(together=3.0)
    one, two = (
        first_pass_weights(frame_likelihood, SKELETON, [ARM, LEG], *poses) for poses in ((pose, other), (other, pose))
    )
    apart, middle = odds_by_distance(pose, other), 0.5 * (pose[LEG].sum() + other[LEG].sum())  # of either body's leg
    pixels = np.exp(LIKELIHOOD_POWER * (1.0 + 3.0 * middle) * (other[ARM] - pose[ARM]).sum())
    np.testing.assert_allclose(one[ARM] / (1.0 - one[ARM]), apart * pixels)
    np.testing.assert_allclose(two[ARM] / (1.0 - two[ARM]), apart / pixels)


def test_pixels_that_speak_for_one_look_alone_leave_nothing_to_the_other():
    (pose, other), frame_likelihood = two_poses(0), Image()
    pose[ARM], other[ARM] = 0.0, 1.0
    frame_likelihood.compare = lambda poses, moved: 1e5 * poses[:, ARM].sum(axis=1)
    for poses, share in (((pose, other), 1.0), ((other, pose), 0.0)):
        np.testing.assert_array_equal(first_pass_weights(frame_likelihood, SKELETON, [ARM], *poses)[ARM], share)


def test_whole_turns_are_no_difference():
    pose, other = two_poses(0)
    turned = other.copy()
    turned[[5, ARM[1]]] += 2.0 * np.pi
    told = [first_pass_weights(Image(), SKELETON, [ARM, LEG], pose, each) for each in (other, turned)]
    np.testing.assert_allclose(*told)
    state, unit = np.linspace(-1.0, 1.0, 2 * N), np.eye(2 * N)
    around = state.copy()
    around[5] += 2.0 * np.pi
    mean, covariance = fuse_passes(around, state, unit, told[0])
    np.testing.assert_allclose(mean, state)
    np.testing.assert_allclose(covariance, unit)


@given(share=st.floats(0.01, 0.99), seed=st.integers(0, 1000))
def test_both_are_weighed_samples(share, seed):
    first, second = np.random.default_rng(seed).uniform(-1.0, 1.0, (2, 2 * N))
    mean, covariance = fuse_passes(first, second, np.zeros((2 * N, 2 * N)), np.full(N, share))
    np.testing.assert_allclose(mean[:N], share * first[:N] + (1.0 - share) * second[:N])
    np.testing.assert_allclose(mean[N:], 0.5 * (first[N:] + second[N:]))
    samples = np.stack([first, second]).T
    expected = 2.0 * np.cov(samples[:N], aweights=[share, 1.0 - share], ddof=0)
    np.testing.assert_allclose(covariance[:N, :N], expected, atol=1e-12)
    unbiased = np.cov(samples[N:])  # of what counts as much by either
    np.testing.assert_allclose(covariance[N:, N:], unbiased, atol=1e-12)


class Twice(Image):
    """A likelihood whose points pull an arm to one place, and to another when it looks again; all pixels would have it
    where it was found first, and say nothing at first."""

    def __init__(self, place, pixels=0.0):
        super().__init__()
        self.place, self.pixels = place, pixels

    def refitted(self, frame, poses):
        return Twice(-self.place, PIXELS)

    def compare(self, poses, moved):
        return -self.pixels * ((poses[:, ARM] - 0.1) ** 2).sum(axis=1)

    def derivatives(self, pose, level, derive=True):
        off, precision = np.zeros(N), np.zeros((N, N))
        off[ARM] = pose[ARM] - self.place
        precision[ARM, ARM] = 1e4
        return Derivatives(-0.5 * 1e4 * float(off @ off), -1e4 * off, precision)


def test_what_is_told_of_a_limb_lies_nearer_to_the_look_that_the_pixels_speak_for():
    frames, body = [Frame(k, k / 30.0, (), None) for k in range(4)], SimpleNamespace(skeleton=SKELETON)
    start = np.clip(np.zeros(N), *SKELETON.limits.T)
    start[ARM] = 0.2

    def told(likelihood):
        streams = {name: stream(0, name) for name in ("resampling", "prior")}
        filtered = IteratedEkf(Smooth(), likelihood, body, n_particles=2, curvature_weight=1.0)
        return np.array([step.expected_pose[ARM] for step in filtered.run(frames, start, streams)])

    silent = Twice(np.full(len(ARM), 0.1))
    silent.refitted = lambda frame, poses: Twice(-silent.place)
    first, second = np.repeat(start[None], 2, axis=0)
    first[ARM], second[ARM] = silent.place, -silent.place
    apart = odds_by_distance(second, first)
    for likelihood, odds in (
        (silent, apart),
        (Twice(silent.place), apart * np.exp(LIKELIHOOD_POWER * PIXELS * len(ARM) * 0.2**2)),
    ):
        np.testing.assert_allclose(told(likelihood)[1:], 0.1 * (odds - 1.0) / (odds + 1.0), atol=0.003)
