"""What must not matter to the period, to the alignment and to what is imputed."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from workbench.motion.models.cycle_alignment import N_PHASES, align, find_period, snr_per_series
from workbench.motion.models.imputation import impute

M = 3


def sequence(period, shift, rng, n=260):
    phase = 2 * np.pi * (np.arange(n) / period + shift)
    waves = np.column_stack([np.cos(phase), np.sin(phase) + 0.4 * np.cos(2 * phase), np.cos(phase + 2.0)])
    series = waves + 0.1 * rng.standard_normal((n, M))
    for angle in series.T:
        start = rng.integers(n - 30)
        angle[start : start + 30] = np.nan
    return series


seeds = st.integers(0, 2**32 - 1)
periods = st.floats(60.0, 110.0)
units = st.tuples(*[st.floats(0.01, 100.0)] * M)
levels = st.tuples(*[st.floats(-50.0, 50.0)] * M)


@settings(max_examples=20, deadline=None)
@given(seeds, periods, units, levels)
def test_units_and_levels_do_not_matter_to_the_period(seed, period, scale, level):
    series = sequence(period, 0.2, np.random.default_rng(seed))
    other = series * scale + level
    ratios, again = (snr_per_series(s, [50.0, period, 120.0]) for s in (series, other))
    np.testing.assert_allclose(again, ratios, rtol=1e-6)
    assert abs(find_period(other, 50, 125) - find_period(series, 50, 125)) < 1e-3


@settings(max_examples=20, deadline=None)
@given(seeds, st.lists(st.integers(0, N_PHASES - 1), min_size=3, max_size=3))
def test_shifting_the_sequences_shifts_their_offsets(seed, steps):
    """With a sample on every other phase of the grid, a shift of the samples is a shift of the offset."""
    rng = np.random.default_rng(seed)
    plain = [sequence(128.0, 0.3 * i, rng, n=384) for i in range(3)]
    rolled = [np.roll(series, -step, axis=0) for series, step in zip(plain, steps, strict=True)]
    before, after = (align(sequences, [128.0] * 3).offsets for sequences in (plain, rolled))
    moved = after - before - np.array(steps) / 128.0
    # relative to one another; the two runs may end in references that differ by a whole turn and a step
    assert np.abs((moved - moved[0] + 0.5) % 1.0 - 0.5).max() <= 2.0 / N_PHASES


@settings(max_examples=10, deadline=None)
@given(seeds, st.permutations(range(4)))
def test_the_order_of_the_sequences_does_not_matter_to_what_is_imputed(seed, order):
    rng = np.random.default_rng(seed)
    sequences = [sequence(80.0, 0.0, rng) for _ in range(4)]
    aligned = align(sequences, [80.0] * 4)
    moved = list(order)
    shuffled = replace(aligned, periods=aligned.periods[moved], offsets=aligned.offsets[moved])
    straight, again = impute(sequences, aligned), impute([sequences[i] for i in order], shuffled)
    for place, i in enumerate(order):  # to the tolerance at which the iteration ends
        np.testing.assert_allclose(again[place], straight[i], atol=1e-4)
