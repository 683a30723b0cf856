"""The particle filter against the exact posterior of a linear Gaussian model, and resampling against mean counts."""

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
    """A likelihood that is the same for every particle."""

    def __init__(self, value):
        self.value = value

    def log_prob(self, previous, frame, previous_pose, pose):
        return np.full(len(pose), self.value)


@dataclass(frozen=True, eq=False)
class RecordingLikelihood:
    """A likelihood that records its updates (frame index, pose), and the frames that it is prepared for."""

    updates: tuple = ()
    prepared: list = field(default_factory=list)

    def prepare(self, previous, frame):
        self.prepared.append((previous, frame, self.updates))
        return RecordingFrameLikelihood(self, previous, frame)


@dataclass(frozen=True, eq=False)
class RecordingFrameLikelihood:
    likelihood: RecordingLikelihood
    previous: Frame | None
    frame: Frame
    diagnostics = {}  # noqa: RUF012

    @property
    def notes(self):
        return (f"prepared {self.frame.index}",)

    def evaluate(self, previous_pose, pose):
        assert self.previous is not None
        return Evaluation(pose[:, 0], ("evaluated", "evaluated"))

    def update(self, expected_pose):
        return RecordingLikelihood(
            (*self.likelihood.updates, (self.frame.index, expected_pose)), self.likelihood.prepared
        )


def run(n_particles, seed, measured, **options):
    inference = ParticleFilter(
        LinearPrior(), Position(measured), algorithm=Bootstrap(**options), n_particles=n_particles
    )
    return list(inference.run(frames(len(measured)), MEAN0, streams(seed)))


def test_the_likelihood_is_prepared_once_per_frame_and_updated_with_the_expected_pose():
    sequence, likelihood = frames(4), RecordingLikelihood()
    steps = list(ParticleFilter(LinearPrior(), likelihood, n_particles=20).run(sequence, MEAN0, streams(1)))
    pairs = [(previous, frame) for previous, frame, _ in likelihood.prepared]
    assert pairs == [(None, sequence[0]), *pairwise(sequence)]
    for (index, pose), step in zip(likelihood.prepared[-1][2], steps[:-1], strict=True):
        assert index == step.frame.index
        np.testing.assert_array_equal(pose, step.expected_pose)
    assert likelihood.updates == ()  # an update returns another likelihood


def test_warnings_of_the_frame_and_of_its_evaluations_are_reported_once():
    steps = list(ParticleFilter(LinearPrior(), RecordingLikelihood(), n_particles=20).run(frames(3), MEAN0, streams(1)))
    expected = [("prepared 0",), ("prepared 1", "evaluated"), ("prepared 2", "evaluated")]
    assert [step.warnings for step in steps] == expected


def test_a_missing_initial_pose_is_rejected():
    with pytest.raises(InputError, match="start"):
        list(ParticleFilter(LinearPrior(), RecordingLikelihood()).run(frames(2), None, streams(0)))


@pytest.mark.parametrize("resampling", sorted(RESAMPLING))
@pytest.mark.parametrize("ess_threshold", [0.5, 1.0])
@pytest.mark.slow
def test_converges_to_the_kalman_filter(resampling, ess_threshold):
    """Mean, variance and evidence: the mean error over 40 seeds is within 5 standard errors, which shrink as 1/√N."""
    measured = simulate(15, seed=3)
    means, variances, evidence = exact(measured)
    mean, variance = means[-1], variances[-1]
    spread = {}
    for n in (200, 3200):
        rows = []
        for seed in range(40):
            step = run(n, seed, measured, resampling=resampling, ess_threshold=ess_threshold)[-1]
            weights = np.exp(step.log_weights)
            variance_error = weights @ (step.particles - step.expected_pose) ** 2 - variance
            rows.append([*(step.expected_pose - mean), *variance_error, step.log_evidence - evidence])
        rows = np.array(rows)
        spread[n] = rows.std(axis=0)
        error = spread[n] / np.sqrt(40)
        # Both the variance and the log evidence are biased by O(1/N), the latter by half of its own variance.
        bias = np.array([0, 0, *(variance * 10 / n), 0.5 * spread[n][4] ** 2 + 1 / n])
        assert (np.abs(rows.mean(axis=0)) < 5 * error + bias).all()
    # The expected ratio is 1/4. Each spread has a standard error of 1/√(2·40) = 11 %, their ratio of 16 %: 1/2 is more
    # than five standard errors away.
    assert (spread[3200] < 0.5 * spread[200]).all()


class WithProposal(LinearPrior):
    """The linear model with a displaced and wider proposal."""

    def propose(self, state, dt_s, rng):
        mean, sigma = self.mean(state, dt_s) + 0.6 * Q, 1.4 * Q
        moved = mean + sigma * rng.standard_normal(state.shape)
        return moved, self.log_transition(state, moved, dt_s) - log_normal(moved - mean, sigma)


@pytest.mark.parametrize(
    "algorithm",
    [
        Bootstrap(),
        Bootstrap(ess_threshold=0.0),
        Bootstrap(ess_threshold=1.0),
        Auxiliary(),
        Auxiliary(first_stage_power=1.0),
    ],
    ids=["bootstrap", "never resampled", "always resampled", "auxiliary", "auxiliary with power 1"],
)
@pytest.mark.parametrize("prior", [LinearPrior(), WithProposal()], ids=["prior", "proposal"])
def test_the_posterior_is_exact_with_any_proposal_and_first_stage(prior, algorithm):
    measured = simulate(6, seed=4)
    mean, variance, evidence = exact(measured)
    estimates = last_moments(
        lambda _, likelihood: ParticleFilter(prior, likelihood, algorithm=algorithm, n_particles=2000),
        Position(measured), len(measured), range(20),
    )  # fmt: skip
    assert_agree(estimates, [*mean[-1], *variance[-1], evidence])


@pytest.mark.parametrize("name", sorted(RESAMPLING))
def test_resampling_is_unbiased(name):
    weights = np.array([0.5, 0.0, 0.25, 0.2, 0.05])
    weights = np.concatenate([weights, weights]) / 2
    rng = np.random.default_rng(1)
    counts = np.array([np.bincount(RESAMPLING[name](weights, rng), minlength=10) for _ in range(4000)])
    expected = 10 * weights
    assert (counts.sum(axis=1) == 10).all()
    assert (counts[:, weights == 0] == 0).all()
    error = 5 * np.sqrt(expected / 4000)  # five standard errors of a multinomial count, the largest of all schemes
    assert (np.abs(counts.mean(axis=0) - expected) <= error + 1e-12).all()
    if name == "systematic":
        assert (np.abs(counts - expected) < 1).all()
    if name == "residual":
        assert (counts >= np.floor(expected)).all()


@pytest.mark.parametrize("name", sorted(RESAMPLING))
@pytest.mark.parametrize("last", [True, False])
def test_one_particle_with_all_weight_is_the_only_parent(name, last):
    """The sum of the weights is below one by rounding."""
    weights = np.zeros(1000)
    weights[-1 if last else 0] = 1.0 - 1e-12
    parents = RESAMPLING[name](weights, np.random.default_rng(0))
    assert (parents == (999 if last else 0)).all()


def test_effective_sample_size_counts_the_particles_with_equal_weights():
    for n in (1, 7, 50):
        log_weights = np.append(np.full(n, -np.log(n)), np.full(50 - n, -np.inf))
        assert effective_sample_size(log_weights) == pytest.approx(n)


@pytest.mark.parametrize("value", [-np.inf, np.nan, np.inf])
def test_degenerate_weights_are_reported_and_replaced(value):
    inference = ParticleFilter(LinearPrior(), Constant(value), n_particles=30)
    steps = list(inference.run(frames(3), MEAN0, streams(0)))
    assert steps[0].warnings == ()
    for step in steps[1:]:
        assert any(f"frame {step.frame.index}" in warning for warning in step.warnings)
        assert np.exp(step.log_weights).sum() == pytest.approx(1)
        assert np.isfinite(step.expected_pose).all()
    assert steps[-1].log_evidence == 0.0


def test_particles_of_earlier_frames_are_freed():
    """A million particles take 300 MB per frame."""
    references = []
    for step in ParticleFilter(LinearPrior(), Constant(0.0), n_particles=10).run(frames(4), MEAN0, streams(0)):
        assert all(reference() is None for reference in references)
        references += [weakref.ref(step.particles), weakref.ref(step.poses)]
    assert len(references) == 8


def test_weights_are_normalised_where_the_likelihood_is_zero_and_the_proposal_has_weights():
    class Weighted(LinearPrior):
        def propose(self, state, dt_s, rng):
            return self.sample_transition(state, dt_s, rng), np.linspace(-2.0, 1.0, len(state))

    inference = ParticleFilter(Weighted(), Constant(-np.inf), n_particles=40)
    for step in inference.run(frames(3), MEAN0, streams(5)):
        assert np.exp(step.log_weights).sum() == pytest.approx(1.0)


def test_steps_do_not_share_memory_where_a_prior_returns_its_argument():
    class Static(LinearPrior):
        def sample_transition(self, state, dt_s, rng):
            return state

    steps = list(ParticleFilter(Static(), Constant(0.0), n_particles=40).run(frames(4), MEAN0, streams(5)))
    for previous, step in pairwise(steps):
        assert (step.particles == previous.particles[step.ancestors]).all()
        assert not np.shares_memory(step.particles, previous.particles)


def test_unique_ancestors_are_counted_over_ten_frames():
    first, second = np.array([0, 0, 1, 2]), np.array([1, 1, 0, 3])
    ancestry = trace_ancestry(trace_ancestry(np.empty((0, 4), dtype=np.int32), first), second)
    assert ancestry.tolist() == [[1, 1, 0, 3], [0, 0, 0, 2]]
    steps = run(50, 0, simulate(15, 0))
    ancestors = np.arange(50)
    for step in steps[5:]:
        ancestors = ancestors[step.ancestors]
    assert steps[-1].diagnostics["unique_ancestors_lag10"] == len(np.unique(ancestors)) < 50
