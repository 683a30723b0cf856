"""The signal-to-noise ratio against its definition, and the estimates of known periods."""

import numpy as np
import pytest

from workbench.motion.models.cycle_alignment import find_period, snr, snr_per_series
from workbench.utils.errors import InputError


def with_blocks_removed(series, fraction, rng):
    gappy = series.copy()
    for angle in gappy.T:
        while np.isnan(angle).mean() < fraction:
            start = rng.integers(len(angle) - 12)
            angle[start : start + rng.integers(12, 61)] = np.nan
    return gappy


def slow_ratio(samples, period):
    """Return the F ratio of a one-way analysis of variance with the phases as groups."""
    frames = np.flatnonzero(np.isfinite(samples))
    starts = np.rint(np.arange(len(samples)) * period)
    phases = frames - np.array([starts[starts <= frame].max() for frame in frames])  # samples since the cycle began
    groups = [samples[frames[phases == phase]] for phase in range(int(np.ceil(period)))]
    groups = [group for group in groups if len(group)]
    mean = samples[frames].mean()
    between = sum(len(group) * (group.mean() - mean) ** 2 for group in groups) / (len(groups) - 1)
    within = sum(((group - group.mean()) ** 2).sum() for group in groups) / (len(frames) - len(groups))
    return between / within


def stride(frames, period, rng, noise=0.02):
    """Return angles like those of a walk: left and right in opposite phase, with a strong second harmonic."""
    phase = 2 * np.pi * frames / period
    left = 0.4 * np.cos(phase) + 0.3 * np.cos(2 * phase + 1.0)
    right = 0.4 * np.cos(phase + np.pi) + 0.3 * np.cos(2 * phase + 1.0)
    trunk = 0.1 * np.cos(2 * phase + 0.3)  # repeats at every step
    return np.column_stack([left, right, trunk]) + noise * rng.standard_normal((len(frames), 3))


@pytest.mark.parametrize("gaps", [0.0, 0.3])
def test_the_ratio_is_the_f_ratio_of_its_definition(gaps):
    rng = np.random.default_rng(0)
    series = stride(np.arange(211), 61.3, rng, noise=0.2)
    if gaps:
        series = with_blocks_removed(series, gaps, rng)
    periods = [2, 30, 61, 61.3, 62.5, 100]
    expected = [[slow_ratio(angle, period) for angle in series.T] for period in periods]
    assert snr_per_series(series, periods) == pytest.approx(np.array(expected), rel=1e-9)


def test_constant_missing_and_short_series_have_no_ratio():
    series = np.random.default_rng(0).standard_normal((50, 3))
    series[:, 1] = 2.0  # constant
    series[:, 2] = np.nan
    ratios = snr_per_series(series, [20, 60])
    assert np.isfinite(ratios[0, 0])
    assert np.isnan(ratios[:, 1:]).all()
    assert np.isnan(ratios[1]).all()  # no phase of 60 samples repeats in 50
    assert np.isnan(snr(series, [60])).all()


@pytest.mark.parametrize("period", [61.0, 87.4, 130.7])
@pytest.mark.parametrize("cycles", [2.3, 6.0])
@pytest.mark.parametrize("gaps", [0.0, 0.3])
def test_the_period_of_a_stride_is_estimated(period, cycles, gaps):
    """Half of it would be a step. The error is half a sample without gaps and 2 % with 30 % missing."""
    rng = np.random.default_rng(int(period))
    series = stride(np.arange(int(cycles * period)), period, rng)
    if gaps:
        series = with_blocks_removed(series, gaps, rng)
    estimate = find_period(series, 0.4 * period, 2.5 * period)
    assert estimate == pytest.approx(period, abs=0.02 * period if gaps else 0.5)


def test_the_parabola_places_the_peak_between_samples():
    errors = [
        find_period(stride(np.arange(1500), period, np.random.default_rng(1)), 50, 160) - period
        for period in np.linspace(100.0, 101.0, 11)
    ]
    assert np.sqrt(np.mean(np.square(errors))) < np.sqrt(1 / 12)  # better than rounding to whole samples


def test_series_without_a_period_are_rejected():
    slow = np.cos(2 * np.pi * np.arange(600.0) / 200)[:, None]
    with pytest.raises(InputError, match="largest at"):
        find_period(slow, 120, 190)
    with pytest.raises(InputError, match="two periods"):
        find_period(np.zeros((90, 2)), 50, 140)
    with pytest.raises(InputError, match="too few valid"):
        find_period(np.full((300, 2), np.nan), 50, 140)
    with pytest.raises(InputError, match="2 samples"):
        snr(np.zeros((20, 1)), [1])


def test_the_published_accumulation_is_the_sum_over_the_angles():
    """One strong angle dominates the sum, but not the square of the mean root."""
    rng = np.random.default_rng(0)
    series = rng.standard_normal((300, 5))
    series[:, 0] += 20.0 * np.sin(2 * np.pi * np.arange(300) / 60)
    series[:, 4] = 1.0  # constant: no ratio
    periods = np.arange(40.0, 100.0)
    ratios = snr_per_series(series, periods)
    summed = snr(series, periods, summed=True)
    assert summed == pytest.approx(ratios[:, :4].sum(axis=1))
    assert summed.max() > 5.0 * snr(series, periods).max()
    assert np.isnan(snr(series[:50], [60.0], summed=True)).all()
