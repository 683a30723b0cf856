"""Runs of experiments over people and seeds with cached results, so that an interrupted table can be resumed.

The cache file has a line of JSON for every run: its row of the table, clip, seed, experiment, overrides and metrics.
Cached runs are not repeated; the cache is independent of the code, so that changed code needs another file.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from analysis.figures.unrecorded import composed, finished

Numbers = Mapping[str, float]


@dataclass(frozen=True)
class Run:
    """One run of an experiment. row: of the table. clip: recorded motion. overrides: all but motion and seed."""

    row: str
    experiment: str
    clip: str
    seed: int
    overrides: tuple[str, ...]


def every_run(
    rows: Mapping[str, tuple[str, Sequence[str]]], people: Sequence[str], seeds: int, same: Sequence[str]
) -> list[Run]:
    """Return all runs of a table, seed by seed. rows: experiment and overrides by the row's name. same: overrides of
    all."""
    return [
        Run(row, experiment, clip, seed, (*same, *overrides))
        for seed in range(seeds)
        for clip in people
        for row, (experiment, overrides) in rows.items()
    ]


def measured(run: Run, names: Sequence[str]) -> dict[str, float]:
    """Return a run's metrics of these names, NaN for missing ones; nothing is recorded. The scene differs between
    seeds."""
    entry = [f"seed={run.seed}", f"dataset.motion='{run.clip}'"]
    chosen = [f"experiment={run.experiment}", *entry, *run.overrides]
    metrics = finished(composed(chosen), run.experiment).metrics
    return {name: metrics.get(name, float("nan")) for name in names}


def numbers_of(runs: Iterable[Run], out: Path, names: Sequence[str]) -> dict[Run, Numbers]:
    """Return the metrics of the runs, from the file `out` or by running and appending those that it lacks."""
    out.parent.mkdir(parents=True, exist_ok=True)
    cached = read_cached(out)
    numbers_by_run: dict[Run, Numbers] = {}
    for run in tqdm(list(runs), unit="run", disable=None):
        if run not in cached:
            cached[run] = measured(run, names)
            with out.open("a") as lines:
                lines.write(json.dumps({**vars(run), "numbers": cached[run]}) + "\n")
        numbers_by_run[run] = cached[run]
    return numbers_by_run


def read_cached(out: Path) -> dict[Run, Numbers]:
    """Return the content of a cache file; empty if it does not exist."""
    lines = out.read_text().splitlines() if out.exists() else []
    cached: dict[Run, Numbers] = {}
    for entry in map(json.loads, lines):
        numbers = entry.pop("numbers")
        cached[Run(**{**entry, "overrides": tuple(entry["overrides"])})] = numbers
    return cached


def spread(runs: Mapping[Run, Numbers], name: str, form: str) -> str:
    """Return the mean over people of their means over seeds, ± the standard deviation between people, and after a comma
    the mean standard deviation between one person's seeds, if there are several; – if any value is missing."""
    people: dict[str, list[float]] = {}
    for run, numbers in runs.items():
        people.setdefault(run.clip, []).append(numbers[name])
    means = [float(np.mean(seeds)) for seeds in people.values()]
    if np.isnan(means).any():
        return "–"
    within = [float(np.std(seeds, ddof=1)) for seeds in people.values() if len(seeds) > 1]
    between = f" ± {np.std(means, ddof=1):{form}}" if len(means) > 1 else ""
    return f"{np.mean(means):{form}}{between}" + (f", {np.mean(within):{form}}" if within else "")


def people(which: str, data: Path) -> list[str]:
    """Return the clips of a list in conf/config.yaml, "choose" or "report"."""
    return list(composed([f"paths.data={data}"]).clips[which])
