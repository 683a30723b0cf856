"""Paired comparison of two configurations: differences between runs of equal people, clips and seeds."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
import scipy

from workbench.evaluation.metrics import row_of
from workbench.evaluation.uncertainty.intervals import N_RESAMPLES
from workbench.recording.read.reader import Run, Unreadable
from workbench.results.check.seeds import LEVEL, holm, p_of_mean
from workbench.results.report.groups import Grouping, group_runs
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.rng import stream

_TAIL = 0.05
COLUMNS = ("metric", "A", "B", "B − A", "low_90", "high_90", "pairs", "B better", "effect", "p", "significant")


def paired_table(a: Sequence[Run], b: Sequence[Run], unreadable: Sequence[Unreadable] = ()) -> pd.DataFrame:
    """Return a row of COLUMNS for each chief metric that both configurations have.

    Runs are paired by clip and seed. The 90 % interval of the mean difference is of a hierarchical bootstrap: people
    are resampled, then the runs of each; of an only person the runs. `effect` is the mean difference over its standard
    deviation (Cohen's d of pairs), and p of Student's paired t test, both over the people's means, or the runs of an
    only person. `significant` is by Holm's correction over all rows, at the level 0.05. NaN without two pairs.

    Raises
    ------
    InputError : several configurations on one side, or no pair.
    """
    values = [_values(side, group_runs(runs, unreadable)) for side, runs in (("A", a), ("B", b))]
    pairs = values[0].merge(values[1], on=["metric", "clip", "seed"], suffixes=("_a", "_b"), sort=False)
    if pairs.empty:
        names = [{f"{clip} {seed}" for clip, seed in each[["clip", "seed"]].to_numpy()} for each in values]
        found = [", ".join(sorted(each)) for each in names]
        raise InputError(f"expected runs of equal clips and seeds, found {found[0][:200]}; and {found[1][:200]}")
    rows = [_row(str(metric), each) for metric, each in pairs.groupby("metric", sort=False)]
    table = pd.DataFrame(rows, columns=COLUMNS[:-1])
    tested = table["p"].notna().to_numpy()
    table["significant"] = False
    table.loc[tested, "significant"] = holm(table["p"][tested].to_numpy(), LEVEL).astype(bool)
    return table


def _values(side: str, grouping: Grouping) -> pd.DataFrame:
    """Return metric, clip, seed, person and value of the runs of the only configuration."""
    if len(grouping.labels) != 1 or grouping.runs.empty:
        labels = "; ".join(map(str, grouping.labels["group"])) or "none"
        raise InputError(f"{side}: expected complete runs that differ in seeds and people only, found {labels}")
    table = grouping.values.merge(grouping.runs[["recording", "clip"]], on="recording", sort=False)
    chief = [name for name in grouping.metrics if name in grouping.chief_metrics]
    table = table[table["metric"].isin(chief)]
    return table.sort_values("metric", key=lambda names: names.map(chief.index), kind="stable")


def _row(metric: str, pairs: pd.DataFrame) -> tuple[object, ...]:
    difference = (pairs["value_b"] - pairs["value_a"]).to_numpy()
    by_person = [difference[rows] for rows in pairs.groupby("person_a", sort=False).indices.values()]
    units = np.array([each.mean() for each in by_person]) if len(by_person) > 1 else difference
    low, high = hierarchical_interval(by_person, stream(0, "bootstrap"))
    better, known = row_of(metric).better, len(units) > 1
    wins = {"lower": difference < 0.0, "higher": difference > 0.0}.get(str(better))
    spread = float(units.std(ddof=1)) if known else np.nan
    return (
        metric, float(pairs["value_a"].mean()), float(pairs["value_b"].mean()), float(difference.mean()), low, high,
        len(pairs), "–" if wins is None else f"{int(wins.sum())} of {len(pairs)}",
        float(units.mean()) / spread if spread > 0.0 else np.nan, p_of_mean(units) if known else np.nan,
    )  # fmt: skip


def hierarchical_interval(by_person: Sequence[FloatArray], rng: np.random.Generator) -> tuple[float, float]:
    """Return the 90 % percentile bootstrap interval of the mean of values, weighted by runs, of each person's runs.

    People are resampled, and the runs of each person; of an only person the runs (Davison & Hinkley, *Bootstrap Methods
    and their Application*, 1997, section 3.8). The percentiles are expanded for few people (Hesterberg, *American
    Statistician* 69, 2015). NaN for a single value.
    """
    if sum(map(len, by_person)) < 2:
        return np.nan, np.nan
    n = len(by_person)
    units = n if n > 1 else len(by_person[0])
    tail = scipy.stats.norm.cdf(np.sqrt(units / (units - 1)) * scipy.stats.t.ppf(_TAIL, units - 1))
    people = rng.integers(n, size=(N_RESAMPLES, n)) if n > 1 else np.zeros((N_RESAMPLES, 1), dtype=int)
    totals, counts = np.zeros(N_RESAMPLES), np.zeros(N_RESAMPLES)
    for place in people.T:
        for k, values in enumerate(by_person):
            chosen = np.flatnonzero(place == k)
            totals[chosen] += values[rng.integers(len(values), size=(len(chosen), len(values)))].sum(axis=1)
            counts[chosen] += len(values)
    low, high = np.quantile(totals / counts, (tail, 1.0 - tail))
    return float(low), float(high)
