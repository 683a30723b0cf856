"""Alignment of cycles with known shifts, and the invariances of alignment, periods and imputation."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from workbench.motion.models.cycle_alignment import N_PHASES, align, fit_periodic, periodic_basis
from workbench.motion.models.imputation import impute

M = 5


def cycle(phase, rng):
    """Return a smooth random periodic curve (F, M) at phases (F,)."""
    waves = rng.normal(size=(4, M)) + 1j * rng.normal(size=(4, M))
    orders = np.arange(1, 5)
    return (np.exp(2j * np.pi * phase[:, None] * orders) / orders @ waves).real


def shifted_cycles(shifts, periods, noise=0.05, gaps=0.0, seed=0):
    rng = np.random.default_rng(seed)
    sequences = []
    for shift, period in zip(shifts, periods, strict=True):
        frames = np.arange(int(period * rng.uniform(2.2, 4.0)))
        series = cycle(frames / period + shift, np.random.default_rng(seed)) + noise * rng.normal(size=(len(frames), M))
        series[rng.random(series.shape) < gaps] = np.nan
        sequences.append(series)
    return sequences


def relative(offsets):
    """Return offsets relative to the first, in cycles from −1/2 to 1/2."""
    return (offsets - offsets[0] + 0.5) % 1.0 - 0.5


@pytest.mark.parametrize("gaps", [0.0, 0.3])
@pytest.mark.parametrize("seed", range(2))
def test_shifts_are_recovered(gaps, seed):
    rng = np.random.default_rng(100 + seed)
    shifts, periods = rng.random(8), rng.uniform(90.0, 150.0, 8)
    aligned = align(shifted_cycles(shifts, periods, gaps=gaps, seed=seed), periods)
    errors = (relative(aligned.offsets) - relative(shifts) + 0.5) % 1.0 - 0.5
    assert np.abs(errors).max() <= 1.5 / N_PHASES  # two offsets, each rounded to a step, and the noise


def test_the_last_error_is_the_deviation_from_the_reference():
    """Every sample is at a phase of the grid, so that the sum has no rounding of phases."""
    periods = [64.0, 128.0, 256.0]
    sequences = shifted_cycles([0.1, 0.5, 0.7], periods, gaps=0.2)
    aligned = align(sequences, periods)
    scale = np.zeros(M)
    deviation = np.zeros(M)
    for i, series in enumerate(sequences):
        places = np.rint(aligned.phases(i, len(series)) * N_PHASES).astype(int) % N_PHASES
        deviation += np.nansum((series - aligned.reference[places]) ** 2, axis=0)
        scale += np.nansum((series - np.nanmean(series, axis=0)) ** 2, axis=0)
    variance = scale / sum(np.isfinite(series).sum(axis=0) for series in sequences)
    assert (deviation / variance).sum() == pytest.approx(aligned.errors[-1], rel=1e-9)


def test_opposite_phases_do_not_cancel():
    frames = np.arange(300)
    wave = np.column_stack([np.cos(2 * np.pi * frames / 100), np.sin(2 * np.pi * frames / 100)])
    aligned = align([wave, -wave], [100.0, 100.0])
    assert abs(relative(aligned.offsets)[1]) == pytest.approx(0.5, abs=1.5 / N_PHASES)
    assert aligned.errors[-1] < 1e-3 * aligned.errors[0]


def test_the_regression_spline_is_the_periodic_spline():
    """With a sample at every knot it interpolates like SciPy's periodic cubic spline."""
    knots = np.arange(13) / 12
    values = np.sin(2 * np.pi * knots) + 0.3 * np.cos(6 * np.pi * knots)
    phases = np.linspace(0.0, 2.0, 77)
    spline = CubicSpline(knots, np.r_[values[:-1], values[0]], bc_type="periodic")
    coefficients = fit_periodic(periodic_basis(knots[:-1], 12), np.ones((12, 1)), values[:-1, None])
    assert periodic_basis(phases, 12) @ coefficients[:, 0] == pytest.approx(spline(phases % 1.0), abs=1e-12)


N_ANGLES = 3


def sequence(period, shift, rng, n=260):
    phase = 2 * np.pi * (np.arange(n) / period + shift)
    waves = np.column_stack([np.cos(phase), np.sin(phase) + 0.4 * np.cos(2 * phase), np.cos(phase + 2.0)])
    series = waves + 0.1 * rng.standard_normal((n, N_ANGLES))
    for angle in series.T:
        start = rng.integers(n - 30)
        angle[start : start + 30] = np.nan
    return series


seeds = st.integers(0, 2**32 - 1)
periods = st.floats(60.0, 110.0)
units = st.tuples(*[st.floats(0.01, 100.0)] * N_ANGLES)
levels = st.tuples(*[st.floats(-50.0, 50.0)] * N_ANGLES)


@settings(max_examples=5)
@given(seeds, st.permutations(range(4)))
def test_imputed_values_do_not_depend_on_the_order_of_the_sequences(seed, order):
    rng = np.random.default_rng(seed)
    sequences = [sequence(80.0, 0.0, rng) for _ in range(4)]
    aligned = align(sequences, [80.0] * 4)
    shuffled = replace(aligned, periods=aligned.periods[order], offsets=aligned.offsets[order])
    expected, imputed = impute(sequences, aligned), impute([sequences[i] for i in order], shuffled)
    for series, i in zip(imputed, order, strict=True):  # to the tolerance of the iteration
        np.testing.assert_allclose(series, expected[i], atol=1e-4)
