"""Compare today's code with what was recorded on the same seeds: differences run by run, without the seeds' spread."""

from collections.abc import Sequence

import numpy as np
from scipy import stats

from workbench.arrays import FloatArray
from workbench.recording.compare.compare import Finding
from workbench.recording.read.reader import Run

LEVEL = 0.05
"""How often, at most, unchanged code fails on any number at all."""
POWER = 0.95
DISTRIBUTIONS = ("error_abs_mm", "error_rel_mm", "error_px")
"""Metrics whose values in single frames are compared as distributions, beside their means."""
_MOST_FLIPS = 10  # of pairs: 2¹⁰ are tried one by one
_DRAWS = 1999


def compare_paired(was: Sequence[Run], now: Sequence[Run], n_judged: int) -> list[Finding]:
    """Judge every number of the runs by its differences, pair by pair, and the errors of single frames.

    was, now: n ≥ 2 runs each, pairs with equal seeds. n_judged: numbers that are judged at once, in all groups. Half of
    LEVEL goes to the means, half to the distributions, each shared evenly (Bonferroni). A number that is missing from
    any run, or is not finite, fails.
    """
    names = sorted({name for run in was for name in run.result})
    over_frames = [name for name in DISTRIBUTIONS if all(name in run.metrics for run in (*was, *now))]
    found = [_mean(name, was, now, LEVEL / 2.0 / max(n_judged, 1)) for name in names]
    share = LEVEL / 2.0 / max(len(over_frames) * max(n_judged // max(len(names), 1), 1), 1)
    return found + [_distribution(name, was, now, share) for name in over_frames]


def paired_interval(differences: FloatArray, level: float) -> tuple[float, float]:
    """Half-width of Student's interval about the mean of n ≥ 2 differences, and the smallest change it would find.

        h = t(1 − level/2; n − 1) s/√n,   smallest change = (t(1 − level/2; n − 1) + t(POWER; n − 1)) s/√n

    The second is the usual approximation to the power of the two-sided test by the central t distribution.
    """
    n = len(differences)
    error = float(differences.std(ddof=1)) / np.sqrt(n)
    reach = float(stats.t.ppf(1.0 - level / 2.0, n - 1))
    return reach * error, (reach + float(stats.t.ppf(POWER, n - 1))) * error


def flip_test(was: Sequence[FloatArray], now: Sequence[FloatArray], rng: np.random.Generator) -> tuple[float, float]:
    """Energy distance between all values before and all after, and how often exchanging pairs makes it as large.

    was, now: n arrays each of values in single frames, which hang together within a run; so whole runs are exchanged
    within their pairs: all 2ⁿ ways for n ≤ 10, else 1999 drawn ones. Unchanged code gives a p-value of at most p in a
    share p of cases, whatever the distribution (Székely & Rizzo, Energy statistics, 2013, for the distance).
    """
    n = len(was)
    if n <= _MOST_FLIPS:
        flips = (np.arange(2**n)[:, None] >> np.arange(n)) % 2 == 1  # the first exchanges nothing
    else:
        flips = np.vstack([np.zeros((1, n), dtype=bool), rng.random((_DRAWS, n)) < 0.5])
    distances = np.array([_energy(was, now, flip) for flip in flips])
    return float(distances[0]), float(np.mean(distances >= distances[0] * (1.0 - 1e-12)))


def _energy(was: Sequence[FloatArray], now: Sequence[FloatArray], flip: FloatArray) -> float:
    first = np.concatenate([b if other else a for a, b, other in zip(was, now, flip, strict=True)])
    second = np.concatenate([a if other else b for a, b, other in zip(was, now, flip, strict=True)])
    return float(stats.energy_distance(first, second))


def _mean(name: str, was: Sequence[Run], now: Sequence[Run], level: float) -> Finding:
    if lacking := sum(name not in run.result for run in (*was, *now)):
        return Finding(name, None, None, "", False, f"missing from {lacking} of {len(was) + len(now)} runs")
    before, after = (np.array([run.result[name] for run in runs], dtype=np.float64) for runs in (was, now))
    if not (np.isfinite(before).all() and np.isfinite(after).all()):
        return Finding(name, float(before.mean()), float(after.mean()), "", False, "not a finite number in every run")
    moved = float((after - before).mean())
    half, smallest = paired_interval(after - before, level)
    words = f"by {moved:+.3g} ± {half:.2g}; {smallest:.2g} would have been found"
    passed = abs(moved) <= half or moved == 0.0
    return Finding(name, float(before.mean()), float(after.mean()), f"± {half:.3g}", passed, words)


def _distribution(name: str, was: Sequence[Run], now: Sequence[Run], level: float) -> Finding:
    values = [[run.metric(name)[1][1:] for run in runs] for runs in (was, now)]  # the first frame is given
    distance, p = flip_test(values[0], values[1], np.random.default_rng(0))
    words = f"energy distance {distance:.3g}, p = {p:.2g} of {level:.2g}"
    if 2.0 / 2 ** len(was) > level:
        words += f"; {len(was)} pairs cannot tell, {int(np.ceil(np.log2(2.0 / level)))} could"
    return Finding(f"{name} in frames", None, None, f"p > {level:.2g}", p > level, words)
