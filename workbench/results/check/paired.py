"""Compare today's code with what was recorded on the same seeds: differences run by run, without the seeds' spread."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from workbench.recording.read.reader import Run
from workbench.results.check.compare import Finding
from workbench.utils.arrays import FloatArray

LEVEL = 0.05
"""How often, at most, unchanged code fails on any number at all."""
POWER = 0.95
ROUNDING = 1e-9
"""Of a number: what it may differ by through the order of sums or another library's last bits."""
DISTRIBUTIONS = ("error_abs_mm", "error_rel_mm", "error_px")
"""Metrics whose values in single frames are compared as distributions, beside their means."""
_MOST_FLIPS = 10  # of pairs: 2¹⁰ are tried one by one
_DRAWS = 9999


@dataclass(frozen=True, eq=False)
class Judged:
    """A number's pairs. p: how probable so large a difference is of unchanged code. words: what was found."""

    quantity: str
    was: float | None
    now: float | None
    p: float
    words: str


def compare_paired(groups: Sequence[tuple[Sequence[Run], Sequence[Run]]]) -> list[list[Finding]]:
    """Judge every number of the runs by its differences, pair by pair, and the errors of single frames.

    groups: of n ≥ 2 runs before and n after, pairs with equal seeds. Returns the findings of each. Unchanged code fails
    on any of all numbers, in all groups, in at most LEVEL of cases: Holm's correction, see `holm`. A number that is
    missing from any run, or is not finite, fails.
    """
    n_judged = sum(len(_names(was)) + len(_over_frames(was, now)) for was, now in groups)
    judged = [list(_judged(was, now, LEVEL / max(n_judged, 1))) for was, now in groups]
    failed = iter(holm(np.array([each.p for group in judged for each in group]), LEVEL))
    return [[_finding(each, bool(next(failed))) for each in group] for group in judged]


def holm(p: FloatArray, level: float) -> FloatArray:
    """Tell which of m hypotheses to refuse so that a true one is in at most `level` of cases, whatever hangs together.

    Their p-values in order, p₍₁₎ ≤ p₍₂₎ …: refused as long as p₍ₖ₎ ≤ level / (m − k + 1) (Holm, A simple sequentially
    rejective multiple test procedure, Scandinavian Journal of Statistics 6, 1979).
    """
    order = np.argsort(p, kind="stable")
    passed = p[order] > level / np.arange(len(p), 0, -1)
    refused = np.empty(len(p), dtype=bool)
    refused[order] = np.cumsum(passed) == 0
    return refused


def differences(was: FloatArray, now: FloatArray) -> FloatArray:
    """What the pairs differ by; 0 where that is no more than rounding."""
    was, now = np.asarray(was, dtype=np.float64), np.asarray(now, dtype=np.float64)
    return np.where(np.abs(now - was) <= ROUNDING * np.abs(was), 0.0, now - was)


def p_of_mean(d: FloatArray) -> float:
    """How probable so large a mean of n ≥ 2 differences is where nothing changed: Student's t test.

    Where all differences are whole numbers, as of counts, of which a few are often equal by chance: `flip_p`.
    """
    if not d.any():
        return 1.0
    if (d == np.round(d)).all():
        return flip_p(d)
    error = float(d.std(ddof=1)) / np.sqrt(len(d))
    return float(2.0 * scipy.stats.t.sf(abs(d.mean()) / error, len(d) - 1)) if error > 0.0 else 0.0


def flip_p(d: FloatArray) -> float:
    """In which share of all exchanges of old and new, pair by pair, the mean of differences is as large."""
    means = np.abs(np.where(_flips(len(d), np.random.default_rng(0)), -d, d).mean(axis=1))
    return float(np.mean(means >= means[0] * (1.0 - 1e-12)))


def paired_interval(differences: FloatArray, level: float) -> tuple[float, float]:
    """Half-width of Student's 95 % interval about the mean of n ≥ 2 differences, and the smallest change it would find.

        h = t(0.975; n − 1) s/√n,   smallest change = (t(1 − level/2; n − 1) + t(POWER; n − 1)) s/√n

    level: of the test, such as LEVEL / m for m numbers. The second is the usual approximation to the power of the
    two-sided test by the central t distribution.
    """
    n = len(differences)
    error = float(differences.std(ddof=1)) / np.sqrt(n)
    half, reach, power = (float(scipy.stats.t.ppf(q, n - 1)) for q in (0.975, 1.0 - level / 2.0, POWER))
    return half * error, (reach + power) * error


def flip_test(was: Sequence[FloatArray], now: Sequence[FloatArray], rng: np.random.Generator) -> tuple[float, float]:
    """Energy distance between all values before and all after, and how often exchanging pairs makes it as large.

    was, now: n arrays each of values in single frames, which hang together within a run; so whole runs are exchanged
    within their pairs: all 2ⁿ ways for n ≤ 10, else 9999 drawn ones. Unchanged code gives a p-value of at most p in a
    share p of cases, whatever the distribution (Székely & Rizzo, Energy statistics, 2013, for the distance).
    """
    distances = np.array([_energy(was, now, flip) for flip in _flips(len(was), rng)])
    return float(distances[0]), float(np.mean(distances >= distances[0] * (1.0 - 1e-12)))


def _flips(n: int, rng: np.random.Generator) -> FloatArray:
    """Which of n pairs to exchange (K, n); the first exchanges nothing."""
    if n <= _MOST_FLIPS:
        return (np.arange(2**n)[:, None] >> np.arange(n)) % 2 == 1
    return np.vstack([np.zeros((1, n), dtype=bool), rng.random((_DRAWS, n)) < 0.5])


def _energy(was: Sequence[FloatArray], now: Sequence[FloatArray], flip: FloatArray) -> float:
    first = np.concatenate([b if other else a for a, b, other in zip(was, now, flip, strict=True)])
    second = np.concatenate([a if other else b for a, b, other in zip(was, now, flip, strict=True)])
    return float(scipy.stats.energy_distance(first, second))


def _names(runs: Sequence[Run]) -> list[str]:
    return sorted({name for run in runs for name in run.result})


def _over_frames(was: Sequence[Run], now: Sequence[Run]) -> list[str]:
    return [name for name in DISTRIBUTIONS if all(name in run.metrics for run in (*was, *now))]


def _judged(was: Sequence[Run], now: Sequence[Run], level: float) -> Iterator[Judged]:
    for name in _names(was):
        yield _mean(name, was, now, level)
    for name in _over_frames(was, now):
        yield _distribution(name, was, now, level)


def _finding(judged: Judged, failed: bool) -> Finding:
    share = f"{100.0 * LEVEL:g} % of all"
    return Finding(judged.quantity, judged.was, judged.now, share, not failed, judged.words)


def pairs_of(name: str, was: Sequence[Run], now: Sequence[Run]) -> tuple[FloatArray, FloatArray] | str:
    """A number's values before and after; what is wrong where there are none."""
    if lacking := sum(name not in run.result for run in (*was, *now)):
        return f"missing from {lacking} of {len(was) + len(now)} runs"
    before, after = (np.array([run.result[name] for run in runs], dtype=np.float64) for runs in (was, now))
    if not (np.isfinite(before).all() and np.isfinite(after).all()):
        return "not a finite number in every run"
    return before, after


def _mean(name: str, was: Sequence[Run], now: Sequence[Run], level: float) -> Judged:
    found = pairs_of(name, was, now)
    if isinstance(found, str):
        return Judged(name, None, None, 0.0, found)
    d = differences(*found)
    p, (half, smallest) = p_of_mean(d), paired_interval(d, level)
    words = f"by {d.mean():+.3g} ± {half:.2g}, p = {p:.2g}; {smallest:.2g} would have been found"
    return Judged(name, float(found[0].mean()), float(found[1].mean()), p, words)


def _distribution(name: str, was: Sequence[Run], now: Sequence[Run], level: float) -> Judged:
    before = [run.metric(name)[1][1:] for run in was]  # the first frame is given
    after = [a + differences(a, run.metric(name)[1][1:]) for a, run in zip(before, now, strict=True)]
    distance, p = flip_test(before, after, np.random.default_rng(0))
    words = f"energy distance {distance:.3g}, p = {p:.2g}"
    if 2.0 / 2 ** len(was) > level:
        words += f"; {len(was)} pairs cannot tell, {int(np.ceil(np.log2(2.0 / level)))} could"
    return Judged(f"{name} in frames", None, None, p, words)
