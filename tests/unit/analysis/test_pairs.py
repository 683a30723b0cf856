"""The table of what pairs can tell."""

import numpy as np
import pytest
from scipy import stats

from analysis.figures import pairs
from analysis.figures.kept_runs import every_run
from analysis.figures.pairs import NUMBERS, ROWS, false_alarms, pairs_needed, seeds_needed, table


def test_as_many_pairs_find_the_change_as_is_said():
    rng = np.random.default_rng(0)
    d = 1.0 + 2.0 * np.linspace(-1.0, 1.0, 9) / np.linspace(-1.0, 1.0, 9).std(ddof=1)
    n = pairs_needed(d, 0.01)
    drawn = stats.ttest_1samp(1.0 + 2.0 * rng.standard_normal((4000, n)), 0.0, axis=1).pvalue
    assert np.mean(drawn <= 0.01) == pytest.approx(0.95, abs=0.015)
    was = 40.0 + 2.0 * np.linspace(-1.0, 1.0, 9) / np.linspace(-1.0, 1.0, 9).std(ddof=1)
    n = seeds_needed(was, 1.0, 0.01)
    before, after = 2.0 * rng.standard_normal((2, 4000, n))
    assert np.mean(stats.ttest_ind(before, 1.0 + after, axis=1).pvalue <= 0.01) == pytest.approx(0.95, abs=0.015)


def test_false_alarms_are_counted(monkeypatch):
    rng = np.random.default_rng(0)
    monkeypatch.setattr(pairs, "N_CHECKS", 200)
    was = {name: rng.standard_normal(16) for name in "abcde"}
    assert false_alarms(was, {name: x + 0.1 * rng.standard_normal(16) for name, x in was.items()}, rng) <= 0.1
    assert false_alarms(was, was, rng) == 0.0


def test_the_table_has_a_row_for_every_number(monkeypatch):
    monkeypatch.setattr(pairs, "N_CHECKS", 2)
    rng = np.random.default_rng(0)
    runs = every_run({row: ("walk_straight", own) for row, own in ROWS.items()}, ["builtin"], 8, [])
    seeds = 40.0 + 10.0 * rng.standard_normal((8, len(NUMBERS)))
    moved = {"as it is": 0.0, "last bit": 1e-14, "0.1 %": 1.0}
    found = {run: dict(zip(NUMBERS, seeds[run.seed] + moved[run.row] * rng.standard_normal(len(NUMBERS)), strict=True))
             for run in runs}  # fmt: skip
    lines = table(found).splitlines()
    assert len(lines) == 2 + 2 * 3
    cells = [int(line.split(" | ")[5]) for line in lines[2:]]
    assert cells[0] < cells[3]  # what draws anew wants more pairs
