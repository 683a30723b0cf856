"""Marginal histograms and quantiles of weighted particles against direct computation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from workbench.evaluation.uncertainty.intervals import weighted_quantiles
from workbench.recording.write import marginals as module
from workbench.recording.write.marginals import LOWEST_LOG_MASS, Marginals, histogram, masses

FLOOR = np.exp(LOWEST_LOG_MASS)

numbers = st.floats(-1e3, 1e3, allow_nan=False, width=32)
positive = st.floats(1e-3, 1.0)


@given(st.data())
def test_quantiles_are_the_smallest_values_that_reach_their_probability(data):
    n = data.draw(st.integers(1, 40))
    values = data.draw(arrays(float, (n, 3), elements=numbers))
    weights = data.draw(arrays(float, n, elements=positive))
    weights /= weights.sum()
    quantiles = weighted_quantiles(values, weights, (0.05, 0.5, 0.95))
    for k in range(3):
        for level, value in zip((0.05, 0.5, 0.95), quantiles[:, k], strict=True):
            reaching = [v for v in values[:, k] if weights[values[:, k] <= v].sum() >= level - 1e-12]
            exceeding = [v for v in values[:, k] if weights[values[:, k] <= v].sum() >= level + 1e-12] or [np.inf]
            assert min(reaching) <= value <= min(exceeding)  # equal up to rounding of the sums


def drifting(n_frames, seed=0, speed=0.4):
    """Yield particle sets that leave the range of the first one, upwards in one column and downwards in the other."""
    rng = np.random.default_rng(seed)
    for i in range(n_frames):
        weights = rng.random(200) ** 4
        yield rng.normal([speed * i, -3.0 * speed * i], [0.3, 1.0], (200, 2)), weights / weights.sum()


@pytest.mark.parametrize("n_bins", [2, 7, 64])
def test_marginals_equal_numpy_histograms_on_their_axes(n_bins):
    marginals = Marginals(2, n_bins)
    frames = list(drifting(25))
    for values, weights in frames:
        marginals.add(values, weights)
    low, high, log_mass = marginals.picture()
    assert log_mass.shape == (2, n_bins, 25)
    for k in range(2):
        edges = np.linspace(low[k], high[k], n_bins + 1)
        for i, (values, weights) in enumerate(frames):
            mass, _ = np.histogram(values[:, k], bins=edges, weights=weights)
            # single precision; with these seeds no sample is within rounding of an edge
            assert np.exp(log_mass[k, :, i]) == pytest.approx(np.maximum(mass, FLOOR), rel=1e-6)


def test_constant_parameters_have_one_bin_of_mass_one():
    marginals = Marginals(2, 8)
    for _ in range(3):
        marginals.add(np.tile([0.0, 5.0], (10, 1)), np.full(10, 0.1))
    low, high, log_mass = marginals.picture()
    assert ((low <= [0.0, 5.0]) & (high >= [0.0, 5.0])).all()
    assert np.exp(log_mass).max(axis=1) == pytest.approx(np.ones((2, 3)))


def test_histogram_counts_outliers_in_the_outermost_bins():
    mass = histogram(np.array([-9.0, 0.1, 0.2, 0.9, 7.0]), np.array([0.1, 0.2, 0.3, 0.15, 0.25]), np.linspace(0, 1, 5))
    assert mass == pytest.approx([0.6, 0.0, 0.0, 0.4])


@given(st.data())
def test_masses_equal_numpy_bincounts_bitwise(data):
    values = data.draw(arrays(float, st.tuples(st.integers(1, 50), st.integers(1, 3)), elements=numbers))
    weights = data.draw(arrays(float, len(values), elements=positive))
    low, per_unit = np.array([-3.0, 0.1, 7.0])[: values.shape[1]], np.array([0.3, 70.0, 1.0])[: values.shape[1]]
    bins = ((values - low) * per_unit).astype(np.int64).clip(0, 9)
    expected = [np.bincount(column, weights, minlength=10) for column in bins.T]
    assert masses(values, weights, low, per_unit, 10).tobytes() == np.array(expected).tobytes()


@pytest.mark.parametrize("n_frames", [8, 9, 16, 17, 31, 32, 33, 70])
def test_columns_of_a_long_run_are_means_of_several_frames(monkeypatch, n_frames):
    monkeypatch.setattr(module, "MAX_COLUMNS", 8)
    rng = np.random.default_rng(1)
    frames = [rng.random((40, 1)) for _ in range(n_frames)]
    marginals, weights = Marginals(1, 4), np.full(40, 1.0 / 40)
    for values in [np.array([[0.0], *[[1.0]] * 39]), *frames]:  # the first frame determines the axis
        marginals.add(values, weights)
    low, high, log_mass = marginals.picture()
    histograms = np.array([histogram(values[:, 0], weights, np.linspace(low[0], high[0], 5)) for values in frames])
    every, n_added = marginals.every, n_frames + 1
    assert log_mass.shape[2] == -(-n_added // every) <= 8
    for column in range(1, n_added // every):
        mean = histograms[column * every - 1 : (column + 1) * every - 1].mean(axis=0)
        assert np.exp(log_mass[0, :, column]) == pytest.approx(np.maximum(mean, FLOOR), abs=1e-6)
