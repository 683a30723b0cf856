"""A linear Gaussian model as a prior and a likelihood, and its exact posterior."""

import numpy as np

from workbench.core.frame import Frame
from workbench.core.likelihood import Evaluation
from workbench.core.prior import PriorCapabilities
from workbench.core.state_space import StateSpace
from workbench.priors.density import log_normal

A, Q, R = np.array([[1.0, 0.1], [0.0, 0.95]]), np.array([0.05, 0.2]), 0.3
MEAN0, STD0 = np.array([0.5, -0.2]), np.array([0.4, 0.3])


class IsDensity:
    """A prior that is its own density over all columns."""

    @property
    def free(self):
        return np.arange(len(self.space))

    @property
    def capabilities(self):
        return PriorCapabilities(density=self)

    def sample_dependent(self, previous, state, dt_s, rng):
        return state


class LinearPrior(IsDensity):
    """x_t = A x_{t-1} + N(0, Q²); the pose is the state."""

    space = StateSpace.of({"position": (("x",), "m"), "velocity": (("v",), "m")})
    parameters = ("x", "v")

    def sample_initial(self, pose, n, rng):
        return pose + STD0 * rng.standard_normal((n, 2))

    def sample_transition(self, state, dt_s, rng):
        return self.mean(state, dt_s) + Q * rng.standard_normal(state.shape)

    def mean(self, state, dt_s):
        return state @ A.T

    def log_transition(self, previous, state, dt_s):
        return log_normal(state - previous @ A.T, Q)

    def pose(self, state):
        return state.copy()


class TwoJoints(LinearPrior):
    """The linear model with columns named after joints of two parts of the body."""

    space = StateSpace.of({"legs": (("left_knee_flexion",), "rad"), "arms": (("left_elbow_flexion",), "rad")})


class DrawnOnly(LinearPrior):
    """The linear model without a density."""

    capabilities = PriorCapabilities()


class MemorylessFrameLikelihood:
    """The frame likelihood of a likelihood without state; it uses only the frames' indices."""

    notes, diagnostics = (), {}

    def __init__(self, likelihood, previous, frame):
        self.likelihood, self.frames = likelihood, (previous, frame)

    def evaluate(self, previous_pose, pose):
        return Evaluation(self.likelihood.log_prob(*self.frames, previous_pose, pose))

    def update(self, expected_pose):
        return self.likelihood


class Memoryless:
    """A likelihood without state, defined by `log_prob(previous, frame, previous_pose, pose)`."""

    def prepare(self, previous, frame):
        return MemorylessFrameLikelihood(self, previous, frame)


class Position(Memoryless):
    """y_t = x_t + g v_t + h x_t−1 + N(0, R²); the frame's index picks the measurement."""

    def __init__(self, measured, sigma=R, h=0.0, g=0.0):
        self.measured, self.sigma, self.h, self.g, self.evaluated = measured, sigma, h, g, 0

    def log_prob(self, previous, frame, previous_pose, pose):
        self.evaluated += len(pose)
        expected = pose[:, 0] + self.g * pose[:, 1] + self.h * previous_pose[:, 0]
        return -0.5 * ((self.measured[frame.index] - expected) / self.sigma) ** 2 - np.log(
            self.sigma * np.sqrt(2 * np.pi)
        )


def frames(n):
    return [Frame(index=t, time_s=0.1 * t, views=()) for t in range(n)]


def streams(seed):
    children = np.random.SeedSequence(seed).spawn(3)
    return dict(zip(("start", "resampling", "prior"), map(np.random.default_rng, children), strict=True))


def simulate(n, seed, sigma=R, h=0.0):
    return simulate_states(n, seed, sigma, h)[0]


def simulate_states(n, seed, sigma=R, h=0.0):
    """Return measurements (n,), of which the first is NaN, and the states (n, 2)."""
    rng = np.random.default_rng(seed)
    states, measured = [MEAN0 + STD0 * rng.standard_normal(2)], [np.nan]
    for _ in range(n - 1):
        states.append(A @ states[-1] + Q * rng.standard_normal(2))
        measured.append(states[-1][0] + h * states[-2][0] + sigma * rng.standard_normal())
    return np.array(measured), np.array(states)


def exact(measured, sigma=R, h=0.0, g=0.0):
    """Return posterior means (T, 2) and variances (T, 2) given all measurements, and the log evidence.

    The joint Gaussian of all states is conditioned at once, without the recursion that the tests check.
    """
    n = len(measured)
    mean, cov = np.zeros((n, 2)), np.zeros((n, 2, n, 2))
    mean[0], cov[0, :, 0] = MEAN0, np.diag(STD0**2)
    for t in range(1, n):
        mean[t] = A @ mean[t - 1]
        for s in range(t):
            cov[t, :, s] = A @ cov[t - 1, :, s]
            cov[s, :, t] = cov[t, :, s].T
        cov[t, :, t] = A @ cov[t - 1, :, t - 1] @ A.T + np.diag(Q**2)
    flat_mean, flat_cov = mean.ravel(), cov.reshape(2 * n, 2 * n)
    observation = np.zeros((n - 1, n, 2))
    for t in range(1, n):
        observation[t - 1, t], observation[t - 1, t - 1, 0] = (1.0, g), h
    observation = observation.reshape(n - 1, 2 * n)
    covariance = observation @ flat_cov @ observation.T + sigma**2 * np.eye(n - 1)
    innovation = measured[1:] - observation @ flat_mean
    gain = np.linalg.solve(covariance, observation @ flat_cov).T
    log_det = np.linalg.slogdet(2 * np.pi * covariance)[1]
    evidence = -0.5 * (innovation @ np.linalg.solve(covariance, innovation) + log_det)
    posterior = flat_mean + gain @ innovation, np.diag(flat_cov - gain @ observation @ flat_cov)
    return posterior[0].reshape(n, 2), posterior[1].reshape(n, 2), float(evidence)


def moments(step):
    """Return the mean (2,) and the variance (2,) of a step's particles."""
    weights = np.exp(step.log_weights)
    mean = weights @ step.particles
    return mean, weights @ (step.particles - mean) ** 2


def last_moments(make, likelihood, n_frames, seeds):
    """Return mean, variance and log evidence in the last frame of make(prior, likelihood), (n_seeds, 5)."""
    rows = []
    for seed in seeds:
        step = list(make(TwoJoints(), likelihood).run(frames(n_frames), MEAN0, streams(seed)))[-1]
        rows.append([*np.concatenate(moments(step)), step.log_evidence])
    return np.array(rows)


def assert_agree(estimates, expected):
    """Assert that the mean over seeds of estimates (n_seeds, 4 or 5) is within 5 standard errors and a bias.

    The columns are means, variances and perhaps log evidences. The particles' variance about their own mean is too
    small by the variance s² of that mean; the logarithm of an unbiased estimate is too small by s²/2. Twice these
    biases are allowed, because both hold to first order in 1/N.
    """
    deviation = estimates.std(axis=0)
    assert (deviation[4:] < 1.0).all(), deviation  # the first order needs small deviations
    bias = np.concatenate([[0.0, 0.0], 2.0 * deviation[:2] ** 2, deviation[4:] ** 2])
    error = np.abs(estimates.mean(axis=0) - expected)
    assert (error < 5.0 * deviation / np.sqrt(len(estimates)) + bias).all(), (error, deviation, bias)
