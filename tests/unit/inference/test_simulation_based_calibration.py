"""Simulation-based calibration: true states drawn from the prior, with data drawn from the likelihood's model, have
uniform ranks in the posterior samples of every inference. The annealed filter is excluded, as it is no posterior."""

import numpy as np
import pytest
from scipy.stats import norm
from simulated_posteriors import Simulated, arm_prior, filtered, fitted, walking_prior

from workbench.inference.smc.bootstrap import Auxiliary, Bootstrap
from workbench.inference.smc.gauss_newton import GaussNewton
from workbench.inference.smc.particle_filter import ParticleFilter
from workbench.inference.smc.partitioned import Partitioned
from workbench.inference.smc.smoothing import BackwardSimulation, FixedLag
from workbench.inference.smc.tempered_smc import TemperedSMC

MIN_COVERAGE, MAX_COVERAGE = 0.86, 0.93
"""Bounds of the coverage of 90 % intervals."""
SIGNIFICANCE = 1e-3
"""Level of all χ² tests of one inference together."""
ARM = tuple(f"right_{angle}" for angle in ("shoulder_abduction", "shoulder_flexion", "shoulder_twist", "elbow_flexion"))


def particles(n_particles, algorithm):
    return lambda prior, likelihood: ParticleFilter(prior, likelihood, algorithm=algorithm, n_particles=n_particles)


EXACT = {  # with the numbers of particles of conf/inference, but for the last
    "particle_filter": particles(5000, Bootstrap()),
    "auxiliary": particles(2500, Auxiliary()),
    "partitioned": particles(1500, Partitioned(partitions=ARM)),
    "gauss_newton": particles(2000, GaussNewton()),
    "tempered_smc": particles(1000, TemperedSMC()),
    "fixed_lag": lambda prior, likelihood: FixedLag(ParticleFilter(prior, likelihood)),
    "backward_simulation": lambda prior, likelihood: BackwardSimulation(
        ParticleFilter(prior, likelihood, n_particles=1500), n_paths=250
    ),
}


def assert_calibrated(simulated):
    assert MIN_COVERAGE < simulated.coverage(0.9) < MAX_COVERAGE
    p_values = simulated.p_values()
    assert p_values.min() > SIGNIFICANCE / len(p_values), p_values


@pytest.mark.slow
@pytest.mark.parametrize("inference", EXACT)
def test_every_exact_filter_of_an_arm_is_calibrated(inference):
    n_replicates = 30 if inference == "backward_simulation" else 60  # its time is quadratic in the particles
    assert_calibrated(filtered(EXACT[inference], arm_prior(), n_frames=4, n_replicates=n_replicates))


@pytest.mark.slow
def test_a_filter_of_a_walk_is_calibrated():
    """The state has 16 numbers, of which 8 are coefficients that hardly change."""
    assert_calibrated(filtered(particles(2000, GaussNewton()), walking_prior(), n_frames=6, n_replicates=60))


@pytest.mark.slow
def test_more_particles_widen_the_too_narrow_intervals_of_a_long_walk():
    """The coefficients hardly change, so that few ancestors remain, most of all in the last frames."""
    few, many = (
        filtered(particles(n, Bootstrap()), walking_prior(), n_frames=30, n_replicates=10) for n in (500, 3000)
    )
    assert few.coverage(0.9) < many.coverage(0.9) - 0.03
    assert few.coverage(0.9) < MIN_COVERAGE
    assert Simulated(many.ranks[:, :12]).coverage(0.9) > many.coverage(0.9)


@pytest.mark.slow
@pytest.mark.parametrize("frames_per_style", [1, 10], ids=["varying style", "constant style"])
def test_least_squares_of_a_walk_are_calibrated(frames_per_style):
    assert_calibrated(fitted(frames_per_style, n_frames=10, n_replicates=50))


@pytest.mark.slow
def test_intervals_are_too_narrow_for_correlated_errors_unless_the_correlation_is_estimated():
    scene = {"frames_per_style": 1, "n_frames": 10, "n_replicates": 20, "correlation": 0.7}
    assert fitted(**scene, rho=0.0).coverage(0.9) < 0.8
    assert 0.85 < fitted(**scene).coverage(0.9) < 0.97


def test_ranks_distinguish_calibrated_narrow_and_wide_posteriors():
    """The rank of a normal truth is Φ of its deviation over that of the posterior."""
    truths = np.random.default_rng(1).standard_normal((2000, 2, 3))
    calibrated, narrow, wide = (Simulated(norm.cdf(truths * factor)) for factor in (1.0, 2.0, 0.5))
    assert calibrated.coverage(0.9) == pytest.approx(0.9, abs=0.02)
    assert calibrated.coverage(0.5) == pytest.approx(0.5, abs=0.02)
    assert calibrated.p_values().min() > SIGNIFICANCE
    assert narrow.coverage(0.9) == pytest.approx(norm.cdf(1.645 / 2.0) - norm.cdf(-1.645 / 2.0), abs=0.02)
    assert wide.coverage(0.9) > 0.98
    assert max(narrow.p_values().max(), wide.p_values().max()) < SIGNIFICANCE
