"""Every move of the filter against the exact posterior and evidence of a linear Gaussian model; and what tempers."""

import numpy as np
import pytest
from linear_gaussian import (
    MEAN0,
    Position,
    TwoJoints,
    assert_agree,
    exact,
    frames,
    last_moments,
    moments,
    simulate,
    streams,
)

from workbench.inference.smc.bootstrap import Auxiliary
from workbench.inference.smc.gauss_newton import GaussNewton
from workbench.inference.smc.particle_filter import ParticleFilter
from workbench.inference.smc.partitioned import Partitioned
from workbench.inference.smc.reinitializing import Reinitializing, track_lost
from workbench.inference.smc.tempered_smc import NO_POSTERIOR, Annealed, TemperedSMC, next_temperature

T, SEEDS, N = 6, 25, 300


def moving(move):
    return lambda p, y, n: ParticleFilter(p, y, algorithm=move, n_particles=n)


EXACT = {
    "tempered": moving(TemperedSMC()),
    "tempered, slowly": moving(TemperedSMC(0.8, n_mcmc_steps=1)),
    "auxiliary": moving(Auxiliary()),
    "gauss_newton": moving(GaussNewton()),
    "partitioned": moving(Partitioned(0.7, ["lower_body", "upper_body"])),
    "partitioned, arms first": moving(Partitioned(1.0, ["upper_body", "lower_body"])),
    "reinitializing": lambda p, y, n: Reinitializing(ParticleFilter(p, y), n_particles=n),
}
EVERY = EXACT | {"annealed": moving(Annealed())}


@pytest.mark.parametrize("name", EXACT)
@pytest.mark.parametrize(("sigma", "h", "g"), [(0.3, 0.0, 0.0), (0.05, 0.0, 0.0), (0.1, -0.9, 0.0), (0.1, -0.5, 1.0)])
@pytest.mark.slow
def test_converges_to_the_exact_posterior_and_evidence(name, sigma, h, g):
    """h: the likelihood looks at the previous pose as well, so that a quadratic of it is that of another parent."""
    measured = simulate(T, seed=3, sigma=sigma, h=h)
    mean, variance, evidence = exact(measured, sigma=sigma, h=h, g=g)
    likelihood = Position(measured, sigma=sigma, h=h, g=g)
    found = last_moments(lambda p, y: EXACT[name](p, y, N), likelihood, T, range(SEEDS))
    assert_agree(found, [*mean[-1], *variance[-1], evidence])


def test_moves_bring_particles_of_one_parent_apart():
    measured = simulate(T, seed=3, sigma=0.01)
    steps = list(EXACT["tempered"](TwoJoints(), Position(measured, sigma=0.01), 200).run(frames(T), MEAN0, streams(0)))
    for step in steps[1:]:  # without moves there would be as many states as parents with offspring
        assert len(np.unique(step.particles, axis=0)) > step.diagnostics["unique_particles"]
        assert step.diagnostics["n_temperatures"] >= 2
        assert step.ess == pytest.approx(200)


def test_the_next_temperature_keeps_the_effective_sample_size():
    log_prob = -0.5 * (np.arange(100) / 3.0) ** 2
    phi = next_temperature(log_prob, 0.1, 0.5)
    weights = np.exp((phi - 0.1) * log_prob)
    assert weights.sum() ** 2 / (weights**2).sum() == pytest.approx(50.0, rel=1e-6)
    assert next_temperature(1e-3 * log_prob, 0.1, 0.5) == 1.0
    # the impossible ones count neither way
    assert next_temperature(np.append(log_prob, [-np.inf] * 50), 0.1, 0.5) == pytest.approx(phi)


@pytest.mark.parametrize("name", EVERY)
def test_evaluations_are_counted_and_the_same_seed_gives_the_same_steps(name):
    measured = simulate(T, seed=1)
    runs = []
    for seed in (4, 4, 5):
        likelihood = Position(measured)
        steps = list(EVERY[name](TwoJoints(), likelihood, 40).run(frames(T), MEAN0, streams(seed)))
        assert sum(step.evaluations for step in steps) == likelihood.evaluated > 0
        runs.append(np.concatenate([step.particles for step in steps]))
    assert (runs[0] == runs[1]).all()
    assert not (runs[0] == runs[2]).all()


class Impossible(Position):
    """Nothing explains frame 3; in frame 5 half of the particles are undefined."""

    def log_prob(self, previous, frame, previous_pose, pose):
        values = super().log_prob(previous, frame, previous_pose, pose)
        if frame.index == 3:
            return np.full(len(pose), -np.inf)
        return np.where((np.arange(len(pose)) % 2 == 0) & (frame.index == 5), np.nan, values)


@pytest.mark.parametrize("name", EVERY)
def test_frames_that_nothing_explains_are_said_and_survived(name):
    steps = list(EVERY[name](TwoJoints(), Impossible(simulate(T, seed=1)), 40).run(frames(T), MEAN0, streams(0)))
    assert any("no particle explains" in sentence for sentence in steps[3].warnings)
    assert any("undefined" in sentence for sentence in steps[5].warnings)
    for step in steps:
        assert np.exp(step.log_weights).sum() == pytest.approx(1.0)
        assert np.isfinite(step.particles).all()
        assert np.isfinite(step.expected_pose).all()
        assert (step.ancestors < 40).all()


def test_annealing_finds_the_peak_and_says_that_its_spread_is_no_posterior():
    measured = simulate(T, seed=3)
    _, variance, _ = exact(measured)
    steps = list(EVERY["annealed"](TwoJoints(), Position(measured), 500).run(frames(T), MEAN0, streams(0)))
    assert steps[0].warnings == (NO_POSTERIOR,)
    assert all(step.diagnostics["is_posterior"] == 0.0 for step in steps[1:])
    _, found = moments(steps[-1])
    assert found[0] < 0.7 * variance[-1][0]  # gathered, which is why it has to be said
    best = max(steps[-1].particles, key=lambda x: -abs(x[0] - measured[-1]))
    assert abs(best[0] - measured[-1]) < 0.3


def test_nobody_is_lost_before_there_is_something_to_compare_with_nor_while_all_goes_on_as_before():
    usual = list(np.random.default_rng(0).normal(-40.0, 1.0, 40))
    assert not track_lost([-40.0] * 29 + [-400.0] * 3)
    assert not track_lost(usual)
    assert not track_lost([*usual, -60.0])
    assert track_lost([*usual, -60.0, -60.0, -60.0])
