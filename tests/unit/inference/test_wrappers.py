"""Every wrapper around every move: it runs, and keeps the filter's law; what cannot stand around what is refused."""

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
from workbench.inference.smc.particle_filter import DegenerateWeights, ParticleFilter
from workbench.inference.smc.partitioned import Partitioned
from workbench.inference.smc.reinitializing import REFERENCE_FRAMES, Reinitializing
from workbench.inference.smc.smoothing import BackwardSimulation, FixedLag
from workbench.inference.smc.tempered_smc import Annealed, TemperedSMC
from workbench.priors.density import log_normal, state_difference

T, SEEDS, N = 5, 16, 150
EXACT = {
    "bootstrap": Bootstrap(),
    "auxiliary": Auxiliary(),
    "partitioned": Partitioned(partitions=["lower_body", "upper_body"]),
    "gauss_newton": GaussNewton(),
    "tempered_smc": TemperedSMC(),
}
MOVES = EXACT | {"annealed": Annealed()}
WRAPPERS = {
    "reinitializing": lambda plain: Reinitializing(plain),
    "fixed_lag": lambda plain: FixedLag(plain, lag=2, min_effective_ancestors=1),
    "backward_simulation": lambda plain: BackwardSimulation(plain, n_paths=N, min_effective_ancestors=1),
    "fixed_lag of reinitializing": lambda plain: FixedLag(Reinitializing(plain), lag=2, min_effective_ancestors=1),
}


def around(wrapper, move, measured):
    return WRAPPERS[wrapper](ParticleFilter(TwoJoints(), Position(measured), algorithm=MOVES[move], n_particles=N))


@pytest.mark.parametrize("move", EXACT)
@pytest.mark.parametrize("wrapper", WRAPPERS)
@pytest.mark.slow
def test_the_last_frames_law_is_the_filters_and_earlier_ones_know_what_followed(wrapper, move):
    measured = simulate(T, seed=3)
    seen = {t: min(t + 3, T) if "lag" in wrapper else (t + 1 if wrapper == "reinitializing" else T) for t in range(T)}
    for t in (1, T - 1):
        mean, variance, _ = exact(measured[: seen[t]])
        found = []
        for seed in range(SEEDS):
            steps = list(around(wrapper, move, measured).run(frames(T), MEAN0, streams(seed)))
            found.append(np.concatenate(moments(steps[t])))
        assert_agree(np.array(found), [*mean[t], *variance[t]])


class Impossible(Position):
    def log_prob(self, previous, frame, previous_pose, pose):
        return np.full(len(pose), -np.inf)


@pytest.mark.parametrize("move", MOVES)
def test_every_move_ends_the_run_where_nothing_explains_a_frame_if_told_to(move):
    given = {"algorithm": MOVES[move], "n_particles": N}
    likelihood = Impossible(simulate(T, seed=3))
    steps = list(ParticleFilter(TwoJoints(), likelihood, **given).run(frames(T), MEAN0, streams(0)))
    assert all("no particle explains" in step.warnings[0] for step in steps[1:])
    with pytest.raises(DegenerateWeights, match="frame 1"):
        list(ParticleFilter(TwoJoints(), likelihood, on_degenerate="stop", **given).run(frames(T), MEAN0, streams(0)))


@pytest.mark.parametrize("move", EXACT)
def test_who_is_lost_is_found_by_every_move(move):
    class Anywhere(TwoJoints):
        def sample_initial(self, pose, n, rng):
            return pose + np.array([10.0, 0.3]) * rng.uniform(-1.0, 1.0, (n, 2))

    n = REFERENCE_FRAMES + 15
    measured = simulate(n, seed=2)
    measured[REFERENCE_FRAMES + 5 :] += 8.0
    inference = Reinitializing(
        ParticleFilter(Anywhere(), Position(measured, sigma=0.1), algorithm=MOVES[move]), n_particles=300
    )
    steps = list(inference.run(frames(n), MEAN0, streams(0)))
    anew = [step.frame.index for step in steps if step.diagnostics["reinitialized"] == 1.0]
    assert anew[0] in range(REFERENCE_FRAMES + 6, REFERENCE_FRAMES + 10)
    assert abs(steps[-1].expected_pose[0] - measured[-1]) < 0.5


class Follows(TwoJoints):
    """A third column, the last change of the first one, which follows from the others and shows in no density."""

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


@pytest.mark.parametrize("move", sorted(MOVES.keys() - {"partitioned"}))
def test_columns_that_follow_from_others_are_completed_once_the_choice_is_made(move):
    measured = simulate(T, seed=3)
    inference = ParticleFilter(Follows(), Position(measured), algorithm=MOVES[move], n_particles=N)
    before = None
    for step in inference.run(frames(T), MEAN0, streams(0)):
        if before is not None:
            changes = step.particles[:, 0] - before.particles[step.ancestors, 0]
            np.testing.assert_array_equal(step.particles[:, 2], changes)
        before = step


@pytest.mark.parametrize("move", sorted(EXACT.keys() - {"partitioned"}))
def test_columns_that_follow_from_others_leave_the_law_alone(move):
    measured = simulate(T, seed=3)
    mean, variance, _ = exact(measured)
    found = []
    for seed in range(SEEDS):
        inference = ParticleFilter(Follows(), Position(measured), algorithm=MOVES[move], n_particles=N)
        step = list(inference.run(frames(T), MEAN0, streams(seed)))[-1]
        weights = np.exp(step.log_weights)
        centre = weights @ step.poses
        found.append([*centre, *(weights @ (step.poses - centre) ** 2)])
    assert_agree(np.array(found), [*mean[-1], *variance[-1]])


NAMES = (
    "left_knee_flexion", "phase", "phase_speed", "root_x", "root_y", "root_z",
    *(f"root_{axis}_velocity" for axis in "xyz"),
)  # fmt: skip
SIGMA = np.array([0.2, 0.02, 0.02, *[0.05] * 3, *[0.1] * 3])
FIT_SIGMA = 0.05


class Cycle(IsDensity):
    """What the hybrid needs of a prior: a coefficient, a phase and its speed, a root and its velocity."""

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
        """As the hybrid starts about a fit at rest."""
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
    """N(0.3 t, 0.05²) of the root's x with a little of the knee and the phase."""

    def log_prob(self, previous, frame, previous_pose, pose):
        expected = pose[:, 3] + 0.3 * pose[:, 0] + 0.1 * np.cos(2.0 * np.pi * pose[:, 1])
        return -0.5 * ((0.1 * frame.index - expected) / 0.05) ** 2


AT_REST = np.array([0.0, 0.98, *[0.0] * 7])


class Fit:
    """A person at rest, near the end of a cycle."""

    def fit_frames(self, given, start, rng):
        states = np.tile(AT_REST[Cycle.driven], (len(given), 1))
        covariance = np.tile(FIT_SIGMA**2 * np.eye(5), (len(given), 1, 1))
        poses = np.tile(AT_REST, (len(given), 1))
        return SimpleNamespace(states=states, state_covariance=covariance, poses=poses, iterations=3.0), None, [()] * T


def last(inference, start, seed):
    step = list(inference.run(frames(T), start, streams(seed)))[-1]
    weights = np.exp(step.log_weights)
    two = step.particles[:, [0, 3]]
    centre = weights @ two
    return [*centre, *(weights @ (two - centre) ** 2), step.log_evidence]


@pytest.fixture(scope="module")
def known():
    """By a plain filter with many particles."""
    plain = ParticleFilter(Cycle(), Root(), n_particles=100 * N)
    return np.mean([last(plain, AT_REST, seed) for seed in range(4)], axis=0)


@pytest.mark.parametrize("move", EXACT)
def test_a_hybrid_of_every_move_keeps_the_filters_law(move, known):
    parts = Partitioned(partitions=["root", "lower_body"]) if move == "partitioned" else MOVES[move]
    hybrid = Hybrid(ParticleFilter(Cycle(), Root(), algorithm=parts), Fit(), n_particles=2 * N, std_inflation=1.0)
    assert_agree(np.array([last(hybrid, None, seed) for seed in range(SEEDS)]), known)
    first, *later = hybrid.run(frames(T), None, streams(0))
    assert (NO_PROPOSAL in first.warnings) == (move not in ("bootstrap", "auxiliary"))
    assert all(step.evaluations >= 2 * N + 3.0 for step in later)


def test_a_hybrid_can_be_smoothed_and_restarted(known):
    plain = ParticleFilter(Cycle(), Root(), n_particles=N)
    assert not plain.finds_start
    for whole in (
        FixedLag(Hybrid(plain, Fit(), std_inflation=1.0), min_effective_ancestors=1),
        BackwardSimulation(Hybrid(plain, Fit(), std_inflation=1.0), n_paths=N, min_effective_ancestors=1),
        Reinitializing(Hybrid(plain, Fit(), std_inflation=1.0)),
    ):
        assert whole.finds_start
        found = np.array([last(whole, None, seed) for seed in range(SEEDS)])
        assert_agree(found, known)


def test_the_number_of_particles_reaches_the_filter_through_all_wrappers():
    plain = ParticleFilter(LinearPrior(), Position(simulate(T, seed=0)), n_particles=50)
    assert Reinitializing(plain).n_particles == 50
    whole = FixedLag(Reinitializing(plain, n_particles=40), n_particles=30)
    assert whole.n_particles == 30
    assert {len(step.particles) for step in whole.run(frames(T), MEAN0, streams(0))} == {30}
    assert plain.n_particles == 50
    assert whole.rebuilt(n_particles=20).n_particles == 20
