"""The recorded 5–95 % bands: exact for few particles, of a thousand resampled ones for many."""

from dataclasses import replace

import numpy as np
import pytest

from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.core.frame import Frame
from workbench.evaluation.intervals import weighted_quantiles
from workbench.inference.smc.particle_filter import ParticleFilter
from workbench.likelihoods.uniform import Uniform
from workbench.priors.smooth import Smooth
from workbench.recording.write.posterior import Posterior

BODY = person(from_height(1.75))
NAME = "root_x"


def step(n_particles):
    """A step with Gaussian particles and uneven weights."""
    prior, streams = Smooth(), {name: np.random.default_rng(3) for name in ("start", "resampling", "prior")}
    frames = [Frame(index=0, time_s=0.0, views=())]
    first = next(iter(ParticleFilter(prior, Uniform(), n_particles=n_particles).run(frames, np.zeros(25), streams)))
    rng = np.random.default_rng(4)
    weights = rng.gamma(0.5, size=n_particles)
    particles = first.particles.copy()
    particles[:, prior.space.names.index(NAME)] = rng.normal(size=n_particles)
    return prior, replace(first, particles=particles, log_weights=np.log(weights / weights.sum()))


def band(n_particles):
    """The recorded ends, the values, their weights."""
    prior, taken = step(n_particles)
    numbers = Posterior(prior.space, BODY.skeleton, None, 16).add(taken)
    ends = np.array([numbers[f"posterior/parameters/{NAME}/{row}"] for row in ("low", "high")])
    return ends, taken.particles[:, prior.space.names.index(NAME)], np.exp(taken.log_weights)


def test_of_a_thousand_particles_the_bands_are_the_weighted_quantiles():
    ends, values, weights = band(1000)
    assert ends.tolist() == weighted_quantiles(values[:, None], weights, (0.05, 0.95))[:, 0].tolist()


@pytest.mark.parametrize("n_particles", [1001, 5000, 20_000])
def test_of_more_the_weight_beyond_is_five_per_cent_within_the_resampling_error(n_particles):
    (low, high), values, weights = band(n_particles)
    beyond = [weights[values < low].sum(), weights[values > high].sum()]
    assert beyond == pytest.approx([0.05, 0.05], abs=4.0 * np.sqrt(0.05 * 0.95 / 1000))  # four standard errors
    assert low in values
    assert high in values
