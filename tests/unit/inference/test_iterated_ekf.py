"""The iterated extended Kalman filter: exact for linear Gaussian models, robust to outlier motion."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from stub_likelihoods import StubFrameLikelihood

from workbench.body.shape import from_height
from workbench.body.skeleton import POSE_NAMES, person_skeleton
from workbench.core.frame import Frame
from workbench.core.likelihood import Derivatives
from workbench.core.pose_prior import PosePrior
from workbench.inference.ekf.iterated_ekf import IteratedEkf
from workbench.inference.ekf.levenberg_marquardt import find_mode, heavy_tailed_prior
from workbench.likelihoods.uniform import Uniform
from workbench.motion.models.linear_motion import LinearMotion
from workbench.priors.linear import Linear
from workbench.priors.smooth import Smooth
from workbench.utils.errors import InputError
from workbench.utils.rng import rng_streams

N = len(POSE_NAMES)
SIGMA = 0.02
PERSON = person_skeleton(from_height(1.75))
BODY = SimpleNamespace(
    skeleton=SimpleNamespace(
        limits=np.tile([-1e6, 1e6], (N, 1)), dof_names=POSE_NAMES, names=PERSON.names, parents=PERSON.parents,
        dof_joints=PERSON.dof_joints,
    )
)  # fmt: skip
DT_S = 1.0 / 30.0
GAUSSIAN = {"curvature_weight": 1.0, "outlier_motion_probability": 1e-12}
"""Options without heavy tails, with which the filter is exact for a linear Gaussian model."""


def model(rng):
    mixed = 0.05 * rng.standard_normal((N, N))
    gain = np.concatenate([-0.1 * rng.random((N, N - 4)), 0.9 * np.eye(N) + 0.01 * rng.standard_normal((N, N))], axis=1)
    gain[3] = 0.0  # a constant heading, so that the model is linear
    covariance = mixed @ mixed.T + 0.01 * np.eye(N)
    covariance[3], covariance[:, 3] = 0.0, 0.0
    covariance[3, 3] = 1e-12
    start = np.diag(np.full(N, 0.04))
    start[3, 3] = 1e-12
    return LinearMotion(30.0, gain, np.zeros(N), covariance, np.zeros((N, N - 4)), np.zeros(N), start)


class Measured(StubFrameLikelihood):
    """A likelihood of measurements (F, N) of every pose parameter with noise; its residuals inflate no deviation."""

    n_levels, informative = 1, False

    def __init__(self, measured, frame=None):
        self.measured, self.frame = measured, frame

    def prepare(self, previous, frame):
        return type(self)(self.measured, frame.index)

    def derivatives(self, pose, level):
        residual = (pose - self.measured[self.frame]) / SIGMA
        return Derivatives(-0.5 * float(residual @ residual), -residual / SIGMA, np.eye(N) / SIGMA**2)

    def mean_loss(self, pose):
        return np.full(len(PERSON.names), 0.7)


def simulated(n_frames=6):
    rng = np.random.default_rng(1)
    prior = Linear(model(rng))
    state = prior.sample_initial(np.zeros(N), 1, rng)
    measured = [state[0, :N]]
    for _ in range(n_frames - 1):
        state = prior.sample_transition(state, DT_S, rng)
        measured.append(state[0, :N] + SIGMA * rng.standard_normal(N))
    frames = [Frame(k, k * DT_S, (), None) for k in range(n_frames)]
    return prior, np.array(measured), frames


def exact(prior, measured):
    """Return means and variances (F, N) of all poses given the measurements after the first, as one Gaussian."""
    mean, covariance = prior.initial_moments(np.zeros(N))
    transition = (prior.mean(np.eye(2 * N), DT_S) - prior.mean(np.zeros((1, 2 * N)), DT_S)).T
    noise, d, frames = prior.noise_covariance(np.zeros(2 * N), DT_S), 2 * N, len(measured)
    means, joint = [mean], np.zeros((frames * d, frames * d))
    joint[:d, :d] = covariance
    for t in range(1, frames):
        current, previous = slice(t * d, (t + 1) * d), slice((t - 1) * d, t * d)
        means.append(prior.mean(means[-1][None], DT_S)[0])
        joint[current, : t * d] = transition @ joint[previous, : t * d]
        joint[: t * d, current] = joint[current, : t * d].T
        joint[current, current] = transition @ joint[previous, previous] @ transition.T + noise
    rows = np.concatenate([t * d + np.arange(N) for t in range(1, frames)])
    gain = joint[:, rows] @ np.linalg.inv(joint[np.ix_(rows, rows)] + SIGMA**2 * np.eye(len(rows)))
    posterior_mean = np.concatenate(means) + gain @ (measured[1:].ravel() - np.concatenate(means)[rows])
    posterior_covariance = joint - gain @ joint[rows]
    return posterior_mean.reshape(frames, d)[:, :N], np.diag(posterior_covariance).reshape(frames, d)[:, :N]


def run(filter_, frames, seed=0):
    streams = {name: np.random.default_rng([seed, k]) for k, name in enumerate(("resampling", "prior"))}
    return list(filter_.run(frames, np.zeros(N), streams))


def test_both_passes_are_exact_for_a_linear_gaussian_model():
    prior, measured, frames = simulated()
    steps = run(IteratedEkf(prior, Measured(measured), BODY, n_particles=4000, **GAUSSIAN), frames)
    means, variances = exact(prior, measured)
    assert np.abs(np.array([step.expected_pose for step in steps]) - means).max() < 2e-4
    # The deviation of 4000 samples has a standard error of 1.1 %; the largest of 150 is within four of them.
    deviations = np.array([step.poses.std(axis=0) for step in steps])
    assert np.allclose(deviations, np.sqrt(variances), rtol=0.06, atol=2e-4)
    filtered = run(IteratedEkf(prior, Measured(measured), BODY, second_pass=False, **GAUSSIAN), frames)
    assert np.abs(filtered[-1].expected_pose - means[-1]).max() < 2e-4
    assert np.abs(filtered[1].expected_pose - means[1]).max() > 1e-3  # does not use later frames


def test_a_pose_prior_changes_the_reported_poses_only():
    prior, measured, frames = simulated()
    pose_prior = PosePrior(np.ones(1), np.full((1, N - 4), 0.5), 0.01 * np.eye(N - 4)[None])
    learned = Linear(replace(prior.model, pose_prior=pose_prior))
    options = {"n_particles": 10_000, **GAUSSIAN}
    without = run(IteratedEkf(learned, Measured(measured), BODY, **options), frames)
    with_prior = run(IteratedEkf(learned, Measured(measured), BODY, pose_prior_power=0.3, **options), frames)
    for plain, step in zip(without, with_prior, strict=True):
        pose, covariance = pose_prior.geometric_product(plain.expected_pose, np.cov(plain.poses.T), 0.3)
        error = np.linalg.norm(step.expected_pose - pose)  # the covariance of samples is inaccurate by a hundredth
        assert error < 0.1 * np.linalg.norm(plain.expected_pose - pose)
        assert np.allclose(step.poses[:, 4:].std(axis=0), np.sqrt(np.diag(covariance))[4:], rtol=0.1)
        assert step.log_evidence == plain.log_evidence
    unlearned = run(IteratedEkf(prior, Measured(measured), BODY, pose_prior_power=0.3, **options), frames)
    assert all((a.poses == b.poses).all() for a, b in zip(unlearned, without, strict=True))


class Refitted(Measured):
    """A likelihood whose second pass has other measurements."""

    def refitted(self, frame, poses):
        return Measured(self.measured + 0.02)


def test_two_passes_are_fused_as_two_samples():
    prior, measured, frames = simulated()
    options = {"n_particles": 10_000, **GAUSSIAN}
    first, second, fused = (
        run(IteratedEkf(prior, likelihood, BODY, **options), frames)
        for likelihood in (Measured(measured), Measured(measured + 0.02), Refitted(measured))
    )
    for one, two, step in zip(first, second, fused, strict=True):
        difference = one.expected_pose - two.expected_pose
        assert np.allclose(step.expected_pose, 0.5 * (one.expected_pose + two.expected_pose), atol=2e-4)
        expected = np.cov(two.poses.T) + 0.5 * np.outer(difference, difference)
        # A covariance of 10 000 samples has a standard error of 1.4 %; seven times that.
        assert np.allclose(np.cov(step.poses.T), expected, atol=0.1 * expected.diagonal().max())
    assert np.abs(difference[:5]).max() > 1e-3


def test_a_filter_without_a_second_pass_consumes_one_frame_per_step():
    prior, measured, frames = simulated()
    remaining = iter(frames)
    steps = IteratedEkf(prior, Measured(measured), BODY, second_pass=False).run(remaining, np.zeros(N), rng_streams(0))
    next(steps)
    assert next(remaining).index == 1


def test_a_missing_requirement_is_rejected():
    prior, measured, frames = simulated()
    with pytest.raises(InputError, match="needs a pose to start from"):
        list(IteratedEkf(prior, Measured(measured), BODY).run(frames, None, {}))
    with pytest.raises(InputError, match="needs a prior with Gaussian noise"):
        list(IteratedEkf(Smooth(parameters=["left_arm"]), Measured(measured), BODY).run(frames, np.zeros(N), {}))
    with pytest.raises(InputError, match="needs a likelihood with derivatives by the pose, found Uniform"):
        list(IteratedEkf(prior, Uniform(), BODY).run(frames, np.zeros(N), {}))


def test_the_moments_of_constant_velocity_are_those_of_its_samples():
    prior, rng = Smooth(), np.random.default_rng(0)
    pose = np.zeros(N)
    pose[6:] = 0.5 * (prior.limits[6:].sum(axis=1))  # far from the limits
    mean, covariance = prior.initial_moments(pose)
    samples = prior.sample_initial(pose, 20000, rng)
    np.testing.assert_allclose(samples.mean(axis=0), mean, atol=5.0 * np.sqrt(np.diag(covariance) / 20000).max())
    np.testing.assert_allclose(samples.std(axis=0), np.sqrt(np.diag(covariance)), rtol=0.05)
    state = np.concatenate([pose, np.zeros(N)])
    noise = prior.noise_covariance(state, DT_S)
    transitions = prior.sample_transition(np.repeat(state[None], 20000, axis=0), DT_S, rng)
    np.testing.assert_allclose(transitions.std(axis=0), np.sqrt(np.diag(noise)), rtol=0.05)
    assert np.count_nonzero(noise - np.diag(np.diag(noise))) == 0


class Quadratic(StubFrameLikelihood):
    """A frame likelihood of a measurement (P,) of every pose parameter with noise, the same at both levels."""

    def __init__(self, measured, sigma):
        self.measured, self.sigma = measured, sigma

    def derivatives(self, pose, level):
        residual = (pose - self.measured) / self.sigma
        return Derivatives(-0.5 * float(residual @ residual), -residual / self.sigma, np.eye(len(pose)) / self.sigma**2)


def random_covariance(rng, n=4):
    root = rng.standard_normal((n, n))
    return 0.01 * root @ root.T + 0.001 * np.eye(n)


def mode_of(likelihood, mean, covariance, limit=1e6, limbs=(0, 0, 1, 1), outlier_motion_probability=0.05):
    return find_mode(
        likelihood, mean, covariance, np.tile([-limit, limit], (4, 1)), start=mean, limbs=np.array(limbs),
        outlier_motion_probability=outlier_motion_probability, curvature_weight=1.0,
    )  # fmt: skip


def test_the_mode_without_heavy_tails_is_that_of_the_gaussian_posterior():
    rng = np.random.default_rng(2)
    mean, covariance, measured = rng.standard_normal(4), random_covariance(rng), rng.standard_normal(4)
    mode = mode_of(Quadratic(measured, 0.2), mean, covariance, outlier_motion_probability=1e-12)
    precision = np.linalg.inv(covariance)
    expected = np.linalg.inv(precision + np.eye(4) / 0.04)
    np.testing.assert_allclose(mode.covariance, expected, rtol=1e-6)
    np.testing.assert_allclose(mode.pose, expected @ (precision @ mean + measured / 0.04), atol=1e-5)
    innovation, total = measured - mean, covariance + 0.04 * np.eye(4)
    log_evidence = -0.5 * innovation @ np.linalg.solve(total, innovation) - 0.5 * np.linalg.slogdet(total / 0.04)[1]
    assert mode.log_evidence == pytest.approx(log_evidence, abs=1e-4)  # without the normalisation of the likelihood


def test_outlier_motion_of_one_limb_weakens_the_prior_of_that_limb_only():
    mean, covariance, measured = np.zeros(4), 1e-4 * np.eye(4), np.array([0.1, 0.1, 0.01, 0.0])  # 10 deviations
    robust, gaussian = (
        mode_of(Quadratic(measured, 0.01), mean, covariance, outlier_motion_probability=probability)
        for probability in (0.05, 1e-12)
    )
    np.testing.assert_allclose(gaussian.pose, 0.5 * measured, rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(robust.pose[:2], 0.09, rtol=1e-2)  # as of three times the prior's deviation: 9/10
    np.testing.assert_allclose(robust.pose[2:], 0.5 * measured[2:], rtol=0.03, atol=1e-6)
    assert robust.covariance[0, 0] > 1.5 * gaussian.covariance[0, 0]
    np.testing.assert_allclose(robust.covariance[2, 2], gaussian.covariance[2, 2], rtol=0.03)


def test_the_precision_of_a_heavy_tailed_prior_gives_its_gradient():
    rng = np.random.default_rng(5)
    prior = heavy_tailed_prior(rng.standard_normal(4), random_covariance(rng), np.array([0, 0, 1, 1]), 0.05)
    for distance in (0.1, 0.3, 1.0):
        pose = prior.mean + distance * rng.standard_normal(4)
        gradient = -prior.precision(pose) @ (pose - prior.mean)
        steps = 1e-6 * np.eye(4)
        expected = [(prior.log_density(pose + step) - prior.log_density(pose - step)) / 2e-6 for step in steps]
        np.testing.assert_allclose(gradient, expected, rtol=1e-4)
    assert prior.log_density(prior.mean) == 0.0


def test_the_mode_is_within_the_limits():
    mode = mode_of(Quadratic(np.full(4, 3.0), 0.1), np.zeros(4), 0.04 * np.eye(4), limit=0.1, limbs=range(4))
    assert (np.abs(mode.pose) <= 0.1).all()


class KneeLoss(Measured):
    """A likelihood with a given mean loss of the left knee."""

    informative = True

    def __init__(self, measured, loss, frame=None):
        super().__init__(measured, frame)
        self.loss = loss

    def prepare(self, previous, frame):
        return KneeLoss(self.measured, self.loss, frame.index)

    def mean_loss(self, pose):
        return np.where(np.array(PERSON.names) == "left_knee", self.loss, 0.7)


def test_a_large_loss_inflates_the_deviation_of_its_joint_only():
    (prior, measured, frames), body = simulated(), SimpleNamespace(skeleton=PERSON)
    small, large = (
        run(IteratedEkf(prior, KneeLoss(measured, loss), body, n_particles=20000), frames)[-1] for loss in (0.7, 3.7)
    )
    ratios = large.poses.std(axis=0) / small.poses.std(axis=0)
    expected = np.where(np.array(POSE_NAMES) == "left_knee_flexion", 4.0, 1.0)
    np.testing.assert_allclose(ratios, expected, rtol=0.05)  # six standard errors with 20 000 samples
    np.testing.assert_allclose(large.expected_pose, small.expected_pose, atol=1e-12)
