"""Runs of experiments over people and seeds whose numbers are kept in a file, so that a table that was cut off goes on.

The file has a line of JSON for every run: its row of the table, clip, seed, experiment, overrides and numbers. What it
holds is not run again; it does not know the code, so that a change of that wants another file.
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
    """One run of an experiment. row: of the table. clip: whose motion. overrides: all but motion and seed."""

    row: str
    experiment: str
    clip: str
    seed: int
    overrides: tuple[str, ...]


def every_run(
    rows: Mapping[str, tuple[str, Sequence[str]]], people: Sequence[str], seeds: int, same: Sequence[str]
) -> list[Run]:
    """All runs of a table, seed by seed. rows: experiment and overrides by the row's name. same: overrides of all."""
    return [
        Run(row, experiment, clip, seed, (*same, *own))
        for seed in range(seeds)
        for clip in people
        for row, (experiment, own) in rows.items()
    ]


def measured(run: Run, names: Sequence[str]) -> dict[str, float]:
    """Track as the run says and give its numbers of these names, NaN where it has none; nothing is recorded.

    The scene is another for every seed, whatever the experiment says.
    """
    said = [f"seed={run.seed}", f"dataset.seed={run.seed}", f"dataset.motion='{run.clip}'"]
    chosen = [f"experiment={run.experiment}", *said, *run.overrides]
    metrics = finished(composed(chosen), run.experiment).metrics
    return {name: metrics.get(name, float("nan")) for name in names}


def numbers_of(runs: Iterable[Run], out: Path, names: Sequence[str]) -> dict[Run, Numbers]:
    """Read the runs' numbers from the file `out`, and run and append those that it lacks."""
    out.parent.mkdir(parents=True, exist_ok=True)
    kept = read_kept(out)
    found: dict[Run, Numbers] = {}
    for run in tqdm(list(runs), unit="run", disable=None):
        if run not in kept:
            kept[run] = measured(run, names)
            with out.open("a") as lines:
                lines.write(json.dumps({**vars(run), "numbers": kept[run]}) + "\n")
        found[run] = kept[run]
    return found


def read_kept(out: Path) -> dict[Run, Numbers]:
    """Read what a file holds; nothing where there is none."""
    lines = out.read_text().splitlines() if out.exists() else []
    kept: dict[Run, Numbers] = {}
    for said in map(json.loads, lines):
        numbers = said.pop("numbers")
        kept[Run(**{**said, "overrides": tuple(said["overrides"])})] = numbers
    return kept


def spread(runs: Mapping[Run, Numbers], name: str, form: str) -> str:
    """Give the mean over people of their means over seeds, ± the deviation between people, and after a comma the mean
    deviation between one person's seeds; as far as there are several; – for what is not known of all."""
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
    """Give the clips of a list in conf/config.yaml, "validation" or "test"."""
    return list(composed([f"paths.data={data}"]).clips[which])
