"""Range, peak speed and repetitions of generated joint angles."""

import numpy as np
import pytest

from workbench.evaluation.gait.estimates import MIN_SAMPLES, bands_of, expected_extremes
from workbench.evaluation.gait.repetitions import MIN_RANGE_RAD, REPEATED, _peak, _repetitions, angle_measures
from workbench.evaluation.gait.stretches import MAX_GAP_S, evenly, rows_of_stretches


def of(times_s, angle, valid=None):
    valid = np.ones(len(times_s), bool) if valid is None else valid
    return angle_measures(times_s, angle[None, :, None], rows_of_stretches(times_s, valid))


def squats(times_s, period_s=2.0, range_rad=1.6):
    return 0.5 * range_rad * (1.0 - np.cos(2.0 * np.pi * times_s / period_s))


def test_squats_are_counted_and_timed():
    times_s = np.arange(0.0, 8.01, 1.0 / 30.0)
    measured = of(times_s, squats(times_s))
    assert measured.repetitions[0] == 4
    assert measured.seconds[0, 0] == pytest.approx(2.0, abs=0.02)
    assert measured.ranges_rad[0, 0] == pytest.approx(1.6, rel=0.01)
    assert measured.peak_speeds_rad_s[0, 0] == pytest.approx(0.8 * np.pi, rel=0.02)


def test_squats_at_a_low_rate_and_uneven_times():
    rng = np.random.default_rng(0)
    times_s = np.sort(rng.choice(np.arange(0.0, 8.01, 1.0 / 60.0), 240, replace=False))
    assert of(times_s, squats(times_s)).repetitions[0] == 4
    low_s = np.arange(0.0, 8.01, 0.1)
    measured = of(low_s, squats(low_s))
    assert measured.repetitions[0] == 4
    assert measured.peak_speeds_rad_s[0, 0] == pytest.approx(0.8 * np.pi, rel=0.05)


@pytest.mark.parametrize(("part", "n"), [(0.95, 0), (1.05, 4)])
def test_repetitions_need_a_range(part, n):
    times_s = np.arange(0.0, 8.01, 1.0 / 30.0)
    assert of(times_s, squats(times_s, range_rad=part * MIN_RANGE_RAD)).repetitions[0] == n


@pytest.mark.parametrize(("part", "n"), [(0.9, 2), (1.1, 3)])
def test_repetitions_are_large_parts_of_the_range(part, n):
    """Two full repetitions with a smaller one between them."""
    times_s = np.arange(0.0, 6.01, 1.0 / 30.0)
    angle = squats(times_s) * np.where((times_s > 2.0) & (times_s < 4.0), part * REPEATED, 1.0)
    measured = of(5.0 + times_s, angle)
    assert measured.repetitions[0] == n
    assert measured.seconds[0, 0] == pytest.approx(4.0 / (n - 1), abs=0.02)


def test_repetitions_are_inside_a_stretch():
    """The largest angle in the first or last frame is no maximum; one next to it is."""
    assert _repetitions(np.array([1.0, 0.0, 1.0, 0.6, 1.1, 0.0, 1.0]), 0.5).tolist() == [4]
    assert _repetitions(np.array([0.9, 1.0, 0.0, 1.0, 0.9]), 0.5).tolist() == [1, 3]


def test_the_largest_value_near_a_frame_is_within_reach():
    """Values that are 1 in one frame each, else 0."""
    assert _peak(np.eye(9), 5, 2).tolist() == [3, 3, 3, 3, 4, 5, 6, 7, 3]
    assert _peak(np.eye(5), 1, 2).tolist() == [0, 1, 2, 3, 0]


def test_one_repetition_has_no_time():
    times_s = np.arange(0.0, 2.01, 1.0 / 30.0)
    measured = of(times_s, squats(times_s))
    assert measured.repetitions[0] == 1
    assert np.isnan(measured.seconds[0, 0])


@pytest.mark.parametrize(("factor", "seconds"), [(1.1, 2.2), (1.2, 2.0 + 2.0 * 0.5 / 3.0)])
def test_every_sample_is_timed_within_a_quarter_of_a_repetition(factor, seconds):
    """A sample whose squats are slower, about the middle of the clip; their tops are within 0.5 s of the expected."""
    times_s = np.arange(0.0, 8.01, 1.0 / 30.0)
    angles = np.stack([squats(times_s), squats(4.0 + (times_s - 4.0) / factor)])
    measured = angle_measures(times_s, angles[..., None], rows_of_stretches(times_s, np.ones(len(times_s), bool)))
    assert measured.seconds[:, 0] == pytest.approx([2.0, seconds], abs=0.02)


def test_speeds_do_not_bridge_gaps():
    times_s = np.arange(0.0, 2.0, 1.0 / 30.0)
    angle = np.where(times_s < 1.0, 0.0, 2.0)
    assert of(times_s, angle).peak_speeds_rad_s[0, 0] > 10.0
    valid = np.abs(times_s - 1.0) > 0.2
    measured = of(times_s, angle, valid)
    assert measured.peak_speeds_rad_s[0, 0] == pytest.approx(0.0, abs=1e-9)
    assert measured.ranges_rad[0, 0] == pytest.approx(2.0)


def test_without_stretches_nothing_is_known():
    measured = of(np.array([0.0, 5.0]), np.zeros(2))
    assert np.isnan(measured.ranges_rad).all()
    assert measured.repetitions[0] == 0
    for n, speed in ((2, np.nan), (3, 3.0)):  # frames
        assert of(np.arange(n) / 10.0, 0.3 * np.arange(n)).peak_speeds_rad_s == pytest.approx(speed, nan_ok=True)


@pytest.mark.parametrize(("gap_s", "n"), [(MAX_GAP_S, 1), (MAX_GAP_S + 0.01, 2)])
def test_stretches_end_at_gaps(gap_s, n):
    times_s = np.array([0.0, 0.1, 0.1 + gap_s, 0.2 + gap_s])
    assert len(rows_of_stretches(times_s, np.ones(4, bool))) == n


def test_even_times_are_kept_and_uneven_ones_interpolated():
    rounded_s = np.round(np.arange(60) / 30.0, 3)  # as in Matroska
    assert len(evenly(rounded_s)[0]) == 60
    values = np.sin(rounded_s)[None]
    assert evenly(rounded_s, values)[1][0] is values
    uneven_s = np.delete(rounded_s, [7, 20, 21])
    even_s, (sine,) = evenly(uneven_s, np.sin(uneven_s)[None])
    assert len(even_s) in (60, 61)
    np.testing.assert_allclose(sine[0], np.sin(even_s), atol=1e-4)


def test_intervals_are_of_the_samples_about_the_estimate():
    for mean in (5.0, 7.0):  # of the samples
        values = np.concatenate([[5.0], np.random.default_rng(0).normal(mean, 2.0, 4000)])
        value, low, high = (float(each[0]) for each in bands_of(values[:, None]))
        assert value == 5.0
        assert high - 5.0 == pytest.approx(1.645 * np.hypot(2.0, mean - 5.0), rel=0.05)
        assert 5.0 - low == pytest.approx(high - 5.0)


@pytest.mark.parametrize(("n", "known"), [(MIN_SAMPLES - 1, False), (MIN_SAMPLES, True)])
def test_few_samples_have_no_interval_and_no_expected_extreme(n, known):
    values = np.append(1.0, np.arange(n, dtype=float))
    assert expected_extremes(values)[0] == (0.5 * (n - 1) if known else 1.0)
    assert np.isfinite(bands_of(values[:, None])[1][0]) == known
    assert np.isnan(bands_of(np.array([[1.0]]))[1]).all()
