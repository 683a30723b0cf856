"""What pairs of equal seeds can tell of a change, and how often they call unchanged code changed: a table.

    python -m analysis.figures.pairs [--data DATA] [-o FILE] [--seeds 16]

walk_straight runs with seeds that each have another scene, by three variants of its code: as it is, with one number
moved by its last bit, which stands for another order of sums, and by a thousandth, which soon draws other particles.
To each of the latter two a worsening of 2 % of the number is added. Pairs needed are by Student's test at 95 % power
and the level that `workbench check --paired` has for the first of all numbers; false alarms are counted in checks of
eight of the pairs, each exchanged at random. FILE keeps every run, see `kept_runs`.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy import stats

from analysis.figures.kept_runs import Numbers, Run, every_run, numbers_of
from workbench.results.check.seeds import LEVEL, POWER, differences, holm, p_of_mean
from workbench.utils.arrays import FloatArray

EXPERIMENT = "walk_straight"
WORSE = 0.02
ROWS = {
    "as it is": (),
    "last bit": ("prior.sigma_phase=0.009000000000000001",),
    "0.1 %": ("prior.sigma_phase=0.009009",),
}
SHOWN = ("mpjpe_abs_mm", "mpjpe_mm", "mpjpe_px")
NUMBERS = (
    *SHOWN, "pa_mpjpe_mm", "mpjae_local_deg", "humaneva_mm", "humaneva_px", "pck_abs_150mm", "mpjpe_abs_mm_max_weight",
    "mpjpe_mm_max_weight", "mpjpe_px_max_weight", "coverage_50", "coverage_90", "coverage_90_root", "coverage_90_head",
    "coverage_90_arms", "coverage_90_legs", "crps_mm", "crps_deg", "nees_per_dim", "nll", "expected_calibration_error",
    "knee_flexion_rmse_deg", "hip_flexion_rmse_deg", "acceleration_error_m_s2", "ess_mean", "unique_ancestors_lag10",
    "n_track_losses", "lost_fraction", "tracked",
)  # fmt: skip
N_CHECKS, N_PAIRS = 1000, 8
MOST = 100_000


def pairs_needed(d: FloatArray, level: float) -> int:
    """How many pairs with differences such as d Student's two-sided test wants to find their mean with POWER."""
    size = abs(d.mean()) / max(float(d.std(ddof=1)), 1e-12)
    return _least(lambda n: _power(size * np.sqrt(n), n - 1, level))


def seeds_needed(was: FloatArray, change: float, level: float) -> int:
    """How many seeds each, before and after, without pairing."""
    size = abs(change) / float(was.std(ddof=1))
    return _least(lambda n: _power(size * np.sqrt(n / 2.0), 2 * n - 2, level))


def false_alarms(was: Mapping[str, FloatArray], now: Mapping[str, FloatArray], rng: np.random.Generator) -> float:
    """In which share of checks of N_PAIRS pairs, exchanged at random, any number fails."""
    d = np.array([differences(was[name], now[name]) for name in was])
    failed = 0
    for _ in range(N_CHECKS):
        some = d[:, rng.choice(d.shape[1], N_PAIRS, replace=False)] * rng.choice([-1.0, 1.0], N_PAIRS)
        failed += bool(holm(np.array([p_of_mean(each) for each in some]), LEVEL).any())
    return failed / N_CHECKS


def table(found: Mapping[Run, Numbers]) -> str:
    """Markdown, a row for every variant and number."""
    values = {row: _columns(found, row) for row in ROWS}
    was, level = values["as it is"], LEVEL / len(NUMBERS)
    lines = [
        "| changed by | number | mean | seeds | pairs | pairs for 2 % | seeds for 2 %, not paired | false alarms |"
    ]
    lines.append("|" + " --- |" * 8)
    for row in list(ROWS)[1:]:
        alarms = false_alarms(was, values[row], np.random.default_rng(0))
        for name in SHOWN:
            x, d = was[name], differences(was[name], values[row][name])
            worse = d - d.mean() + WORSE * x  # the change's own effect is not asked for
            wanted = pairs_needed(worse, level), seeds_needed(x, WORSE * float(x.mean()), level)
            numbers = " | ".join(f"{value:.3g}" for value in (x.mean(), x.std(ddof=1), d.std(ddof=1)))
            lines.append(f"| {row} | `{name}` | {numbers} | {wanted[0]} | {wanted[1]} | {100.0 * alarms:.1f} % |")
    return "\n".join(lines)


def _columns(found: Mapping[Run, Numbers], row: str) -> dict[str, FloatArray]:
    runs = sorted((run for run in found if run.row == row), key=lambda run: run.seed)
    return {name: np.array([found[run][name] for run in runs]) for name in NUMBERS}


def _power(shift: float, freedom: int, level: float) -> float:
    return float(stats.nct.sf(stats.t.ppf(1.0 - level / 2.0, freedom), freedom, min(shift, 30.0)))


def _least(power: Callable[[int], float]) -> int:
    low, high = 2, 3
    while power(high) < POWER:
        low, high = high, 2 * high
        if high > MOST:
            return MOST
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
    runs = every_run({row: (EXPERIMENT, own) for row, own in ROWS.items()}, ["builtin"], chosen.seeds, same)
    print(table(numbers_of(runs, chosen.out, NUMBERS)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
