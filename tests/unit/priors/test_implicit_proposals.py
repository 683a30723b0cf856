"""Proposals of the implicit prior: weighted samples against enumeration."""

import numpy as np
import pytest

from workbench.body.skeleton import N_ROOT, POSE_NAMES
from workbench.motion.models.windows import learn_windows
from workbench.motion.synthetic.gait import builtin_motions
from workbench.priors.implicit import Implicit
from workbench.priors.implicit_search import exact_log_prob
from workbench.priors.implicit_tree import log_importance

DT = 1 / 30
BETA = 1.0  # so warm that the weights' variance is small
NO_NOISE = {"sigma_position": (0.0,) * 3, "sigma_rotation": (0.0,) * 3, "sigma_angles": 0.0}
N_DRAWS = 20_000


@pytest.fixture(scope="module")
def motions():
    return builtin_motions(n_subjects=1)


@pytest.fixture(scope="module")
def windows(motions):
    return learn_windows(motions)


@pytest.fixture(scope="module")
def parents(motions, windows):
    poses = motions[0].resampled(30.0).poses[20:31] + 0.05
    return Implicit(windows, **NO_NOISE).start_after(poses, N_DRAWS)


def reweighted(windows, leaf):
    options = {"search": "sign_tree", "importance_correction": True, "prediction": "increment", **NO_NOISE}
    return Implicit(windows, beta=BETA, leaf=leaf, **options)


def exact_mean(prior, state, n_steps):
    """E[angles] after one or two steps from a state (1, D), over all entries, and all successors of each."""
    windows, entries = prior.windows, np.arange(len(prior.windows))
    probe = state[0, prior.space.slices["coefficients"]]
    p = np.exp(exact_log_prob(windows.coefficients, probe, prior.beta))
    noise = np.zeros((len(windows), len(POSE_NAMES)))
    moved = prior.predict(np.repeat(state, len(windows), axis=0), entries, noise)
    if n_steps == 1:
        return p @ moved[:, N_ROOT : len(POSE_NAMES)]
    return p @ np.array([exact_mean(prior, row[None], n_steps - 1) for row in moved])


def standard_errors(values, weights, expected):
    """Return the error of the mean of values (N, A) with weights (N,), in standard errors (A,)."""
    terms = weights[:, None] * values
    return np.abs(terms.mean(axis=0) - expected) / (terms.std(axis=0) / np.sqrt(len(terms)))


@pytest.mark.parametrize("leaf", ["gaussian", "uniform"])
def test_weighted_tree_samples_have_the_exact_mean(windows, parents, leaf):
    prior = reweighted(windows, leaf)
    state, log_weights = prior.propose(parents, DT, np.random.default_rng(1))
    weights, angles = np.exp(log_weights), state[:, N_ROOT : len(POSE_NAMES)]
    expected = exact_mean(prior, parents[:1], 1)
    assert standard_errors(angles, weights, expected).max() < 5
    assert standard_errors(np.ones((N_DRAWS, 1)), weights, 1.0).max() < 5  # the proposal covers every entry
    assert standard_errors(angles, np.ones(N_DRAWS), expected).max() > 10  # without weights the mean is wrong


def test_the_weights_of_several_probes_are_those_of_each(windows):
    prior, rng = reweighted(windows, "gaussian"), np.random.default_rng(3)
    probes = windows.coefficients[rng.choice(4, 12)].astype(float)
    entries = rng.choice(len(windows), 12)
    expected = [log_importance(prior.tree, *each, BETA)[0] for each in zip(probes, entries[:, None], strict=True)]
    np.testing.assert_allclose(prior._log_importance(probes, entries), expected)


def test_weights_of_a_step_of_two_frames_are_those_of_both_frames(windows, parents):
    """The exact mean is over all pairs of entries."""
    prior = reweighted(windows, "gaussian")
    state, log_weights = prior.propose(parents, 2 * DT, np.random.default_rng(2))
    angles, expected = state[:, N_ROOT : len(POSE_NAMES)], exact_mean(prior, parents[:1], 2)
    assert standard_errors(angles, np.exp(log_weights), expected).max() < 5
    assert standard_errors(angles, np.ones(N_DRAWS), expected).max() > 10
