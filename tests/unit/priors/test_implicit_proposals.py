"""Priors that propose: their draws by their weights against enumerations, alone and in the particle filter."""

import numpy as np
import pytest
from scipy.special import logsumexp

from workbench.body.skeleton import N_ROOT, POSE_NAMES
from workbench.core.frame import Frame
from workbench.core.likelihood import Evaluation
from workbench.core.state_space import StateSpace
from workbench.inference.smc.bootstrap import Bootstrap
from workbench.inference.smc.particle_filter import ParticleFilter
from workbench.motion.models.windows import learn_windows
from workbench.motion.synthetic.gait import builtin_motions
from workbench.priors.implicit import Implicit
from workbench.priors.implicit_search import exact_log_prob

DT = 1 / 30
BETA = 1.0  # so warm that the weights' variance stays small enough for a mean to say something
STILL = {"sigma_position": (0.0,) * 3, "sigma_rotation": (0.0,) * 3, "sigma_angles": 0.0}
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
    return Implicit(windows, **STILL).start_after(poses, N_DRAWS)


def reweighted(windows, leaf):
    return Implicit(windows, search="sign_tree", reweight=True, beta=BETA, leaf=leaf, prediction="increment", **STILL)


def exact_mean(prior, state, n_steps):
    """E[angles] after one or two steps from a state (1, D), over all entries, and all successors of each."""
    windows, everything = prior.windows, np.arange(len(prior.windows))
    probe = state[0, prior.space.slices["coefficients"]]
    p = np.exp(exact_log_prob(windows.coefficients, probe, prior.beta))
    noise = np.zeros((len(windows), len(POSE_NAMES)))
    moved = prior.predict(np.repeat(state, len(windows), axis=0), everything, noise)
    if n_steps == 1:
        return p @ moved[:, N_ROOT : len(POSE_NAMES)]
    return p @ np.array([exact_mean(prior, row[None], n_steps - 1) for row in moved])


def apart(values, weights, expected):
    """By how many standard errors the mean of values (N, A) with weights (N,) is off what is expected (A,)."""
    terms = weights[:, None] * values
    return np.abs(terms.mean(axis=0) - expected) / (terms.std(axis=0) / np.sqrt(len(terms)))


@pytest.mark.parametrize("leaf", ["gaussian", "uniform"])
def test_a_trees_draws_by_their_weights_have_the_exact_odds(windows, parents, leaf):
    prior = reweighted(windows, leaf)
    state, log_weights = prior.propose(parents, DT, np.random.default_rng(1))
    weights, angles = np.exp(log_weights), state[:, N_ROOT : len(POSE_NAMES)]
    expected = exact_mean(prior, parents[:1], 1)
    assert apart(angles, weights, expected).max() < 5
    assert apart(np.ones((N_DRAWS, 1)), weights, 1.0).max() < 5  # a proposal misses nothing
    assert apart(angles, np.ones(N_DRAWS), expected).max() > 10  # the weights were needed


def test_the_weights_of_two_frames_at_once_are_those_of_both(windows, parents):
    """Over all pairs of entries."""
    prior = reweighted(windows, "gaussian")
    state, log_weights = prior.propose(parents, 2 * DT, np.random.default_rng(2))
    angles, expected = state[:, N_ROOT : len(POSE_NAMES)], exact_mean(prior, parents[:1], 2)
    assert apart(angles, np.exp(log_weights), expected).max() < 5
    assert apart(angles, np.ones(N_DRAWS), expected).max() > 10


MOVES = np.array([[0.9, 0.1], [0.3, 0.7]])  # p(x_t | x_t−1)
PROPOSED = np.array([[0.5, 0.5], [0.6, 0.4]])  # what is drawn from instead
START = np.array([0.6, 0.4])
LIKELY = np.array([[1.0, 1.0], [0.2, 0.7], [0.6, 0.1], [0.3, 0.5], [0.1, 0.9]])  # of x in each frame; frame 0 is given


class TwoPoints:
    """A Markov chain on {0, 1} that draws from another one."""

    space = StateSpace.of({"x": (("x",), "")})
    parameters = ()

    def start(self, pose, n, rng):
        return (rng.random((n, 1)) < START[1]).astype(float)

    def step(self, state, dt_s, rng):
        return (rng.random(state.shape) < PROPOSED[state[:, 0].astype(int), 1][:, None]).astype(float)

    def pose(self, state):
        return state.copy()


class Corrected(TwoPoints):
    """The same with the weights that make it draws of MOVES."""

    def propose(self, state, dt_s, rng):
        moved = self.step(state, dt_s, rng)
        at = state[:, 0].astype(int), moved[:, 0].astype(int)
        return moved, np.log(MOVES[at] / PROPOSED[at])


class Looked:
    notes, diagnostics, index = (), {}, 0

    def look(self, previous, frame):
        self.index = frame.index
        return self

    def evaluate(self, previous_pose, pose):
        return Evaluation(np.log(LIKELY[self.index, pose[:, 0].astype(int)]))

    def remember(self, expected_pose):
        return self


def enumerated(chain):
    """p(x_T = 1 | frames) and p(frames), by the forward recursion over both points."""
    joint = START
    for likely in LIKELY[1:]:
        joint = (joint @ chain) * likely
    return joint[1] / joint.sum(), joint.sum()


def filtered(prior, ess_threshold, n_seeds=60, n_particles=500):
    """The filter's estimates of `enumerated`, (n_seeds, 2)."""
    frames = [Frame(index=t, time_s=t * DT, views=()) for t in range(len(LIKELY))]
    rows = []
    for seed in range(n_seeds):
        children = np.random.SeedSequence(seed).spawn(3)
        streams = dict(zip(("start", "resampling", "prior"), map(np.random.default_rng, children), strict=True))
        inference = ParticleFilter(
            prior, Looked(), n_particles=n_particles, move=Bootstrap(ess_threshold=ess_threshold)
        )
        *_, last = inference.run(frames, np.zeros(1), streams)
        assert logsumexp(last.log_weights) == pytest.approx(0.0, abs=1e-9)
        rows.append([last.expected_pose[0], np.exp(last.log_evidence)])
    return np.array(rows)


@pytest.mark.parametrize("ess_threshold", [0.0, 0.5, 1.0])
def test_the_filter_adds_a_proposals_weights_to_the_likelihoods(ess_threshold):
    """Posterior and evidence by enumeration; without the weights it finds those of the chain drawn from."""
    for prior, chain, other in ((Corrected(), MOVES, PROPOSED), (TwoPoints(), PROPOSED, MOVES)):
        rows = filtered(prior, ess_threshold)
        error = rows.std(axis=0) / np.sqrt(len(rows))
        bias = np.array([2 / 500, 0.0])  # of the ratio of two estimates, O(1/N); the evidence itself has none
        assert (np.abs(rows.mean(axis=0) - enumerated(chain)) < 5 * error + bias).all()
        assert (np.abs(rows.mean(axis=0) - enumerated(other)) > 10 * error + bias).all()
