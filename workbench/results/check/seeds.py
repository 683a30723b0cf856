"""Comparison of runs of several seeds: as distributions, or in pairs of equal seeds without the seeds' variance."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import scipy

from workbench.evaluation.metrics import HEADLINE_ERRORS
from workbench.evaluation.uncertainty.intervals import mean_interval
from workbench.recording.read.reader import Run
from workbench.results.check.agreement import MetricChange
from workbench.utils.arrays import FloatArray, IntArray

Groups = Sequence[tuple[Sequence[Run], Sequence[Run]]]
"""Old and new runs of one configuration, for several configurations."""
LEVEL = 0.05
"""Largest probability that unchanged code fails on any number."""
POWER = 0.95
ROUNDING = 1e-9
"""Relative difference of a number by the order of sums or another library's last bits."""


def compare_seeds(groups: Groups) -> list[list[MetricChange]]:
    """Return the changes of each group's means over new seeds, tested by `mean_interval`.

    All numbers of all groups pass together with probability 1 − LEVEL (Bonferroni). A number that is missing from any
    run, or is not finite, fails.
    """
    n_tests = sum(len(was[0].result) for was, _ in groups)
    level = 1.0 - LEVEL / max(n_tests, 1)
    return [[_of_seeds(name, was, now, level) for name in _names(was)] for was, now in groups]


def _of_seeds(name: str, was: Sequence[Run], now: Sequence[Run], level: float) -> MetricChange:
    values = _values(name, was, now)
    if isinstance(values, MetricChange):
        return values
    old, new = float(values[0].mean()), float(values[1].mean())
    allowed = mean_interval(*values, level)
    passed = abs(new - old) <= allowed
    detail = "" if passed else f"means of {len(was)} and {len(now)} seeds differ too much"
    return MetricChange(name, old, new, f"± {allowed:.3g}", passed, detail)


def compare_paired(groups: Groups) -> list[list[MetricChange]]:
    """Return the changes of each group, tested by differences between n ≥ 2 pairs of equal seeds, and by frame errors.

    Unchanged code fails on any number of any group with a probability of at most LEVEL (Holm's correction, see `holm`).
    A number that is missing from any run, or is not finite, fails.
    """
    n_tests = sum(len(_names(was)) + len(_over_frames(was, now)) for was, now in groups)
    tests = [list(_paired_tests(was, now, LEVEL / max(n_tests, 1))) for was, now in groups]
    rejected = iter(holm(np.array([p for group in tests for p, _ in group]), LEVEL))
    return [[replace(change, passed=not next(rejected)) for _, change in group] for group in tests]


def holm(p: FloatArray, level: float) -> IntArray:
    """Return the rejected ones (m,) of m hypotheses with p-values p, at a family-wise error rate of `level`.

    In order, p₍₁₎ ≤ p₍₂₎ …, they are rejected as long as p₍ₖ₎ ≤ level / (m − k + 1), for any dependence
    (Holm, A simple sequentially rejective multiple test procedure, Scandinavian Journal of Statistics 6, 1979).
    """
    order = np.argsort(p, kind="stable")
    rejected = np.empty(len(p), dtype=bool)
    rejected[order] = np.logical_and.accumulate(p[order] <= level / np.arange(len(p), 0, -1))
    return rejected


def differences(was: FloatArray, now: FloatArray) -> FloatArray:
    """Return the differences of pairs, 0 within rounding."""
    was, now = np.asarray(was, dtype=np.float64), np.asarray(now, dtype=np.float64)
    return np.where(np.abs(now - was) <= ROUNDING * np.abs(was), 0.0, now - was)


def p_of_mean(d: FloatArray) -> float:
    """Return the p-value of the mean of n ≥ 2 differences by Student's paired t test.

    For integer differences, such as of counts, which are often equal by chance, it is that of the permutation test over
    exchanges of old and new within pairs.
    """
    if not d.any():
        return 1.0
    if (d != np.round(d)).any():
        return float(scipy.stats.ttest_1samp(d, 0.0).pvalue) if np.ptp(d) > 0.0 else 0.0
    test = scipy.stats.permutation_test(
        (d, np.zeros(len(d))), lambda x, y, axis: np.mean(x - y, axis=axis), permutation_type="samples",
        vectorized=True, random_state=np.random.default_rng(0),
    )  # fmt: skip
    return float(test.pvalue)


def paired_interval(d: FloatArray, level: float) -> tuple[float, float]:
    """Return the half-width of Student's 95 % interval of the mean of n ≥ 2 differences, and the smallest detectable
    change.

        h = t(0.975; n − 1) s/√n,   smallest change = (t(1 − level/2; n − 1) + t(POWER; n − 1)) s/√n

    level: of the test, such as LEVEL / m for m numbers. The second is approximated by the central t distribution.
    """
    half, reach, power = (float(scipy.stats.t.ppf(q, len(d) - 1)) for q in (0.975, 1.0 - level / 2.0, POWER))
    error = float(scipy.stats.sem(d))
    return half * error, (reach + power) * error


def energy_test(was: Sequence[FloatArray], now: Sequence[FloatArray], rng: np.random.Generator) -> tuple[float, float]:
    """Return the energy distance between all values before and all after, and its p-value under exchanges of pairs.

    was, now: n arrays each of values in single frames. These are dependent within a run, so whole runs are exchanged
    within pairs: in all 2ⁿ ways for n ≤ 13, else in 9999 random ones. The test is exact for any distribution (Székely &
    Rizzo, Energy statistics, 2013).
    """
    runs, n = [*was, *now], len(was)

    def distance(first: IntArray, second: IntArray) -> float:
        values = (np.concatenate([runs[int(k)] for k in indices]) for indices in (first, second))
        return float(scipy.stats.energy_distance(*values))

    test = scipy.stats.permutation_test(
        (np.arange(n), np.arange(n, 2 * n)), distance, permutation_type="samples", alternative="greater",
        random_state=rng,
    )  # fmt: skip
    return float(test.statistic), float(test.pvalue)


def _names(runs: Sequence[Run]) -> list[str]:
    return sorted({name for run in runs for name in run.result})


def _over_frames(was: Sequence[Run], now: Sequence[Run]) -> list[str]:
    """Return the errors whose values in single frames are also compared as distributions."""
    return [name for name in HEADLINE_ERRORS if all(name in run.metrics for run in (*was, *now))]


def _values(name: str, was: Sequence[Run], now: Sequence[Run]) -> tuple[FloatArray, FloatArray] | MetricChange:
    """Return a number's old and new values, or its failure."""
    if n_missing := sum(name not in run.result for run in (*was, *now)):
        detail = f"missing from {n_missing} of {len(was) + len(now)} runs"
        return MetricChange(name, None, None, "", False, detail)
    before, after = (np.array([run.result[name] for run in runs], dtype=np.float64) for runs in (was, now))
    if not (np.isfinite(before).all() and np.isfinite(after).all()):
        return MetricChange(
            name, float(before.mean()), float(after.mean()), "", False, "not a finite number in every run"
        )
    return before, after


def _paired_tests(was: Sequence[Run], now: Sequence[Run], level: float) -> Iterator[tuple[float, MetricChange]]:
    """Yield p-values and changes of each number, and of each metric in single frames."""
    allowed = f"{100.0 * LEVEL:g} % of all"
    for name in _names(was):
        values = _values(name, was, now)
        if isinstance(values, MetricChange):
            yield 0.0, values
            continue
        d = differences(*values)
        p, (half, smallest) = p_of_mean(d), paired_interval(d, level)
        detail = f"by {d.mean():+.3g} ± {half:.2g}, p = {p:.2g}; {smallest:.2g} is detectable"
        yield p, MetricChange(name, float(values[0].mean()), float(values[1].mean()), allowed, True, detail)
    for name in _over_frames(was, now):
        before = [run.metric(name)[1][1:] for run in was]  # the first pose is given
        after = [a + differences(a, run.metric(name)[1][1:]) for a, run in zip(before, now, strict=True)]
        distance, p = energy_test(before, after, np.random.default_rng(0))
        detail = f"energy distance {distance:.3g}, p = {p:.2g}"
        if 2.0 / 2 ** len(was) > level:
            detail += f"; {len(was)} pairs cannot show a change, {int(np.ceil(np.log2(2.0 / level)))} could"
        yield p, MetricChange(f"{name} in frames", None, None, allowed, True, detail)
