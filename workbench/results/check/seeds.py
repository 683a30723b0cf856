"""Runs of several seeds compared: as distributions, or pair by pair of equal seeds, without the spread of the seeds."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import scipy

from workbench.evaluation.intervals import mean_interval
from workbench.recording.read.reader import Run
from workbench.results.check.agreement import MetricChange
from workbench.utils.arrays import FloatArray, IntArray

Groups = Sequence[tuple[Sequence[Run], Sequence[Run]]]
"""Runs of one configuration before and after, for each of several configurations."""
LEVEL = 0.05
"""How often, at most, unchanged code fails on any number at all."""
POWER = 0.95
ROUNDING = 1e-9
"""Part of a number by which it may differ through the order of sums or another library's last bits."""
_DISTRIBUTIONS = ("mpjpe_abs_mm", "mpjpe_mm", "mpjpe_px")
"""Metrics whose values in single frames are compared as distributions, too."""


def compare_seeds(groups: Groups) -> list[list[MetricChange]]:
    """Compare the mean of each number over new seeds with what its mean over the old ones lets one expect.

    See `mean_interval`; all numbers of all groups pass together in 1 − LEVEL of cases (Bonferroni). A number that is
    missing from any run, or is not finite, fails. Returns the changes of each group.
    """
    n_judged = sum(len(was[0].result) for was, _ in groups)
    level = 1.0 - LEVEL / max(n_judged, 1)
    return [[_of_seeds(name, was, now, level) for name in _names(was)] for was, now in groups]


def _of_seeds(name: str, was: Sequence[Run], now: Sequence[Run], level: float) -> MetricChange:
    values = _values(name, was, now)
    if isinstance(values, MetricChange):
        return values
    old, new = float(values[0].mean()), float(values[1].mean())
    allowed = mean_interval(*values, level)
    passed = abs(new - old) <= allowed
    detail = "" if passed else f"means of {len(was)} and {len(now)} seeds lie too far apart"
    return MetricChange(name, old, new, f"± {allowed:.3g}", passed, detail)


def compare_paired(groups: Groups) -> list[list[MetricChange]]:
    """Judge every number by its differences between runs of equal seeds, n ≥ 2 pairs, and the errors of single frames.

    Unchanged code fails on any number of any group in at most LEVEL of cases (Holm's correction, see `holm`). A number
    that is missing from any run, or is not finite, fails. Returns the changes of each group.
    """
    n_judged = sum(len(_names(was)) + len(_over_frames(was, now)) for was, now in groups)
    judged = [list(_judged(was, now, LEVEL / max(n_judged, 1))) for was, now in groups]
    refused = iter(holm(np.array([p for group in judged for p, _ in group]), LEVEL))
    return [[replace(change, passed=not next(refused)) for _, change in group] for group in judged]


def holm(p: FloatArray, level: float) -> IntArray:
    """Return which of m hypotheses (m,) to reject by their p-values, true ones in at most `level` of all cases.

    In order, p₍₁₎ ≤ p₍₂₎ …, they are rejected as long as p₍ₖ₎ ≤ level / (m − k + 1), however they depend on each other
    (Holm, A simple sequentially rejective multiple test procedure, Scandinavian Journal of Statistics 6, 1979).
    """
    order = np.argsort(p, kind="stable")
    rejected = np.empty(len(p), dtype=bool)
    rejected[order] = np.logical_and.accumulate(p[order] <= level / np.arange(len(p), 0, -1))
    return rejected


def differences(was: FloatArray, now: FloatArray) -> FloatArray:
    """Return the differences of pairs, 0 where they are no more than rounding."""
    was, now = np.asarray(was, dtype=np.float64), np.asarray(now, dtype=np.float64)
    return np.where(np.abs(now - was) <= ROUNDING * np.abs(was), 0.0, now - was)


def p_of_mean(d: FloatArray) -> float:
    """Return the probability of so large a mean of n ≥ 2 differences where nothing changed: Student's paired t test.

    Where all differences are whole numbers, as of counts, of which a few are often equal by chance: the share of all
    exchanges of old and new, pair by pair, that make the mean as large.
    """
    if not d.any():
        return 1.0
    if (d != np.round(d)).any():
        return float(scipy.stats.ttest_1samp(d, 0.0).pvalue) if np.ptp(d) > 0.0 else 0.0
    test = scipy.stats.permutation_test(
        (d, np.zeros(len(d))), lambda x, y: np.mean(x - y), permutation_type="samples",
        random_state=np.random.default_rng(0),
    )  # fmt: skip
    return float(test.pvalue)


def paired_interval(d: FloatArray, level: float) -> tuple[float, float]:
    """Return the half-width of Student's 95 % interval of the mean of n ≥ 2 differences, and the smallest change found.

        h = t(0.975; n − 1) s/√n,   smallest change = (t(1 − level/2; n − 1) + t(POWER; n − 1)) s/√n

    level: of the test, such as LEVEL / m for m numbers. The second is the usual approximation to the power of the
    two-sided test by the central t distribution.
    """
    half, reach, power = (float(scipy.stats.t.ppf(q, len(d) - 1)) for q in (0.975, 1.0 - level / 2.0, POWER))
    error = float(scipy.stats.sem(d))
    return half * error, (reach + power) * error


def energy_test(was: Sequence[FloatArray], now: Sequence[FloatArray], rng: np.random.Generator) -> tuple[float, float]:
    """Return the energy distance between all values before and all after, and its p-value under exchanges of pairs.

    was, now: n arrays each of values in single frames, which depend on each other within a run; so whole runs are
    exchanged within their pairs: in all 2ⁿ ways for n ≤ 13, else in 9999 drawn ones. Unchanged code gives a p-value of
    at most p in a share p of cases, whatever the distribution (Székely & Rizzo, Energy statistics, 2013).
    """
    runs, n = [*was, *now], len(was)

    def distance(first: IntArray, second: IntArray) -> float:
        values = (np.concatenate([runs[int(k)] for k in chosen]) for chosen in (first, second))
        return float(scipy.stats.energy_distance(*values))

    test = scipy.stats.permutation_test(
        (np.arange(n), np.arange(n, 2 * n)), distance, permutation_type="samples", alternative="greater",
        random_state=rng,
    )  # fmt: skip
    return float(test.statistic), float(test.pvalue)


def _names(runs: Sequence[Run]) -> list[str]:
    return sorted({name for run in runs for name in run.result})


def _over_frames(was: Sequence[Run], now: Sequence[Run]) -> list[str]:
    return [name for name in _DISTRIBUTIONS if all(name in run.metrics for run in (*was, *now))]


def _values(name: str, was: Sequence[Run], now: Sequence[Run]) -> tuple[FloatArray, FloatArray] | MetricChange:
    """Return a number's values before and after, or its failure where there are none."""
    if lacking := sum(name not in run.result for run in (*was, *now)):
        detail = f"missing from {lacking} of {len(was) + len(now)} runs"
        return MetricChange(name, None, None, "", False, detail)
    before, after = (np.array([run.result[name] for run in runs], dtype=np.float64) for runs in (was, now))
    if not (np.isfinite(before).all() and np.isfinite(after).all()):
        return MetricChange(
            name, float(before.mean()), float(after.mean()), "", False, "not a finite number in every run"
        )
    return before, after


def _judged(was: Sequence[Run], now: Sequence[Run], level: float) -> Iterator[tuple[float, MetricChange]]:
    """Yield p-values with what is reported of each number, and of each metric in single frames."""
    allowed = f"{100.0 * LEVEL:g} % of all"
    for name in _names(was):
        values = _values(name, was, now)
        if isinstance(values, MetricChange):
            yield 0.0, values
            continue
        d = differences(*values)
        p, (half, smallest) = p_of_mean(d), paired_interval(d, level)
        detail = f"by {d.mean():+.3g} ± {half:.2g}, p = {p:.2g}; {smallest:.2g} would have been found"
        yield p, MetricChange(name, float(values[0].mean()), float(values[1].mean()), allowed, True, detail)
    for name in _over_frames(was, now):
        before = [run.metric(name)[1][1:] for run in was]  # the first frame is given
        after = [a + differences(a, run.metric(name)[1][1:]) for a, run in zip(before, now, strict=True)]
        distance, p = energy_test(before, after, np.random.default_rng(0))
        detail = f"energy distance {distance:.3g}, p = {p:.2g}"
        if 2.0 / 2 ** len(was) > level:
            detail += f"; {len(was)} pairs cannot show a change, {int(np.ceil(np.log2(2.0 / level)))} could"
        yield p, MetricChange(f"{name} in frames", None, None, allowed, True, detail)
