"""The particle filter against the Kalman filter, and resampling against its expectations."""

import weakref
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pytest
from linear_gaussian import (
    MEAN0,
    LinearPrior,
    Memoryless,
    Position,
    Q,
    assert_agree,
    exact,
    frames,
    last_moments,
    simulate,
    streams,
)

from workbench.core.frame import Frame
from workbench.core.likelihood import Evaluation
from workbench.inference.smc.bootstrap import Auxiliary, Bootstrap
from workbench.inference.smc.particle_filter import ParticleFilter, trace_ancestry
from workbench.inference.smc.weights import RESAMPLING, effective_sample_size
from workbench.priors.density import log_normal
from workbench.utils.errors import InputError


class Constant(Memoryless):
    """Gives every particle the same log likelihood."""

    def __init__(self, value):
        self.value = value

    def log_prob(self, previous, frame, previous_pose, pose):
        return np.full(len(pose), self.value)


@dataclass(frozen=True, eq=False)
class Remembers:
    """Carries what the filter told it from frame to frame, and notes the frames that it is asked to look at."""

    told: tuple = ()
    frame_likelihoods: list = field(default_factory=list)

    def prepare(self, previous, frame):
        self.frame_likelihoods.append((previous, frame, self.told))
        return RemembersLook(self, previous, frame)


@dataclass(frozen=True, eq=False)
class RemembersLook:
    likelihood: Remembers
    previous: Frame | None
    frame: Frame
    diagnostics = {}  # noqa: RUF012

    @property
    def notes(self):
        return (f"seen {self.frame.index}",)

    def evaluate(self, previous_pose, pose):
        assert self.previous is not None
        return Evaluation(pose[:, 0], ("judged", "judged"))

    def update(self, expected_pose):
        told = (*self.likelihood.told, (self.frame.index, expected_pose))
        return Remembers(told, self.likelihood.frame_likelihoods)


def run(n_particles, seed, measured, **options):
    inference = ParticleFilter(
        LinearPrior(), Position(measured), algorithm=Bootstrap(**options), n_particles=n_particles
    )
    return list(inference.run(frames(len(measured)), MEAN0, streams(seed)))


def test_what_is_remembered_is_what_was_expected_and_looks_are_made_once():
    given, likelihood = frames(4), Remembers()
    steps = list(ParticleFilter(LinearPrior(), likelihood, n_particles=20).run(given, MEAN0, streams(1)))
    assert [(before, frame) for before, frame, _ in likelihood.frame_likelihoods] == [
        (None, given[0]),
        *pairwise(given),
    ]
    for (index, pose), step in zip(likelihood.frame_likelihoods[-1][2], steps, strict=False):
        assert index == step.frame.index
        np.testing.assert_array_equal(pose, step.expected_pose)
    assert likelihood.told == ()  # what it remembers is another


def test_notes_of_the_look_and_its_evaluations_are_told_once():
    steps = list(ParticleFilter(LinearPrior(), Remembers(), n_particles=20).run(frames(3), MEAN0, streams(1)))
    assert [step.warnings for step in steps] == [("seen 0",), ("seen 1", "judged"), ("seen 2", "judged")]


def test_a_filter_needs_a_start():
    with pytest.raises(InputError, match="start"):
        list(ParticleFilter(LinearPrior(), Remembers()).run(frames(2), None, streams(0)))


@pytest.mark.parametrize("resampling", sorted(RESAMPLING))
@pytest.mark.parametrize("ess_threshold", [0.5, 1.0])
@pytest.mark.slow
def test_converges_to_the_kalman_filter(resampling, ess_threshold):
    """State, variance and evidence: over 40 seeds the mean error is within 5 standard errors; these shrink as 1/√N."""
    measured = simulate(15, seed=3)
    means, variances, evidence = exact(measured)
    mean, variance = means[-1], variances[-1]
    spread = {}
    for n in (200, 3200):
        rows = []
        for seed in range(40):
            step = run(n, seed, measured, resampling=resampling, ess_threshold=ess_threshold)[-1]
            weights = np.exp(step.log_weights)
            off = weights @ (step.particles - step.expected_pose) ** 2 - variance
            rows.append([*(step.expected_pose - mean), *off, step.log_evidence - evidence])
        rows = np.array(rows)
        spread[n] = rows.std(axis=0)
        error = spread[n] / np.sqrt(40)
        # both the variance and the log evidence are biased by O(1/N): half their own variance for the latter
        bias = np.array([0, 0, *(variance * 10 / n), 0.5 * spread[n][4] ** 2 + 1 / n])
        assert (np.abs(rows.mean(axis=0)) < 5 * error + bias).all()
    # 1/4 is expected; each spread is itself known to 1/√(2·40) = 11 %, a ratio of two to 16 %, so five sigmas below 1/2
    assert (spread[3200] < 0.5 * spread[200]).all()


class Leaning(LinearPrior):
    """The linear model, drawn from elsewhere: to one side, and wider."""

    def propose(self, state, dt_s, rng):
        mean, sigma = self.mean(state, dt_s) + 0.6 * Q, 1.4 * Q
        moved = mean + sigma * rng.standard_normal(state.shape)
        return moved, self.log_transition(state, moved, dt_s) - log_normal(moved - mean, sigma)


@pytest.mark.parametrize(
    "move",
    [
        Bootstrap(),
        Bootstrap(ess_threshold=0.0),
        Bootstrap(ess_threshold=1.0),
        Auxiliary(),
        Auxiliary(first_stage_power=1.0),
    ],
    ids=["bootstrap", "never resampled", "always resampled", "half", "whole"],
)
@pytest.mark.parametrize("prior", [LinearPrior(), Leaning()], ids=["prior", "proposal"])
def test_proposals_and_looks_ahead_leave_the_exact_posterior(prior, move):
    measured = simulate(6, seed=4)
    mean, variance, evidence = exact(measured)
    found = last_moments(
        lambda _, likelihood: ParticleFilter(prior, likelihood, algorithm=move, n_particles=2000),
        Position(measured), len(measured), range(20),
    )  # fmt: skip
    assert_agree(found, [*mean[-1], *variance[-1], evidence])


@pytest.mark.parametrize("name", sorted(RESAMPLING))
def test_resampling_is_unbiased(name):
    weights = np.array([0.5, 0.0, 0.25, 0.2, 0.05])
    weights = np.concatenate([weights, weights]) / 2
    rng = np.random.default_rng(1)
    counts = np.array([np.bincount(RESAMPLING[name](weights, rng), minlength=10) for _ in range(4000)])
    expected = 10 * weights
    assert (counts.sum(axis=1) == 10).all()
    assert (counts[:, weights == 0] == 0).all()
    error = 5 * np.sqrt(expected / 4000)  # five standard errors of a multinomial count, the noisiest of the three
    assert (np.abs(counts.mean(axis=0) - expected) <= error + 1e-12).all()
    if name == "systematic":
        assert (np.abs(counts - expected) < 1).all()
    if name == "residual":
        assert (counts >= np.floor(expected)).all()


@pytest.mark.parametrize("name", sorted(RESAMPLING))
@pytest.mark.parametrize("last", [True, False])
def test_resampling_of_one_heavy_particle(name, last):
    """Weights whose sum falls short of one by rounding, and a single survivor at either end."""
    weights = np.zeros(1000)
    weights[-1 if last else 0] = 1.0 - 1e-12
    picked = RESAMPLING[name](weights, np.random.default_rng(0))
    assert (picked == (999 if last else 0)).all()


def test_effective_sample_size():
    even = np.full(50, -np.log(50))
    assert effective_sample_size(even) == pytest.approx(50)
    one = np.full(50, -np.inf)
    one[7] = 0.0
    assert effective_sample_size(one) == pytest.approx(1)


@pytest.mark.parametrize("value", [-np.inf, np.nan, np.inf])
def test_degenerate_weights_are_said_and_recovered(value):
    inference = ParticleFilter(LinearPrior(), Constant(value), n_particles=30)
    steps = list(inference.run(frames(3), MEAN0, streams(0)))
    assert steps[0].warnings == ()
    for step in steps[1:]:
        assert any(f"frame {step.frame.index}" in sentence for sentence in step.warnings)
        assert np.exp(step.log_weights).sum() == pytest.approx(1)
        assert np.isfinite(step.expected_pose).all()
    assert steps[-1].log_evidence == 0.0


def test_particles_are_let_go_of_once_they_have_children():
    """Of a million, each frame's take 300 MB."""
    earlier = []
    for step in ParticleFilter(LinearPrior(), Constant(0.0), n_particles=10).run(frames(4), MEAN0, streams(0)):
        assert not any(array() is not None for array in earlier)
        earlier += [weakref.ref(step.particles), weakref.ref(step.poses)]
    assert len(earlier) == 8


def test_a_frame_that_nothing_explains_leaves_normalised_weights_whatever_the_prior_proposed():
    class Proposes(LinearPrior):
        def propose(self, state, dt_s, rng):
            return self.sample_transition(state, dt_s, rng), np.linspace(-2.0, 1.0, len(state))

    inference = ParticleFilter(Proposes(), Constant(-np.inf), n_particles=40)
    for step in inference.run(frames(3), MEAN0, streams(5)):
        assert np.exp(step.log_weights).sum() == pytest.approx(1.0)


def test_steps_keep_their_states_where_a_prior_hands_back_what_it_was_given():
    class Stays(LinearPrior):
        def sample_transition(self, state, dt_s, rng):
            return state

    steps = list(ParticleFilter(Stays(), Constant(0.0), n_particles=40).run(frames(4), MEAN0, streams(5)))
    for before, now in pairwise(steps):
        assert (now.particles == before.particles[now.ancestors]).all()
        assert not np.shares_memory(now.particles, before.particles)


def test_ancestors_are_counted_over_several_frames():
    first, second = np.array([0, 0, 1, 2]), np.array([1, 1, 0, 3])
    origins = trace_ancestry(trace_ancestry(np.empty((0, 4), dtype=np.int32), first), second)
    assert origins.tolist() == [[1, 1, 0, 3], [0, 0, 0, 2]]
    steps = run(50, 0, simulate(15, 0))
    lived = np.arange(50)
    for step in steps[5:]:
        lived = step.ancestors if step is steps[5] else lived[step.ancestors]
    assert steps[-1].diagnostics["unique_ancestors_lag10"] == len(np.unique(lived)) < 50
