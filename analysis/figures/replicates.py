"""Results of an experiment over seeds, as its paper writes it and as ours: tracked runs and errors.

    python -m analysis.figures.replicates EXPERIMENT… [--people] [--seeds N] [--quick] [--runs FOLDER] [--data DATA]

Nothing is recorded; the metrics are cached in FOLDER/replicates, and runs of the same configuration are not repeated.
Every seed has its own clothes, background, points and noise, and errors of body, camera and initial pose; generated
walkers differ between seeds, a recorded motion is the same. --people runs over recorded people who are in neither the
training nor the validation data, see `people`, with separate seeds.
"""

import argparse
import hashlib
import json
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import DictConfig, OmegaConf

from analysis.figures import people
from analysis.figures.people import Clips, OverPeople, clip_overrides, report_clips
from analysis.figures.recordings import AS_IT_STANDS, Source, chosen, what_matters
from analysis.figures.unrecorded import composed, finished
from workbench.evaluation.intervals import bootstrap_interval
from workbench.utils.errors import InputError

PAPERS = ("literal", "ours")
N_SEEDS, N_SEEDS_QUICK, N_SEEDS_PEOPLE = 10, 2, 2
NEXT_PERSON = 100
"""Difference between the first seeds of two people."""
KNEES = [("knee_flexion_rmse_deg", "°")]


@dataclass(frozen=True)
class Replicates:
    """Metrics of one experiment's runs, seed by seed."""

    runs: tuple[Mapping[str, float], ...]

    @property
    def tracked_counts(self) -> tuple[int, int]:
        """Return the number of runs that tracked the person throughout, and of all."""
        return round(sum(run["tracked"] for run in self.runs)), len(self.runs)

    def mean(self, metric: str) -> tuple[float, float, float]:
        """Return the mean of a metric over the seeds, and its 95 % bootstrap interval; NaN for fewer than two seeds."""
        values = np.array([run[metric] for run in self.runs])
        low, high = bootstrap_interval(values, np.random.default_rng(0))
        return float(values.mean()), float(low), float(high)

    def described(self, metric: str, unit: str) -> str:
        """Return that mean with its interval in words; a degree sign follows its number without a space."""
        mean, low, high = self.mean(metric)
        interval = f" ({_short(low)} to {_short(high)})" if np.isfinite(low) else ""
        return f"{_short(mean)}{'' if unit.startswith('°') else ' '}{unit}{interval}"


def replicates(experiment: str, paper: str, source: Source, n_seeds: int | None = None) -> Replicates:
    """Return the results of an experiment with n_seeds seeds, cached or by running it.

    Raises InputError for an experiment that cannot be run, and for a study, whose results do not depend on a seed.
    """
    n_seeds = (N_SEEDS_QUICK if source.quick else N_SEEDS) if n_seeds is None else n_seeds
    return _replicates(experiment, paper, source, range(n_seeds))


def over_people(experiment: str, paper: str, source: Source, n_seeds: int = N_SEEDS_PEOPLE) -> OverPeople:
    """Return the results of an experiment with n_seeds seeds of each person to report, cached or by running it.

    Raises InputError for an experiment that cannot be run, or without clips to report.
    """
    config = composed([*chosen(experiment), *source.variants(experiment, paper)[-1]])
    runs: dict[Clips, Sequence[Mapping[str, float]]] = {}
    for k, clips in enumerate(report_clips(config)):
        seeds = range(k * NEXT_PERSON, k * NEXT_PERSON + n_seeds)
        runs[clips] = _replicates(experiment, paper, source, seeds, clip_overrides(config, clips)).runs
    return OverPeople(runs)


def _replicates(
    experiment: str, paper: str, source: Source, seeds: Sequence[int], more: Sequence[str] = ()
) -> Replicates:
    """Return the results of an experiment with these seeds and additional overrides, cached or by running it."""
    overrides = [*chosen(experiment), *source.variants(experiment, paper)[-1], *more]
    config = composed(overrides)
    file = _file(experiment, paper, config, source.folder)
    cached: dict[str, dict[str, float]] = json.loads(file.read_text()) if file.is_file() else {}
    for seed in seeds:
        if str(seed) not in cached:
            cached[str(seed)] = _run(composed([*overrides, f"seed={seed}"]), experiment)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(json.dumps(cached, indent=1))
    return Replicates(tuple(cached[str(seed)] for seed in seeds))


def _file(experiment: str, paper: str, config: DictConfig, folder: Path) -> Path:
    """Return the cache file of this configuration."""
    plain: Any = OmegaConf.to_container(config, resolve=True)
    digest = hashlib.sha256(json.dumps(what_matters(plain), sort_keys=True).encode()).hexdigest()
    return folder / "replicates" / f"{experiment}-{paper}-{digest[:12]}.json"


def _run(config: DictConfig, experiment: str) -> dict[str, float]:
    """Return one run's metrics."""
    if config.study is not None:
        raise InputError(f"{experiment}: a study has no replicates")
    return finished(config, experiment).metrics


def table(results: Mapping[tuple[str, str], Replicates]) -> Iterator[str]:
    """Yield lines of a table in Markdown: experiment and paper, tracked runs, errors with intervals."""
    yield "| experiment | | tracked | joints in space | in the image | knees |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for (experiment, paper), each in results.items():
        n_tracked, n = each.tracked_counts
        metrics = [("mpjpe_abs_mm", "mm"), *([("mpjpe_px", "px")] if "mpjpe_px" in each.runs[0] else KNEES)]
        cells = {metric: each.described(metric, unit) for metric, unit in metrics if metric in each.runs[0]}
        row = [cells.get(metric, "") for metric in ("mpjpe_abs_mm", "mpjpe_px", "knee_flexion_rmse_deg")]
        yield f"| {experiment} | {paper} | {n_tracked} of {n} | {' | '.join(row)} |"


def _short(value: float) -> str:
    return f"{value:.{0 if abs(value) >= 20.0 else 1}f}"


def main() -> int:
    """Return exit code 0, or 2 for bad input."""
    parser = argparse.ArgumentParser(prog="python -m analysis.figures.replicates", description=__doc__)
    parser.add_argument("experiments", nargs="+", metavar="EXPERIMENT")
    parser.add_argument("--people", action="store_true", help="over people instead of on one")
    parser.add_argument(
        "--seeds", type=int, default=None, help=f"how many ({N_SEEDS}, quick {N_SEEDS_QUICK}, people {N_SEEDS_PEOPLE})"
    )
    parser.add_argument("--quick", action="store_true", help="at a small size")
    parser.add_argument("--runs", type=Path, default=Path("recordings/runs"), help="folder of the cached metrics")
    parser.add_argument("--data", default=os.environ.get("WORKBENCH_DATA"), help="recorded motion ($WORKBENCH_DATA)")
    arguments = parser.parse_args()
    source = Source(arguments.runs, arguments.data, arguments.quick)
    try:
        lines = _people_lines if arguments.people else _seed_lines
        print("\n".join(lines(arguments.experiments, source, arguments.seeds)))
    except InputError as error:
        print(f"replicates: {error}", file=sys.stderr)
        return 2
    return 0


def _seed_lines(experiments: Sequence[str], source: Source, n_seeds: int | None) -> Iterator[str]:
    """Yield the table over seeds; each line is also printed as soon as it is available."""
    results = {}
    for experiment, paper in _readings(experiments):
        results[experiment, paper] = replicates(experiment, paper, source, n_seeds)
        _print_last(table({(experiment, paper): results[experiment, paper]}))
    yield from table(results)


def _people_lines(experiments: Sequence[str], source: Source, n_seeds: int | None) -> Iterator[str]:
    """Yield the table over people, likewise."""
    results = {}
    for experiment, paper in _readings(experiments):
        if (experiment, paper) not in AS_IT_STANDS:
            results[experiment, paper] = over_people(experiment, paper, source, n_seeds or N_SEEDS_PEOPLE)
            _print_last(people.table({(experiment, paper): results[experiment, paper]}))
    yield from people.table(results)


def _readings(experiments: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield each experiment as its paper writes it, if it is in one, and as ours."""
    for experiment in experiments:
        yield from ((experiment, paper) for paper in PAPERS if paper == "ours" or _in_a_paper(experiment))


def _in_a_paper(experiment: str) -> bool:
    try:
        composed([*chosen(experiment), "paper=literal"])
    except InputError as error:
        if "is in none of the papers" in str(error):
            return False
        raise
    return True


def _print_last(lines: Iterator[str]) -> None:
    """Print the last line of a table on standard error."""
    print(list(lines)[-1], file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
