"""Partitioned sampling against the exact posterior and evidence of a linear Gaussian model, one column a partition."""

import numpy as np
import pytest
from linear_gaussian import (
    MEAN0,
    IsDensity,
    LinearPrior,
    Position,
    TwoJoints,
    assert_agree,
    exact,
    frames,
    moments,
    simulate,
    streams,
)

from workbench.core.state_space import StateSpace
from workbench.inference.smc.particle_filter import ParticleFilter
from workbench.inference.smc.partitioned import PARTS, Partitioned, partition_columns

T, SEEDS, N = 8, 25, 200


class TwoModels(IsDensity):
    """Two independent linear models, whose columns belong to three partitions of the body."""

    names = ("root_x", "left_knee_flexion", "left_elbow_flexion", "right_elbow_flexion")
    space = StateSpace.of({"both": (names, "rad")})
    parameters = names

    def _each(self, function, state):
        return np.concatenate([function(state[:, :2]), function(state[:, 2:])], axis=1)

    def sample_initial(self, pose, n, rng):
        return self._each(lambda mean: LinearPrior().sample_initial(mean, n, rng), pose[None])

    def sample_transition(self, state, dt_s, rng):
        return self._each(lambda model_state: LinearPrior().sample_transition(model_state, dt_s, rng), state)

    def mean(self, state, dt_s):
        return self._each(lambda model_state: LinearPrior().mean(model_state, dt_s), state)

    def log_transition(self, previous, state, dt_s):
        return sum(LinearPrior().log_transition(previous[..., k : k + 2], state[..., k : k + 2], dt_s) for k in (0, 2))

    def pose(self, state):
        return state.copy()


class BothPositions(Position):
    """The same measurement of both models."""

    def log_prob(self, previous, frame, previous_pose, pose):
        first, second = ((previous_pose[:, k : k + 2], pose[:, k : k + 2]) for k in (0, 2))
        return super().log_prob(previous, frame, *first) + super().log_prob(previous, frame, *second)


def test_posterior_and_evidence_are_exact_for_three_partitions():
    model = {"sigma": 0.1, "g": 1.0}
    measured = simulate(T, seed=3, sigma=0.1)
    mean, variance, evidence = exact(measured, **model)
    likelihood = BothPositions(measured, **model)
    estimates = []
    for seed in range(SEEDS):
        inference = ParticleFilter(TwoModels(), likelihood, algorithm=Partitioned(), n_particles=N)
        step = list(inference.run(frames(T), np.tile(MEAN0, 2), streams(seed)))[-1]
        means, variances = moments(step)
        estimates.append([*means[[1, 3]], *variances[[1, 3]], step.log_evidence])
    assert_agree(np.array(estimates), [*mean[-1, [1, 1]], *variance[-1, [1, 1]], 2.0 * evidence])


def test_weights_are_uniform_where_the_first_partition_determines_the_likelihood():
    algorithm = Partitioned(intermediate_power=1.0, partitions=("lower_body", "upper_body"))
    inference = ParticleFilter(TwoJoints(), Position(simulate(T, seed=3)), algorithm=algorithm, n_particles=50)
    _, *steps = inference.run(frames(T), MEAN0, streams(0))
    assert [step.ess for step in steps] == pytest.approx([50.0] * (T - 1))


def test_columns_belong_to_the_partition_of_their_parameter_or_to_the_first():
    names = (
        "c1",
        "phase",
        "left_knee_flexion",
        "left_elbow_flexion",
        "left_knee_flexion_velocity",
        "left_elbow_flexion_offset",
    )
    columns = partition_columns(StateSpace.of({"all": (names, "1")}), PARTS)
    assert [[names[i] for i in partition] for partition in columns] == [
        ["c1", "phase"],
        ["left_knee_flexion", "left_knee_flexion_velocity"],
        ["left_elbow_flexion", "left_elbow_flexion_offset"],
    ]
