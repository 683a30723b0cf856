"""A test that may be looked at after every pair."""

import numpy as np
import pytest

from workbench.recording.compare.until import Verdict, confidence, decide, evidence, p_values

N_LOOKS = 60
DRAWS = {
    "normal": lambda rng, n: rng.standard_normal(n),
    "heavy tails": lambda rng, n: rng.standard_cauchy(n),
    "mostly equal bits": lambda rng, n: rng.standard_normal(n) * (rng.random(n) < 0.2),
    "counts": lambda rng, n: rng.choice([-1.0, 0.0, 1.0], n),
    "spread that grows": lambda rng, n: rng.standard_normal(n) * np.arange(1, n + 1),
}


def share(check, n):
    rng = np.random.default_rng(0)
    return np.mean([check(rng) for _ in range(n)])


@pytest.mark.parametrize("name", DRAWS)
def test_unchanged_code_is_seldom_called_changed_however_often_one_looks(name):
    """`evidence` is that of the best look so far."""
    assert share(lambda rng: evidence(DRAWS[name](rng, N_LOOKS)) >= 20.0, 1000) <= 0.05 + 3 * np.sqrt(
        0.05 * 0.95 / 1000
    )


@pytest.mark.parametrize("offset", [1.0, 1.5])
def test_a_change_beyond_the_limit_is_seldom_called_unchanged(offset):
    def wrong(rng):
        looks = offset + rng.standard_normal(N_LOOKS)
        return min(evidence(looks, -1.0, 1), evidence(looks, 1.0, -1)) >= 20.0

    assert share(wrong, 400) <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / 400)


def test_what_is_there_is_found():
    assert share(lambda rng: decide(2.0 + rng.standard_normal(14), 0.1, 0.05) is Verdict.CHANGED, 200) > 0.95
    assert share(lambda rng: decide(0.2 * rng.standard_normal(14), 1.0, 0.05) is Verdict.UNCHANGED, 200) > 0.95
    assert decide(np.zeros(4), 1.0, 0.05) is Verdict.OPEN
    assert decide(np.zeros(8), 1.0, 0.05) is Verdict.UNCHANGED
    assert decide(np.full(8, 0.01), 1.0, 0.05) is Verdict.CHANGED  # by as much in every pair, if only by a little


def test_pairs_that_do_not_differ_tell_nothing():
    assert evidence(np.zeros(5)) == 1.0
    assert confidence(np.zeros(5)) == (0.0, 0.0)
    np.testing.assert_array_equal(p_values([np.zeros(5), np.ones(30)])[0], 1.0)


def test_the_interval_holds_the_centre_at_the_last_look():
    def misses(rng):
        low, high = confidence(3.0 + rng.standard_normal(20))
        return not low <= 3.0 <= high

    assert share(misses, 60) <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / 60)
    low, high = confidence(3.0 + np.random.default_rng(0).standard_normal(200))
    assert high - low < 1.0
