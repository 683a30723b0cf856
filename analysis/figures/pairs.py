"""Power and false-alarm rate of paired tests of a code change: a table.

    python -m analysis.figures.pairs [--data DATA] [-o FILE] [--seeds 16]

walk_straight runs with seeds that each have another scene, by three variants of its code: unchanged, with one parameter
changed in its last bit, which stands for another order of sums, and by a thousandth, which soon leads to other
particles. To each of the latter two a deterioration of 2 % of the metric is added. The number of pairs is by Student's
test at 95 % power and the level that `workbench check --paired` has for the first of all metrics; false alarms are
counted in checks of eight of the pairs, each exchanged at random. FILE caches every run, see `cached_runs`.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy import stats

from analysis.figures.cached_runs import Numbers, Run, every_run, numbers_of
from workbench.results.check.seeds import LEVEL, POWER, differences, holm, p_of_mean
from workbench.utils.arrays import FloatArray

EXPERIMENT = "walk_straight"
WORSE = 0.02
ROWS = {
    "as it is": (),
    "last bit": ("prior.sigma_phase=0.009000000000000001",),
    "0.1 %": ("prior.sigma_phase=0.009009",),
}
TABULATED = ("mpjpe_abs_mm", "mpjpe_mm", "mpjpe_px")
NUMBERS = (
    *TABULATED, "pa_mpjpe_mm", "mpjae_local_deg", "humaneva_mm", "humaneva_px", "pck_abs_150mm",
    "mpjpe_abs_mm_max_weight", "mpjpe_mm_max_weight", "mpjpe_px_max_weight", "coverage_50", "coverage_90",
    "coverage_90_root", "coverage_90_head", "coverage_90_arms", "coverage_90_legs", "crps_mm", "crps_deg",
    "nees_per_dim", "nll", "expected_calibration_error", "knee_flexion_rmse_deg", "hip_flexion_rmse_deg",
    "acceleration_error_m_s2", "ess_mean", "unique_ancestors_lag10", "n_track_losses", "lost_fraction", "tracked",
)  # fmt: skip
N_CHECKS, N_PAIRS = 1000, 8
MAX_RUNS = 100_000


def pairs_needed(d: FloatArray, level: float) -> int:
    """Return the number of pairs, with differences such as d, at which Student's two-sided test has POWER for their
    mean."""
    size = abs(d.mean()) / max(float(d.std(ddof=1)), 1e-12)
    return _smallest(lambda n: _power(size * np.sqrt(n), n - 1, level))


def seeds_needed(was: FloatArray, change: float, level: float) -> int:
    """Return the number of seeds, before and after each, of an unpaired test."""
    size = abs(change) / float(was.std(ddof=1))
    return _smallest(lambda n: _power(size * np.sqrt(n / 2.0), 2 * n - 2, level))


def false_alarms(was: Mapping[str, FloatArray], now: Mapping[str, FloatArray], rng: np.random.Generator) -> float:
    """Return the fraction of checks of N_PAIRS randomly exchanged pairs in which any metric fails."""
    d = np.array([differences(was[name], now[name]) for name in was])
    failed = 0
    for _ in range(N_CHECKS):
        some = d[:, rng.choice(d.shape[1], N_PAIRS, replace=False)] * rng.choice([-1.0, 1.0], N_PAIRS)
        failed += bool(holm(np.array([p_of_mean(each) for each in some]), LEVEL).any())
    return failed / N_CHECKS


def table(numbers_by_run: Mapping[Run, Numbers]) -> str:
    """Return a Markdown table with a row for every variant and metric."""
    values = {row: _columns(numbers_by_run, row) for row in ROWS}
    was, level = values["as it is"], LEVEL / len(NUMBERS)
    lines = [
        "| changed by | number | mean | seeds | pairs | pairs for 2 % | seeds for 2 %, not paired | false alarms |"
    ]
    lines.append("|" + " --- |" * 8)
    for row in list(ROWS)[1:]:
        alarms = false_alarms(was, values[row], np.random.default_rng(0))
        for name in TABULATED:
            x, d = was[name], differences(was[name], values[row][name])
            worse = d - d.mean() + WORSE * x  # without the change's own effect
            needed = pairs_needed(worse, level), seeds_needed(x, WORSE * float(x.mean()), level)
            numbers = " | ".join(f"{value:.3g}" for value in (x.mean(), x.std(ddof=1), d.std(ddof=1)))
            lines.append(f"| {row} | `{name}` | {numbers} | {needed[0]} | {needed[1]} | {100.0 * alarms:.1f} % |")
    return "\n".join(lines)


def _columns(numbers_by_run: Mapping[Run, Numbers], row: str) -> dict[str, FloatArray]:
    runs = sorted((run for run in numbers_by_run if run.row == row), key=lambda run: run.seed)
    return {name: np.array([numbers_by_run[run][name] for run in runs]) for name in NUMBERS}


def _power(shift: float, freedom: int, level: float) -> float:
    return float(stats.nct.sf(stats.t.ppf(1.0 - level / 2.0, freedom), freedom, min(shift, 30.0)))


def _smallest(power: Callable[[int], float]) -> int:
    low, high = 2, 3
    while power(high) < POWER:
        low, high = high, 2 * high
        if high > MAX_RUNS:
            return MAX_RUNS
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if power(middle) >= POWER else (middle, high)
    return high


def main(argv: Sequence[str] | None = None) -> int:
    """Run what is missing and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--data", type=Path, help="folder with recorded motion; without, the prior learns from built-in walks"
    )
    parser.add_argument("-o", "--out", type=Path, default=Path("build/pairs.jsonl"), metavar="FILE")
    parser.add_argument("--seeds", type=int, default=16)
    chosen = parser.parse_args(argv)
    same = [f"paths.data={chosen.data or 'null'}"]
    runs = every_run({row: (EXPERIMENT, overrides) for row, overrides in ROWS.items()}, ["builtin"], chosen.seeds, same)
    print(table(numbers_of(runs, chosen.out, NUMBERS)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
