"""Slices, functional PCA with gaps, and imputation, against known cycles and an SVD."""

import numpy as np
import pytest
from scipy.interpolate import KroghInterpolator

from workbench.motion.models.cycle_alignment import CycleAlignment
from workbench.motion.models.functional_pca import (
    N_FOURIER,
    Slices,
    cut,
    fill_linear,
    fourier_basis,
    fpca_paper,
    fpca_shrunk,
)
from workbench.motion.models.imputation import fill_smooth, impute, impute_linear, impute_paper, impute_periodic
from workbench.utils.errors import InputError

T, M = 48, 4


def curves(n_curves, rng):
    """Return a function of phases (F,) that gives n_curves smooth periodic curves (n_curves, F, M)."""
    waves = rng.normal(size=(n_curves, 3, M)) + 1j * rng.normal(size=(n_curves, 3, M))
    return lambda phase: np.einsum("fo,kom->kfm", np.exp(2j * np.pi * phase[:, None] * [1, 2, 3]), waves).real


def known_slices(n=40, rank=2, gaps=0.0, noise=0.0, seed=0):
    """Return X = μ + c V and its slices, two per sequence, with entries missing at random."""
    rng = np.random.default_rng(seed)
    mean, *components = curves(1 + rank, rng)(np.arange(T) / T)
    amounts = rng.normal(size=(n, rank)) * (0.4 / np.arange(1, rank + 1))
    truth = mean + np.einsum("nk,ktm->ntm", amounts, np.array(components)) + noise * rng.normal(size=(n, T, M))
    observed = rng.random(truth.shape) >= gaps
    guess = np.where(observed, truth, 0.0).sum(axis=0) / observed.sum(axis=0)
    order = np.arange(n)
    return truth, Slices(np.where(observed, truth, guess), observed, order // 2, order % 2)


def test_the_fourier_functions_are_orthonormal():
    for n_phases in (21, 64):
        basis = fourier_basis(np.arange(n_phases) / n_phases, n_phases)
        assert basis.shape == (n_phases, N_FOURIER)
        assert basis.T @ basis == pytest.approx(np.eye(N_FOURIER), abs=1e-12)


@pytest.mark.parametrize("n", [40, 200])  # fewer and more slices than Fourier coefficients
@pytest.mark.parametrize("method", [fpca_paper, fpca_shrunk])
def test_without_gaps_the_result_is_the_pca_of_the_slices(method, n):
    truth, slices = known_slices(n, rank=3)
    pca = method(slices, 3)
    _, singular, rows = np.linalg.svd((truth - truth.mean(axis=0)).reshape(len(truth), -1), full_matrices=False)
    assert pca.mean == pytest.approx(truth.mean(axis=0), abs=1e-9)
    assert pca.scales == pytest.approx(singular[:3] / np.sqrt(len(truth) - 1), rel=1e-9)
    assert np.abs(pca.components.reshape(3, -1) @ rows[:3].T) == pytest.approx(np.eye(3), abs=1e-6)
    assert pca.explained == pytest.approx(1.0, abs=1e-9)
    assert (pca.completed == truth).all()
    assert len(pca.errors) == 1  # one pass, as no entry is missing


def test_missing_entries_of_a_low_rank_are_recovered():
    truth, slices = known_slices(gaps=0.2)
    pca = fpca_paper(slices, 2, tolerance=1e-9)
    missing = ~slices.observed
    before = np.sqrt(np.mean((slices.values - truth)[missing] ** 2))
    after = np.sqrt(np.mean((pca.completed - truth)[missing] ** 2))
    assert after < 1e-4 * before  # per cycle 5 unknowns and 153 observed numbers
    assert (pca.completed[slices.observed] == truth[slices.observed]).all()


def test_the_fixed_point_satisfies_the_papers_steps():
    """At the fixed point, steps 3–7 by an SVD of the discrete Fourier transform change nothing."""
    _, slices = known_slices(gaps=0.3, noise=0.1)
    pca = fpca_paper(slices, 2, tolerance=1e-12)
    mean = pca.completed.mean(axis=0)
    spectrum = np.fft.rfft(pca.completed - mean, axis=1)
    spectrum[:, 11:] = 0.0  # ten orders …
    spectrum[:, 10] = spectrum[:, 10].real  # … the last without its sine: 20 coefficients
    smooth = np.fft.irfft(spectrum, n=T, axis=1)
    u, s, vt = np.linalg.svd(smooth.reshape(len(smooth), -1), full_matrices=False)
    x4 = ((u[:, :2] * s[:2]) @ vt[:2]).reshape(smooth.shape) + mean
    missing = ~slices.observed
    assert pca.completed[missing] == pytest.approx(x4[missing], abs=1e-4)


@pytest.mark.parametrize("method", [fpca_paper, fpca_shrunk])
def test_value_and_two_derivatives_match_at_the_ends(method):
    """The slices do not close. Derivatives at each end are of the polynomial through its ten nearest samples."""
    n_phases = 256
    _, slices = known_slices(gaps=0.2, noise=0.05)
    ramp = 0.5 * (np.arange(T) / T)[:, None]
    open_slices = Slices(slices.values + ramp, slices.observed, slices.sequence, slices.cycle)
    pca = method(open_slices, 2)
    at = fourier_basis(np.arange(T) / T, T).T
    fine = fourier_basis(np.arange(n_phases) / n_phases, T)
    for curve in (pca.mean, *pca.components):
        samples = fine @ (at @ curve)
        assert samples[:: n_phases // 16] == pytest.approx(curve[:: T // 16], abs=1e-9)  # equals its Fourier series
        step = 1.0 / n_phases
        left = KroghInterpolator(np.arange(10) * step, samples[:10]).derivatives(0.0, 3)
        right = KroghInterpolator(1.0 + np.arange(-10, 0) * step, samples[-10:]).derivatives(1.0, 3)
        size = np.abs(curve).max() * (2 * np.pi * 10) ** np.arange(3)[:, None]  # of order-10 waves and their slopes
        assert np.abs(left - right) == pytest.approx(0.0 * left, abs=2e-3 * size.max(axis=1).max())
        assert (np.abs(left - right) <= 2e-3 * size).all()
    assert np.abs(ramp[-1] - ramp[0]).max() > 0.4  # means of the slices would have this gap


def test_too_few_slices_and_unobserved_phases_are_rejected():
    _, slices = known_slices(n=4)
    with pytest.raises(InputError, match="allow 1 to 3 components, found 4"):
        fpca_paper(slices, 4)
    series = np.random.default_rng(0).normal(size=(100, 2))
    series[10:40, 1] = series[60:90, 1] = np.nan
    with pytest.raises(InputError, match="angle 1 is never observed"):
        cut([series], alignment([50.0], [0.0]))


def alignment(periods, offsets):
    return CycleAlignment(np.array(periods), np.array(offsets), np.zeros((1, 1)), np.zeros(1))


def known_sequences(gaps=0.0, seed=0, n=10, noise=0.0):
    """Return sequences of 3 to 4 cycles that differ by a score and a level, also with gaps, and their alignment."""
    rng = np.random.default_rng(seed)
    curve = curves(2, rng)
    truths, gappy, periods, offsets = [], [], rng.uniform(80.0, 120.0, n), rng.random(n)
    for period, offset in zip(periods, offsets, strict=True):
        phase = np.arange(int(period * rng.uniform(3.0, 4.0))) / period + offset
        mean, component = curve(phase)
        truth = mean + 0.3 * rng.normal() * component + 0.3 * rng.normal(size=M) + noise * rng.normal(size=mean.shape)
        series = truth.copy()
        for angle in series.T:
            while np.isnan(angle).mean() < gaps:
                start = rng.integers(len(angle) - 12)
                angle[start : start + rng.integers(10, 41)] = np.nan
        truths.append(truth)
        gappy.append(series)
    return truths, gappy, alignment(periods, offsets)


def test_slices_are_at_the_phases_of_the_alignment():
    truths, _, aligned = known_sequences()
    slices = cut(truths, aligned, n_phases=T)
    for i, truth in enumerate(truths):
        for row in np.flatnonzero(slices.sequence == i):
            frames = (slices.cycle[row] + np.arange(T) / T - aligned.offsets[i]) * aligned.periods[i]
            inside = (frames >= 0) & (frames <= len(truth) - 1)
            assert (slices.observed[row] == inside[:, None]).all()
            nearest = np.rint(frames[inside]).astype(int)
            steepest = 0.5 * np.abs(np.diff(truth, axis=0)).max()  # at most half a frame
            assert np.abs(slices.values[row][inside] - truth[nearest]).max() <= 1.1 * steepest
    assert slices.observed.mean() == pytest.approx(
        sum(len(t) / p for t, p in zip(truths, aligned.periods, strict=True)) / len(slices.values), abs=0.01
    )


def test_every_method_fills_the_gaps_alone():
    truths, gappy, aligned = known_sequences(gaps=0.2, noise=0.05)
    missing = [np.isnan(series) for series in gappy]
    errors = {}
    for method in (impute, impute_paper, impute_periodic):
        filled = method(gappy, aligned)
        for series, imputed, gap in zip(gappy, filled, missing, strict=True):
            assert np.isfinite(imputed).all()
            assert (imputed[~gap] == series[~gap]).all()
        errors[method] = np.sqrt(
            np.mean(np.concatenate([(f - t)[g] for f, t, g in zip(filled, truths, missing, strict=True)]) ** 2)
        )
    linear = np.concatenate([(f - t)[g] for f, t, g in zip(impute_linear(gappy), truths, missing, strict=True)])
    assert all(error < 0.3 * np.sqrt(np.mean(linear**2)) for error in errors.values())
    assert errors[impute] < errors[impute_paper]  # whose model of rank 5 has no levels of sequences


def test_gaps_are_interpolated_and_ends_are_constant():
    line = np.arange(10.0)[:, None] * [1.0, -2.0]
    gappy = line.copy()
    gappy[3:6, 0] = np.nan
    gappy[:2, 1] = np.nan
    expected = line.copy()
    expected[:2, 1] = -4.0  # constant beyond the ends
    assert fill_linear(gappy) == pytest.approx(expected)
    assert fill_smooth(gappy) == pytest.approx(expected)
    all_missing = np.full((5, 1), np.nan)
    assert (fill_linear(all_missing) == 0.0).all()
    assert (fill_smooth(all_missing) == 0.0).all()
