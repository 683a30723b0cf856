"""Every wrapper of every algorithm has the exact posterior; degenerate frames, track loss and dependent columns."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from linear_gaussian import (
    MEAN0,
    IsDensity,
    LinearPrior,
    Memoryless,
    Position,
    TwoJoints,
    assert_agree,
    exact,
    frames,
    moments,
    simulate,
    streams,
)

from workbench.core.prior import PriorCapabilities
from workbench.core.state_space import StateSpace
from workbench.inference.smc.bootstrap import Auxiliary, Bootstrap
from workbench.inference.smc.gauss_newton import GaussNewton
from workbench.inference.smc.hybrid import NO_PROPOSAL, Hybrid
from workbench.inference.smc.particle_filter import ParticleFilter
from workbench.inference.smc.partitioned import Partitioned
from workbench.inference.smc.reinitializing import REFERENCE_FRAMES, Reinitializing
from workbench.inference.smc.smoothing import BackwardSimulation, FixedLag
from workbench.inference.smc.tempered_smc import Annealed, TemperedSMC
from workbench.inference.smc.weights import DegenerateWeights
from workbench.priors.density import log_normal, state_difference

T, SEEDS, N = 5, 16, 150
EXACT = {
    "bootstrap": Bootstrap(),
    "auxiliary": Auxiliary(),
    "partitioned": Partitioned(partitions=["lower_body", "upper_body"]),
    "gauss_newton": GaussNewton(),
    "tempered_smc": TemperedSMC(),
}
ALGORITHMS = EXACT | {"annealed": Annealed()}
WRAPPERS = {
    "reinitializing": Reinitializing,
    "fixed_lag": lambda filter_: FixedLag(filter_, lag=2, min_effective_ancestors=1),
    "backward_simulation": lambda filter_: BackwardSimulation(filter_, n_paths=N, min_effective_ancestors=1),
    "fixed_lag of reinitializing": lambda filter_: FixedLag(Reinitializing(filter_), lag=2, min_effective_ancestors=1),
}
LAST_FRAME_USED = {"reinitializing": 1, "fixed_lag": 3, "backward_simulation": T - 1, "fixed_lag of reinitializing": 3}
"""The last frame whose measurement the estimate of frame 1 depends on."""


def particle_filter(algorithm, measured, prior=None, **model):
    return ParticleFilter(
        prior or TwoJoints(), Position(measured, **model), algorithm=ALGORITHMS[algorithm], n_particles=N
    )


@pytest.mark.parametrize("algorithm", EXACT)
@pytest.mark.parametrize("wrapper", WRAPPERS)
@pytest.mark.slow
def test_wrapped_algorithms_have_the_exact_posterior(wrapper, algorithm):
    measured = simulate(T, seed=3)
    inference = WRAPPERS[wrapper](particle_filter(algorithm, measured))
    runs = [list(inference.run(frames(T), MEAN0, streams(seed))) for seed in range(SEEDS)]
    for t, last in ((1, LAST_FRAME_USED[wrapper]), (T - 1, T - 1)):
        mean, variance, _ = exact(measured[: last + 1])
        assert_agree(np.array([np.concatenate(moments(steps[t])) for steps in runs]), [*mean[t], *variance[t]])


class Impossible(Memoryless):
    def log_prob(self, previous, frame, previous_pose, pose):
        return np.full(len(pose), -np.inf)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_degenerate_weights_stop_the_run_on_request(algorithm):
    inference = ParticleFilter(
        TwoJoints(), Impossible(), algorithm=ALGORITHMS[algorithm], n_particles=N, on_degenerate="stop"
    )
    with pytest.raises(DegenerateWeights, match="frame 1"):
        list(inference.run(frames(T), MEAN0, streams(0)))


class WidePrior(TwoJoints):
    def sample_initial(self, pose, n, rng):
        return pose + np.array([10.0, 0.3]) * rng.uniform(-1.0, 1.0, (n, 2))


@pytest.mark.parametrize("algorithm", EXACT)
def test_a_lost_track_is_recovered_with_every_algorithm(algorithm):
    n = REFERENCE_FRAMES + 15
    measured = simulate(n, seed=2)
    measured[REFERENCE_FRAMES + 5 :] += 8.0
    inference = Reinitializing(particle_filter(algorithm, measured, WidePrior(), sigma=0.1), n_particles=300)
    steps = list(inference.run(frames(n), MEAN0, streams(0)))
    reinitialized = [step.frame.index for step in steps if step.diagnostics["reinitialized"] == 1.0]
    assert reinitialized[0] in range(REFERENCE_FRAMES + 6, REFERENCE_FRAMES + 10)
    assert abs(steps[-1].expected_pose[0] - measured[-1]) < 0.5


class WithDependentColumn(TwoJoints):
    """A third column, the last change of the first, is a function of the others and is not in the density."""

    space = StateSpace(("left_knee_flexion", "left_elbow_flexion", "change"), ("rad", "rad", ""), {})
    free = np.array([0, 1])

    def sample_initial(self, pose, n, rng):
        return np.column_stack([super().sample_initial(pose[:2], n, rng), np.zeros(n)])

    def mean(self, state, dt_s):
        return np.column_stack([super().mean(state[:, :2], dt_s), np.full(len(state), 7.0)])

    def sample_transition(self, state, dt_s, rng):
        moved = np.column_stack([super().mean(state[:, :2], dt_s), np.zeros(len(state))])
        moved[:, :2] += np.array([0.05, 0.2]) * rng.standard_normal((len(state), 2))
        return self.sample_dependent(state, moved, dt_s, rng)

    def log_transition(self, previous, state, dt_s):
        return super().log_transition(previous[..., :2], state[..., :2], dt_s)

    def sample_dependent(self, previous, state, dt_s, rng):
        return np.column_stack([state[:, :2], state[:, 0] - previous[:, 0]])

    def pose(self, state):
        return state[:, :2].copy()


@pytest.mark.parametrize("algorithm", sorted(ALGORITHMS.keys() - {"partitioned"}))
def test_dependent_columns_are_those_of_particle_and_ancestor_and_leave_the_posterior_exact(algorithm):
    measured = simulate(T, seed=3)
    inference = particle_filter(algorithm, measured, WithDependentColumn())
    runs = [list(inference.run(frames(T), MEAN0, streams(seed))) for seed in range(SEEDS)]
    for previous, step in pairwise(runs[0]):
        changes = step.particles[:, 0] - previous.particles[step.ancestors, 0]
        np.testing.assert_array_equal(step.particles[:, 2], changes)
    if algorithm in EXACT:
        mean, variance, _ = exact(measured)
        estimates = np.array([moments(steps[-1]) for steps in runs])[:, :, :2].reshape(SEEDS, 4)
        assert_agree(estimates, [*mean[-1], *variance[-1]])


NAMES = (
    "left_knee_flexion", "phase", "phase_speed", "root_x", "root_y", "root_z",
    *(f"root_{axis}_velocity" for axis in "xyz"),
)  # fmt: skip
SIGMA = np.array([0.2, 0.02, 0.02, *[0.05] * 3, *[0.1] * 3])
FIT_SIGMA = 0.05


class CyclicPrior(IsDensity):
    """A prior with the columns that the hybrid requires: coefficient, phase, phase speed, root and root velocity."""

    units = ("rad", "cycle", "cycle/s", *["m"] * 3, *["m/s"] * 3)
    space = StateSpace(NAMES, units, {"phase": slice(1, 2), "phase_speed": slice(2, 3), "root_velocity": slice(6, 9)})
    parameters, driven = NAMES, [0, 1, 3, 4, 5]

    @property
    def capabilities(self):
        return PriorCapabilities(density=self, motion=SimpleNamespace())

    def _predicted(self, state, dt_s):
        moved = state.copy()
        moved[:, 1] += dt_s * state[:, 2]
        moved[:, 3:6] += dt_s * state[:, 6:9]
        return moved

    def predicted(self, state, dt_s):
        return self._predicted(state, dt_s)[:, self.driven], SIGMA[self.driven]

    def sample_initial(self, pose, n, rng):
        """Sample as the hybrid does around a fit at rest."""
        noise = rng.standard_normal((n, 9))
        noise[:, self.driven] *= FIT_SIGMA
        noise[:, [2, 6, 7, 8]] *= 0.1
        return self._wrapped(pose + noise)

    def mean(self, state, dt_s):
        return self._wrapped(self._predicted(state, dt_s))

    def sample_transition(self, state, dt_s, rng):
        return self._wrapped(self._predicted(state, dt_s) + SIGMA * rng.standard_normal(state.shape))

    def log_transition(self, previous, state, dt_s):
        mean = self.mean(previous.reshape(-1, 9), dt_s).reshape(previous.shape)
        return log_normal(state_difference(self.space, mean, state), SIGMA)

    def pose(self, state):
        return state.copy()

    def _wrapped(self, state):
        state[:, 1] %= 1.0
        return state


class Root(Memoryless):
    """A measurement 0.1 t of the root's x plus a little of the knee and the phase, with deviation 0.05."""

    def log_prob(self, previous, frame, previous_pose, pose):
        expected = pose[:, 3] + 0.3 * pose[:, 0] + 0.1 * np.cos(2.0 * np.pi * pose[:, 1])
        return -0.5 * ((0.1 * frame.index - expected) / 0.05) ** 2


AT_REST = np.array([0.0, 0.98, *[0.0] * 7])


class Fit:
    """A fit of a person at rest, near the end of a cycle."""

    def fit_frames(self, frames, start, rng):
        states = np.tile(AT_REST[CyclicPrior.driven], (len(frames), 1))
        covariance = np.tile(FIT_SIGMA**2 * np.eye(5), (len(frames), 1, 1))
        poses = np.tile(AT_REST, (len(frames), 1))
        return SimpleNamespace(states=states, state_covariance=covariance, poses=poses, iterations=3.0), None, [()] * T


def last_moments(inference, start, seed):
    """Return means and variances of knee and root and the log evidence in the last frame."""
    step = list(inference.run(frames(T), start, streams(seed)))[-1]
    return [*np.ravel([moment[[0, 3]] for moment in moments(step)]), step.log_evidence]


@pytest.fixture(scope="module")
def reference():
    """Moments by a bootstrap filter with many particles."""
    inference = ParticleFilter(CyclicPrior(), Root(), n_particles=100 * N)
    return np.mean([last_moments(inference, AT_REST, seed) for seed in range(4)], axis=0)


@pytest.mark.parametrize("algorithm", EXACT)
def test_a_hybrid_of_every_algorithm_has_the_posterior_of_the_filter(algorithm, reference):
    move = Partitioned(partitions=["root", "lower_body"]) if algorithm == "partitioned" else EXACT[algorithm]
    hybrid = Hybrid(ParticleFilter(CyclicPrior(), Root(), algorithm=move), Fit(), n_particles=2 * N, std_inflation=1.0)
    assert_agree(np.array([last_moments(hybrid, None, seed) for seed in range(SEEDS)]), reference)
    first, *later = hybrid.run(frames(T), None, streams(0))
    assert (NO_PROPOSAL in first.warnings) == (algorithm not in ("bootstrap", "auxiliary"))
    assert all(step.evaluations >= 2 * N + 3.0 for step in later)


@pytest.mark.parametrize("wrapper", ["fixed_lag", "backward_simulation", "reinitializing"])
def test_a_wrapped_hybrid_has_the_posterior_of_the_filter(wrapper, reference):
    filter_ = ParticleFilter(CyclicPrior(), Root(), n_particles=N)
    inference = WRAPPERS[wrapper](Hybrid(filter_, Fit(), std_inflation=1.0))
    assert inference.finds_start
    assert not filter_.finds_start
    assert_agree(np.array([last_moments(inference, None, seed) for seed in range(SEEDS)]), reference)


def test_the_number_of_particles_is_that_of_the_outermost_wrapper():
    filter_ = ParticleFilter(LinearPrior(), Position(simulate(T, seed=0)), n_particles=50)
    assert Reinitializing(filter_).n_particles == 50
    inference = FixedLag(Reinitializing(filter_, n_particles=40), n_particles=30)
    assert inference.n_particles == 30
    assert {len(step.particles) for step in inference.run(frames(T), MEAN0, streams(0))} == {30}
    assert filter_.n_particles == 50
    assert inference.rebuilt(n_particles=20).n_particles == 20
