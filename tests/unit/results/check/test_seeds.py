"""Paired checks: unchanged code seldom fails, a change that is said to be found is found."""

import numpy as np
import pytest
from recording_steps import BODY, SPACE, errors, steps
from scipy import stats

from workbench.recording.read.reader import read
from workbench.recording.write.recorder import Recorder
from workbench.results.check.seeds import compare_paired, differences, energy_test, holm, p_of_mean, paired_interval


def share(check, n=1000):
    """In which share of n cases a check fails."""
    rng = np.random.default_rng(0)
    return np.mean([check(rng) for _ in range(n)])


@pytest.mark.parametrize("n", [2, 8])
@pytest.mark.slow
def test_an_unchanged_mean_fails_as_often_as_its_level(n):
    assert share(lambda rng: p_of_mean(rng.standard_normal(n)) <= 0.05, 4000) == pytest.approx(
        0.05, abs=3.0 * np.sqrt(0.05 * 0.95 / 4000)
    )


@pytest.mark.parametrize("n", [3, 8, 11])
@pytest.mark.slow
def test_an_unchanged_count_fails_at_most_as_often(n):
    """Of which a few differences are often equal, so that Student's test would call them sure."""
    assert share(lambda rng: p_of_mean(rng.choice([-1.0, 0.0, 0.0, 1.0], n)) <= 0.05, 400) <= 0.05 + 3.0 * 0.011


def test_rounding_is_no_difference():
    was = np.array([1.0, 40.0, 0.0])
    np.testing.assert_array_equal(differences(was, was * (1.0 + 1e-12)), 0.0)
    assert differences(was, was + 1e-6).all()
    assert p_of_mean(np.zeros(4)) == 1.0
    assert p_of_mean(np.full(4, 0.02)) == 0.0


def test_holms_correction_refuses_more_than_bonferronis_and_no_more_than_it_may():
    assert holm(np.array([0.04, 0.012, 0.3, 0.016]), 0.05).tolist() == [False, True, False, True]
    assert holm(np.array([0.02, 0.02]), 0.05).tolist() == [True, True]

    def wrong(rng):  # a third is true, and numbers hang together
        z = 0.8 * rng.standard_normal() + 0.6 * rng.standard_normal(30)
        z[:20] += 5.0
        return holm(2.0 * stats.norm.sf(np.abs(z)), 0.05)[20:].any()

    assert share(wrong, 2000) <= 0.05 + 3.0 * np.sqrt(0.05 * 0.95 / 2000)


@pytest.mark.parametrize("n", [6, 16])
@pytest.mark.slow
def test_the_smallest_change_is_found_as_often_as_is_said(n):
    """Of the true spread, which an interval knows in the mean only."""
    spread = np.sqrt(n / (n - 1))
    _, smallest = paired_interval(np.tile([-1.0, 1.0], n // 2), 0.01)

    def found(rng):
        return p_of_mean(smallest + spread * rng.standard_normal(n)) <= 0.01

    assert 0.90 < share(found, 1500) < 0.99


@pytest.mark.slow
def test_a_null_of_frames_that_hang_together_fails_as_often_as_its_level():
    def fails(rng):
        runs = [
            rng.normal(2.0 * rng.standard_normal(), 1.0, (2, 12)) + 0.5 * rng.standard_normal((2, 1)) for _ in range(5)
        ]
        return energy_test([run[0] for run in runs], [run[1] for run in runs], rng)[1] <= 2.0 / 2**5

    assert share(fails, 400) == pytest.approx(2.0 / 2**5, abs=3.0 * np.sqrt(0.0625 * 0.9375 / 400))


def test_frames_that_spread_more_are_found_though_their_mean_is_the_same():
    rng = np.random.default_rng(1)
    before = [rng.normal(30.0, 1.0, 60) for _ in range(8)]
    after = [rng.normal(30.0, 3.0, 60) for _ in range(8)]
    assert energy_test(before, after, rng)[1] == 2.0 / 2**8
    many = [rng.normal(30.0, scale, 20) for scale in (1.0, 3.0) for _ in range(12)]
    assert energy_test(many[:12], many[12:], rng)[1] < 0.01


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder, run = tmp_path_factory.mktemp("paired"), list(steps(6, n_particles=20))

    def make(name, error):
        with Recorder(folder / f"{name}.rrd", BODY, SPACE, run_id=name, config_yaml="", provenance={}) as recording:
            for step in run:
                recording.log(step, {**errors(step), "mpjpe_abs_mm": error})
            recording.set_result({"mpjpe_abs_mm": error, "n_frames": 6.0})
        return read(folder / f"{name}.rrd")

    return make


def test_equal_runs_pass_and_moved_ones_fail_with_what_would_have_been_found(made):
    was = [made(f"was{k}", 40.0 + 10.0 * k) for k in range(4)]
    (same,) = compare_paired([(was, was)])
    assert {finding.quantity for finding in same} == {"mpjpe_abs_mm", "n_frames", "mpjpe_abs_mm in frames"}
    assert all(finding.passed for finding in same)
    now = [made(f"now{k}", 40.0 + 10.0 * k + 1.0 + 0.01 * k) for k in range(4)]
    found = {finding.quantity: finding for finding in compare_paired([(was, now)])[0]}
    assert not found["mpjpe_abs_mm"].passed  # by 1 mm, a tenth of what seeds differ by
    assert "by +1.02 ±" in found["mpjpe_abs_mm"].detail
    assert found["n_frames"].passed
    assert "4 pairs cannot show a change" in found["mpjpe_abs_mm in frames"].detail


def test_a_number_that_is_gone_or_not_finite_fails(made):
    was, now = [made(f"a{k}", 40.0 + k) for k in range(2)], [made("b0", float("nan")), made("b1", 41.0)]
    found = {finding.quantity: finding for finding in compare_paired([(was, now)])[0]}
    assert found["mpjpe_abs_mm"].detail == "not a finite number in every run"
