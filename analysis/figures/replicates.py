"""Results of an experiment over seeds, as its paper writes it and as ours.

Every seed has its own clothes, background, points and noise, and errors of body, camera and initial pose; generated
walkers differ between seeds, a recorded motion is the same.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.figures.cached_runs import Run, RunCache
from analysis.figures.recordings import Source
from workbench.evaluation.uncertainty.intervals import bootstrap_interval

PAPERS = ("literal", "ours")
N_SEEDS, N_SEEDS_QUICK = 10, 2


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
        mean, low, high = map(short, self.mean(metric))
        interval = f" ({low} to {high})" if len(self.runs) > 1 else ""
        return f"{mean}{'' if unit.startswith('°') else ' '}{unit}{interval}"


def runs_of(
    experiment: str, paper: str, source: Source, n_seeds: int | None = None, more: Sequence[str] = ()
) -> list[Run]:
    """Return the runs of an experiment in one version over n_seeds seeds. more: further overrides.

    Raises InputError for an experiment that needs recorded motion which the source lacks.
    """
    n_seeds = (N_SEEDS_QUICK if source.quick else N_SEEDS) if n_seeds is None else n_seeds
    overrides = (*source.variants(experiment, paper)[-1], *more)
    return [Run(paper, experiment, "", seed, overrides) for seed in range(n_seeds)]


def replicates(experiment: str, paper: str, source: Source, n_seeds: int | None = None) -> Replicates:
    """Return the results of an experiment with n_seeds seeds, cached or by running it; InputError as `runs_of`."""
    runs, cache = runs_of(experiment, paper, source, n_seeds), RunCache(source.folder)
    cache.expect(runs)
    return Replicates(tuple(result.metrics for result in cache.results(runs).values()))


def short(value: float) -> str:
    """Return a number with one decimal below 20 and none above."""
    return f"{value:.{0 if abs(value) >= 20.0 else 1}f}"
