"""Partitioned sampling against the exact posterior and evidence of a linear Gaussian model, a column being a part."""

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


class Twice(IsDensity):
    """Two linear models side by side, whose columns belong to three parts of the body."""

    names = ("root_x", "left_knee_flexion", "left_elbow_flexion", "right_elbow_flexion")
    space = StateSpace.of({"both": (names, "rad")})
    parameters = names

    def _each(self, move, state):
        return np.concatenate([move(state[:, :2]), move(state[:, 2:])], axis=1)

    def sample_initial(self, pose, n, rng):
        return self._each(lambda mean: LinearPrior().sample_initial(mean, n, rng), pose[None])

    def sample_transition(self, state, dt_s, rng):
        return self._each(lambda half: LinearPrior().sample_transition(half, dt_s, rng), state)

    def mean(self, state, dt_s):
        return self._each(lambda half: LinearPrior().mean(half, dt_s), state)

    def log_transition(self, previous, state, dt_s):
        halves = ((previous[..., k : k + 2], state[..., k : k + 2]) for k in (0, 2))
        return sum(LinearPrior().log_transition(before, after, dt_s) for before, after in halves)

    def pose(self, state):
        return state.copy()


class Both(Position):
    """The measurement of either model, which are the same."""

    def log_prob(self, previous, frame, previous_pose, pose):
        one, other = ((previous_pose[:, k : k + 2], pose[:, k : k + 2]) for k in (0, 2))
        return super().log_prob(previous, frame, *one) + super().log_prob(previous, frame, *other)


def test_three_parts_are_exact_too():
    model = {"sigma": 0.1, "g": 1.0}
    measured = simulate(T, seed=3, sigma=0.1)
    mean, variance, evidence = exact(measured, **model)
    found = []
    for seed in range(SEEDS):
        inference = ParticleFilter(Twice(), Both(measured, **model), algorithm=Partitioned(), n_particles=N)
        step = list(inference.run(frames(T), np.tile(MEAN0, 2), streams(seed)))[-1]
        means, variances = moments(step)
        found.append([*means[[1, 3]], *variances[[1, 3]], step.log_evidence])
    assert_agree(np.array(found), [*mean[-1, [1, 1]], *variance[-1, [1, 1]], 2.0 * evidence])


def test_one_part_that_decides_all_leaves_nothing_to_weigh():
    """Where only the first part is seen, and is trusted fully, every particle ends with the same weight."""
    move = Partitioned(intermediate_power=1.0, partitions=("lower_body", "upper_body"))
    inference = ParticleFilter(TwoJoints(), Position(simulate(T, seed=3)), algorithm=move, n_particles=50)
    _, *steps = inference.run(frames(T), MEAN0, streams(0))
    assert [step.ess for step in steps] == pytest.approx([50.0] * (T - 1))


def test_columns_go_with_their_parameter_and_the_rest_with_the_first_part():
    names = (
        "c1",
        "phase",
        "left_knee_flexion",
        "left_elbow_flexion",
        "left_knee_flexion_velocity",
        "left_elbow_flexion_offset",
    )
    columns = partition_columns(StateSpace.of({"all": (names, "1")}), PARTS)
    assert [[names[i] for i in part] for part in columns] == [
        ["c1", "phase"],
        ["left_knee_flexion", "left_knee_flexion_velocity"],
        ["left_elbow_flexion", "left_elbow_flexion_offset"],
    ]
