"""Which commit moved which number."""

import numpy as np
import pytest

from workbench.recording.compare.bisect import first_moved, moved_names

N_SEEDS = 8


def history(n, moved, noisy=(), seed=0):
    """The numbers of commits 0 … n on N_SEEDS seeds.

    moved: by which commit and how much. noisy: commits that shuffle.
    """
    rng = np.random.default_rng(seed)
    level = 40.0 + 10.0 * rng.standard_normal(N_SEEDS)
    numbers = []
    for commit in range(n + 1):
        if commit in noisy:
            level = level + 0.3 * rng.standard_normal(N_SEEDS)
        numbers.append({name: level + (by if commit >= at else 0.0) for name, (at, by) in moved.items()})
    return numbers


class Runner:
    """Runs commits that are numbers, and counts."""

    def __init__(self, numbers):
        self.numbers = numbers
        self.ran = []

    def __call__(self, commit):
        self.ran.append(int(commit))
        return self.numbers[int(commit)]

    def search(self):
        names = [str(k) for k in range(1, len(self.numbers))]
        return {each.name: (int(each.commit), each.exact) for each in first_moved(names, self.numbers[0], self)}


@pytest.mark.parametrize("at", [*range(1, 33)])
def test_of_32_commits_the_one_is_found_in_six_decisions(at):
    runner = Runner(history(32, {"error_abs_mm": (at, 2.0), "frames": (99, 0.0)}))
    assert runner.search() == {"error_abs_mm": (at, True)}
    assert len(set(runner.ran)) == len(runner.ran) <= 6  # the last one, which is known to be bad, included


def test_numbers_that_other_commits_moved_are_told_apart():
    runner = Runner(history(32, {"a": (3, 2.0), "b": (30, -1.0)}))
    assert runner.search() == {"a": (3, True), "b": (30, True)}
    assert len(runner.ran) <= 11


@pytest.mark.parametrize("seed", range(5))
def test_where_bits_differ_pairs_of_seeds_tell(seed):
    """Every fourth commit changes what is drawn, which moves single seeds and not their mean."""
    runner = Runner(history(32, {"error_abs_mm": (21, 4.0)}, noisy=range(2, 33, 8), seed=seed))
    assert runner.search() == {"error_abs_mm": (21, False)}
    assert len(runner.ran) <= 6


def test_rounding_moves_nothing_and_chance_moves_nothing():
    good = {"a": np.full(N_SEEDS, 3.0), "b": 40.0 + np.arange(8.0)}
    bad = {"a": good["a"] * (1.0 + 1e-12), "b": good["b"] + np.random.default_rng(0).standard_normal(8)}
    assert moved_names(good, bad) == []
    assert moved_names({"a": np.array([3.0])}, {"a": np.array([3.1])}) == ["a"]  # one seed: bits only
    assert first_moved(["1", "2"], good, lambda commit: bad) == []


def test_a_commit_without_the_number_is_after_the_one_that_took_it_away():
    numbers = [{"a": np.ones(1), "b": np.ones(1)}, {"b": np.ones(1)}, {"a": np.zeros(1), "b": np.ones(1)}]
    assert Runner(numbers).search() == {"a": (1, True)}
