"""A recording's intervals, marginals and rank histograms of the posterior against the particles."""

from dataclasses import replace

import numpy as np
import pytest
import recording_steps
from recorded import record, static

from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.skeleton import POSE_NAMES
from workbench.core.frame import Frame
from workbench.evaluation.uncertainty.intervals import weighted_quantiles
from workbench.evaluation.uncertainty.posterior_calibration import ranks, weight_below
from workbench.evaluation.uncertainty.step_calibration import pose_ranks
from workbench.inference.smc.particle_filter import ParticleFilter
from workbench.likelihoods.uniform import Uniform
from workbench.motion.models.walking import learn_walking
from workbench.motion.models.windows import learn_windows
from workbench.motion.synthetic.gait import builtin_motions
from workbench.priors.cyclic import Cyclic
from workbench.priors.implicit import Implicit
from workbench.priors.smooth import Smooth
from workbench.recording.write.posterior import RANKS, Posterior, _interval_ends

BODY = person(from_height(1.75))
N_FRAMES, N_BINS = 4, 16


def steps(prior, n_particles=40):
    frames = [Frame(index=t, time_s=t / 30, views=()) for t in range(N_FRAMES)]
    streams = {name: np.random.default_rng(k) for k, name in enumerate(("start", "resampling", "prior"))}
    start = builtin_motions()[0].poses[0]
    return list(ParticleFilter(prior, Uniform(), n_particles=n_particles).run(frames, start, streams))


def posterior(prior, run):
    collected = Posterior(prior.space, BODY.skeleton, N_BINS)
    for step in run:
        collected.add(step)
    return collected


@pytest.fixture(scope="module")
def priors():
    motions = builtin_motions(n_subjects=2)
    return {
        "walk": Cyclic(learn_walking(builtin_motions(), variance=0.95, n_components=4, scaling="none")),
        "smooth": Smooth(),
        "arm": Smooth(parameters=["right_arm"]),
        "database": Implicit(learn_windows(motions)),
        "arm database": Implicit(learn_windows(motions, angles=["right_arm"], include_root=False)),
    }


@pytest.mark.parametrize("name", ["database", "arm database"])
def test_future_coefficients_of_a_window_are_not_shown(priors, name):
    prior = priors[name]
    b = len(prior.windows.sigmas)
    expected = (*POSE_NAMES, *(f"c{k + 1}" for k in range(b)))
    assert posterior(prior, steps(prior)).names == expected
    assert len(prior.space) == len(expected) + b * (prior.windows.window_frames - 1)


@pytest.mark.parametrize("name", ["walk", "smooth", "arm", "database", "arm database"])
def test_marginals_and_intervals_are_those_of_the_named_parameter(priors, name):
    """A parameter is a column of the state or an angle of the pose."""
    prior = priors[name]
    run = steps(prior)
    collected = Posterior(prior.space, BODY.skeleton, N_BINS)
    numbers = [collected.add(step) for step in run]
    pictures, axes = collected.pictures()
    entities = dict(pictures)
    log_mass = entities["posterior/marginals"].data.as_arrow_array().to_pylist()[0]["buffer"]
    log_mass = np.array(log_mass, dtype=float).reshape(-1, N_BINS, N_FRAMES)
    assert len(axes["names"]) == len(axes["units"]) == len(axes["low"]) == len(log_mass) == len(collected.names)
    rows = entities["posterior/legend"].text.as_arrow_array().to_pylist()[0].split("\n")[2:]
    assert ["| degrees |" in row for row in rows] == [unit == "rad" for unit in axes["units"]]
    for k, parameter in enumerate(collected.names):
        edges = np.linspace(axes["low"][k], axes["high"][k], N_BINS + 1)
        for t, step in enumerate(run):
            if parameter in prior.space.names:
                values = step.particles[:, prior.space.names.index(parameter)]
            else:
                values = step.poses[:, BODY.skeleton.dof(parameter)]
            assert numbers[t][f"posterior/parameters/{parameter}/mean"] == pytest.approx(values.mean(), abs=1e-9)
            mass = np.histogram(values, edges)[0] / len(values)
            # a value on an edge may be counted on either side; empty bins have a mass of 1e-4
            assert np.abs(np.cumsum(np.exp(log_mass[k, :, t])) - np.cumsum(mass)).max() <= 1 / len(values) + 16e-4


def weighted_root_x(n_particles):
    """Return interval, values and weights of root_x in a step with Gaussian values and gamma-distributed weights."""
    prior = Smooth()
    first = steps(prior, n_particles)[0]
    rng = np.random.default_rng(4)
    weights = rng.gamma(0.5, size=n_particles)
    particles, k = first.particles.copy(), prior.space.names.index("root_x")
    particles[:, k] = rng.normal(size=n_particles)
    step = replace(first, particles=particles, log_weights=np.log(weights / weights.sum()))
    numbers = Posterior(prior.space, BODY.skeleton, N_BINS).add(step)
    ends = [numbers[f"posterior/parameters/root_x/{row}"] for row in ("low", "high")]
    return ends, particles[:, k], np.exp(step.log_weights)


def test_intervals_of_a_thousand_particles_are_the_weighted_quantiles():
    ends, values, weights = weighted_root_x(1000)
    assert ends == weighted_quantiles(values[:, None], weights, (0.05, 0.95))[:, 0].tolist()


@pytest.mark.parametrize("n_particles", [1001, 5000])
def test_intervals_of_more_particles_are_quantiles_within_the_resampling_error(n_particles):
    (low, high), values, weights = weighted_root_x(n_particles)
    outside = [weights[values < low].sum(), weights[values > high].sum()]
    assert outside == pytest.approx([0.05, 0.05], abs=4.0 * np.sqrt(0.05 * 0.95 / 1000))  # four standard errors
    assert {low, high} <= {*values.tolist()}
    equal = np.full((3000, 1), 1.0 / 3000)  # every third is resampled: 1, 4, 7, …
    assert _interval_ends(np.arange(3000.0)[:, None], equal[:, 0]).ravel().tolist() == [1 + 3 * 49, 1 + 3 * 949]


def heights(path, entity):
    bars = static(path, entity, "BarChart:values")
    return None if bars is None else np.array(bars[0]["buffer"])


def test_the_rank_histogram_of_all_frames_but_the_first_is_recorded(tmp_path):
    run = list(recording_steps.steps(6))
    path = record(tmp_path / "run.rrd", run)
    below = [weight_below(step.poses, np.exp(step.log_weights), step.frame.truth.pose) for step in run[1:]]
    estimated = [np.ptp(step.poses, axis=0) > 0.0 for step in run[1:]]
    all_ranks = np.concatenate([ranks(b)[varied] for b, varied in zip(below, estimated, strict=True)])
    assert len(all_ranks) >= 5
    expected = np.histogram(all_ranks, bins=10, range=(0.0, 1.0))[0] / len(all_ranks)
    np.testing.assert_allclose(heights(path, f"/{RANKS}"), expected, rtol=1e-6)
    assert heights(path, f"/{RANKS}/uniform") == pytest.approx(np.full(10, 0.1))
    without_truth = [replace(step, frame=replace(step.frame, truth=None)) for step in run[:3]]
    assert all(len(pose_ranks(step)) == 0 for step in without_truth)
    assert heights(record(tmp_path / "without_truth.rrd", without_truth), f"/{RANKS}") is None
