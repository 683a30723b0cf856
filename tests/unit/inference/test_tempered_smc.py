"""Every algorithm of the filter against the exact posterior of a linear Gaussian model; tempering and annealing."""

import numpy as np
import pytest
from linear_gaussian import (
    MEAN0,
    STD0,
    A,
    Position,
    Q,
    R,
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


def with_algorithm(algorithm):
    return lambda p, y, n: ParticleFilter(p, y, algorithm=algorithm, n_particles=n)


EXACT = {
    "tempered": with_algorithm(TemperedSMC()),
    "tempered in small steps": with_algorithm(TemperedSMC(0.8, n_mcmc_steps=1)),
    "auxiliary": with_algorithm(Auxiliary()),
    "gauss_newton": with_algorithm(GaussNewton()),
    "partitioned": with_algorithm(Partitioned(0.7, ["lower_body", "upper_body"])),
    "partitioned, arms first": with_algorithm(Partitioned(1.0, ["upper_body", "lower_body"])),
    "reinitializing": lambda p, y, n: Reinitializing(ParticleFilter(p, y), n_particles=n),
}
ALL = EXACT | {"annealed": with_algorithm(Annealed())}


@pytest.mark.parametrize("name", EXACT)
@pytest.mark.parametrize(
    ("sigma", "h", "g"),
    [
        pytest.param(0.05, 0.0, 0.0, id="sharp"),
        pytest.param(0.1, -0.5, 1.0, id="previous pose", marks=pytest.mark.slow),
    ],
)
def test_posterior_and_evidence_are_exact(name, sigma, h, g):
    """With h the likelihood depends on the previous pose, so that its quadratic differs between parents."""
    measured = simulate(T, seed=3, sigma=sigma, h=h)
    mean, variance, evidence = exact(measured, sigma=sigma, h=h, g=g)
    likelihood = Position(measured, sigma=sigma, h=h, g=g)
    estimates = last_moments(lambda p, y: EXACT[name](p, y, N), likelihood, T, range(SEEDS))
    assert_agree(estimates, [*mean[-1], *variance[-1], evidence])


def test_mcmc_steps_separate_particles_of_one_parent():
    measured = simulate(T, seed=3, sigma=0.01)
    steps = list(EXACT["tempered"](TwoJoints(), Position(measured, sigma=0.01), 200).run(frames(T), MEAN0, streams(0)))
    for step in steps[1:]:  # without MCMC steps there are as many states as parents with offspring
        assert len(np.unique(step.particles, axis=0)) > step.diagnostics["unique_particles"]
        assert step.diagnostics["n_temperatures"] >= 2
        assert step.ess == pytest.approx(200)


def test_the_next_temperature_keeps_the_effective_sample_size():
    log_prob = -0.5 * (np.arange(100) / 3.0) ** 2
    phi = next_temperature(log_prob, 0.1, 0.5)
    weights = np.exp((phi - 0.1) * log_prob)
    assert weights.sum() ** 2 / (weights**2).sum() == pytest.approx(50.0, rel=1e-6)
    assert next_temperature(1e-3 * log_prob, 0.1, 0.5) == 1.0
    # Particles of likelihood zero do not count.
    assert next_temperature(np.append(log_prob, [-np.inf] * 50), 0.1, 0.5) == pytest.approx(phi)


@pytest.mark.parametrize("name", ALL)
def test_evaluations_are_counted(name):
    likelihood = Position(simulate(T, seed=1))
    steps = list(ALL[name](TwoJoints(), likelihood, 40).run(frames(T), MEAN0, streams(4)))
    assert sum(step.evaluations for step in steps) == likelihood.evaluated > 0


class Degenerate(Position):
    """The likelihood of all particles is zero in frame 3, that of half of the particles undefined in frame 5."""

    def log_prob(self, previous, frame, previous_pose, pose):
        values = super().log_prob(previous, frame, previous_pose, pose)
        if frame.index == 3:
            return np.full(len(pose), -np.inf)
        return np.where((np.arange(len(pose)) % 2 == 0) & (frame.index == 5), np.nan, values)


@pytest.mark.parametrize("name", ALL)
def test_degenerate_frames_are_reported_and_tracking_continues(name):
    steps = list(ALL[name](TwoJoints(), Degenerate(simulate(T, seed=1)), 40).run(frames(T), MEAN0, streams(0)))
    assert any("no particle explains" in warning for warning in steps[3].warnings)
    assert any("undefined" in warning for warning in steps[5].warnings)
    for step in steps:
        assert np.exp(step.log_weights).sum() == pytest.approx(1.0)
        assert np.isfinite(step.particles).all()
        assert np.isfinite(step.expected_pose).all()
        assert (step.ancestors < 40).all()


def test_annealing_concentrates_particles_at_the_mode_and_reports_no_posterior():
    measured = simulate(T, seed=3)
    _, variance, _ = exact(measured)
    steps = list(ALL["annealed"](TwoJoints(), Position(measured), 500).run(frames(T), MEAN0, streams(0)))
    assert steps[0].warnings == (NO_POSTERIOR,)
    assert all(step.diagnostics["is_posterior"] == 0.0 for step in steps[1:])
    _, annealed_variance = moments(steps[-1])
    assert annealed_variance[0] < 0.7 * variance[-1][0]
    assert np.abs(steps[-1].particles[:, 0] - measured[-1]).min() < 0.3


def test_two_annealing_layers_have_the_variance_of_their_gaussians():
    measured, algorithm = simulate(2, seed=3), with_algorithm(Annealed(layers=2))
    *_, last = algorithm(TwoJoints(), Position(measured), 20_000).run(frames(2), MEAN0, streams(0))
    predicted = (A**2 @ STD0**2 + Q**2)[0]
    first_layer = 1.0 / (1.0 / predicted + 0.5**1.5 / R**2) + (0.5 * Q[0]) ** 2
    assert moments(last)[1][0] == pytest.approx(1.0 / (1.0 / first_layer + 1.0 / R**2), rel=0.03)


def test_track_is_lost_after_three_frames_of_low_evidence_and_thirty_of_reference():
    evidence = list(np.random.default_rng(0).normal(-40.0, 1.0, 40))
    assert not track_lost([-40.0] * 29 + [-400.0] * 3)
    assert not track_lost(evidence)
    assert not track_lost([*evidence, -60.0])
    assert track_lost([*evidence, -60.0, -60.0, -60.0])
