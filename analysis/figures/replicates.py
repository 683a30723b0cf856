"""An experiment's numbers over seeds, as its paper writes it and as ours: how many runs hold, and how well.

    python -m analysis.figures.replicates EXPERIMENT… [--people] [--seeds N] [--quick] [--runs FOLDER] [--data DATA]

Nothing is recorded; the numbers are kept in FOLDER/replicates, and what is there of the same configuration is not run
again. Every seed has clothes, background, points and noise of its own, and another error of body, camera and start; of
generated walkers each is another person, a recorded motion is the same. --people goes through recorded people whom
nothing was learned from and no parameters were chosen by, see `people`, with seeds that nobody else has.
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
from analysis.figures.people import Clips, OverPeople, report_clips, shown
from analysis.figures.recordings import AS_IT_STANDS, Source, chosen, what_matters
from analysis.figures.unrecorded import composed, finished
from workbench.evaluation.intervals import bootstrap_interval
from workbench.utils.errors import InputError

PAPERS = ("literal", "ours")
N_SEEDS, N_SEEDS_QUICK, N_SEEDS_PEOPLE = 10, 2, 2
APART = 1000
"""From a run's seed to that of its data set."""
NEXT_PERSON = 100
"""From a person's first seed to the next one's."""
KNEES = [("knee_flexion_rmse_deg", "°")]
HELD_MM, LAST_FRAMES = 150.0, 5
"""Without images a person is held whose joints are off by less than this in the last frames, as in pck_abs_150mm."""


@dataclass(frozen=True)
class Replicates:
    """The metrics of one experiment's runs, seed by seed, and what tells this experiment from others."""

    runs: tuple[Mapping[str, float], ...]

    @property
    def held(self) -> tuple[int, int]:
        """How many runs held the person to the end, of how many."""
        return round(sum(run["tracked"] for run in self.runs)), len(self.runs)

    def mean(self, metric: str) -> tuple[float, float, float]:
        """Mean of a metric over the seeds, and its 95 % bootstrap interval; NaN for fewer than two seeds."""
        values = np.array([run[metric] for run in self.runs])
        low, high = bootstrap_interval(values, np.random.default_rng(0))
        return float(values.mean()), float(low), float(high)

    def told(self, metric: str, unit: str) -> str:
        """That mean with its interval in words; a degree's sign follows its number at once."""
        mean, low, high = self.mean(metric)
        interval = f" ({_short(low)} to {_short(high)})" if np.isfinite(low) else ""
        return f"{_short(mean)}{'' if unit.startswith('°') else ' '}{unit}{interval}"


def replicates(experiment: str, paper: str, source: Source, n_seeds: int | None = None) -> Replicates:
    """Run an experiment with so many seeds, or take what was kept of the same configuration.

    Raises InputError for an experiment that cannot be run, and for a study, which draws nothing that matters.
    """
    n_seeds = (N_SEEDS_QUICK if source.quick else N_SEEDS) if n_seeds is None else n_seeds
    return _replicates(experiment, paper, source, range(n_seeds))


def over_people(experiment: str, paper: str, source: Source, n_seeds: int = N_SEEDS_PEOPLE) -> OverPeople:
    """Run an experiment with so many seeds of each person to report, or take what was kept.

    Raises InputError for an experiment that cannot be run or shows what nobody to report does.
    """
    config = composed([*chosen(experiment), *source.variants(experiment, paper)[-1]])
    runs: dict[Clips, Sequence[Mapping[str, float]]] = {}
    for k, clips in enumerate(report_clips(config)):
        seeds = range(k * NEXT_PERSON, k * NEXT_PERSON + n_seeds)
        runs[clips] = _replicates(experiment, paper, source, seeds, shown(config, clips)).runs
    return OverPeople(runs)


def _replicates(
    experiment: str, paper: str, source: Source, seeds: Sequence[int], more: Sequence[str] = ()
) -> Replicates:
    """Run an experiment, with more overrides, with these seeds, or take what was kept."""
    overrides = [*chosen(experiment), *source.variants(experiment, paper)[-1], *more]
    config = composed(overrides)
    file = _file(experiment, paper, config, source.folder)
    own_seed = "seed" in (config.dataset or {})
    kept: dict[str, dict[str, float]] = json.loads(file.read_text()) if file.is_file() else {}
    for seed in seeds:
        if str(seed) not in kept:
            apart = [f"dataset.seed={APART + seed}"] if own_seed else []
            kept[str(seed)] = _run(composed([*overrides, f"seed={seed}", *apart]), experiment)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(json.dumps(kept, indent=1))
    return Replicates(tuple(kept[str(seed)] for seed in seeds))


def _file(experiment: str, paper: str, config: DictConfig, folder: Path) -> Path:
    """Where the numbers of this configuration are kept."""
    plain: Any = OmegaConf.to_container(config, resolve=True)
    digest = hashlib.sha256(json.dumps(what_matters(plain), sort_keys=True).encode()).hexdigest()
    return folder / "replicates" / f"{experiment}-{paper}-{digest[:12]}.json"


def _run(config: DictConfig, experiment: str) -> dict[str, float]:
    """One run's metrics; `held` by the last frames' errors in space where there are no images."""
    if config.study is not None:
        raise InputError(f"{experiment}: a study has no replicates")
    summary = finished(config, experiment)
    off_mm = np.mean(summary.per_frame.get("mpjpe_abs_mm", [np.nan])[-LAST_FRAMES:])
    return {"tracked": float(off_mm < HELD_MM), **summary.metrics}


def table(found: Mapping[tuple[str, str], Replicates]) -> Iterator[str]:
    """Lines of a table in Markdown: experiment and paper, runs held, errors with intervals."""
    yield "| experiment | | held | joints in space | in the image | knees |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for (experiment, paper), each in found.items():
        held, n = each.held
        metrics = [("mpjpe_abs_mm", "mm"), *([("mpjpe_px", "px")] if "mpjpe_px" in each.runs[0] else KNEES)]
        cells = {metric: each.told(metric, unit) for metric, unit in metrics if metric in each.runs[0]}
        row = [cells.get(metric, "") for metric in ("mpjpe_abs_mm", "mpjpe_px", "knee_flexion_rmse_deg")]
        yield f"| {experiment} | {paper} | {held} of {n} | {' | '.join(row)} |"


def _short(value: float) -> str:
    return f"{value:.{0 if abs(value) >= 20.0 else 1}f}"


def main() -> int:
    """Exit code 0, or 2 for bad input."""
    parser = argparse.ArgumentParser(prog="python -m analysis.figures.replicates", description=__doc__)
    parser.add_argument("experiments", nargs="+", metavar="EXPERIMENT")
    parser.add_argument("--people", action="store_true", help="over people instead of on one")
    parser.add_argument(
        "--seeds", type=int, default=None, help=f"how many ({N_SEEDS}, quick {N_SEEDS_QUICK}, people {N_SEEDS_PEOPLE})"
    )
    parser.add_argument("--quick", action="store_true", help="at a small size")
    parser.add_argument("--runs", type=Path, default=Path("recordings/runs"), help="where numbers are kept")
    parser.add_argument("--data", default=os.environ.get("WORKBENCH_DATA"), help="recorded motion ($WORKBENCH_DATA)")
    given = parser.parse_args()
    source = Source(given.runs, given.data, given.quick)
    try:
        lines = _people_lines if given.people else _seed_lines
        print("\n".join(lines(given.experiments, source, given.seeds)))
    except InputError as error:
        print(f"replicates: {error}", file=sys.stderr)
        return 2
    return 0


def _seed_lines(experiments: Sequence[str], source: Source, n_seeds: int | None) -> Iterator[str]:
    """The table over seeds, each line told as soon as it is there."""
    found = {}
    for experiment, paper in _readings(experiments):
        found[experiment, paper] = replicates(experiment, paper, source, n_seeds)
        _tell(table({(experiment, paper): found[experiment, paper]}))
    yield from table(found)


def _people_lines(experiments: Sequence[str], source: Source, n_seeds: int | None) -> Iterator[str]:
    """The table over people, likewise."""
    found = {}
    for experiment, paper in _readings(experiments):
        if (experiment, paper) not in AS_IT_STANDS:
            found[experiment, paper] = over_people(experiment, paper, source, n_seeds or N_SEEDS_PEOPLE)
            _tell(people.table({(experiment, paper): found[experiment, paper]}))
    yield from people.table(found)


def _readings(experiments: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Each experiment as its paper writes it, where it is in one, and as ours."""
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


def _tell(lines: Iterator[str]) -> None:
    """Tell the last of a table's lines on standard error."""
    print(list(lines)[-1], file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
