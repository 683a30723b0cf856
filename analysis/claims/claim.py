"""A claim of a paper, its runs under the paper's conditions, and the forms of its verdict."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from analysis.figures.cached_runs import Run
from analysis.figures.recordings import Source
from analysis.figures.replicates import PAPERS, runs_of, short
from analysis.figures.unrecorded import Result
from workbench.evaluation.errors.track_loss import lost_frames
from workbench.utils.arrays import BoolArray
from workbench.utils.errors import InputError

SeedResults: TypeAlias = Sequence[Result]
Judge: TypeAlias = Callable[..., "Verdict"]
"""Judges a claim by the source of its motion and by the results, seed by seed, of every setup, in their order."""


@dataclass(frozen=True)
class Verdict:
    """Whether a claim holds, and the measured numbers in words."""

    holds: bool
    numbers: str


@dataclass(frozen=True)
class Setup:
    """An experiment of a claim, or one of `recordings.VARIANTS`, with further overrides. n_seeds: None: as many as
    asked for."""

    experiment: str
    overrides: tuple[str, ...] = ()
    n_seeds: int | None = None

    def runs(self, paper: str, source: Source, n_seeds: int | None) -> list[Run]:
        """Return the runs in a version, with the body, the camera and the initial pose that the tracker assumes."""
        runs = runs_of(self.experiment, paper, source, self.n_seeds or n_seeds, self.overrides)
        if "perturb" not in (runs[0].configuration.dataset or {}):
            return runs
        return [replace(run, overrides=(*run.overrides, "dataset.perturb=false")) for run in runs]


@dataclass(frozen=True)
class Claim:
    """A claim of a figure. condition: what must hold. judge: one for all versions, or by version. versions: those in
    which it is tested. reasons: why it need not hold, by version."""

    name: str
    condition: str
    setups: tuple[Setup, ...]
    judge: Judge | Mapping[str, Judge]
    versions: tuple[str, ...] = PAPERS
    reasons: Mapping[str, str] = field(default_factory=dict)

    def runs(self, paper: str, source: Source, n_seeds: int | None) -> list[list[Run]]:
        """Return the runs of every setup; raises InputError where recorded motion is missing."""
        return [setup.runs(paper, source, n_seeds) for setup in self.setups]

    def verdict(self, paper: str, source: Source, results: Sequence[SeedResults]) -> Verdict:
        """Return the verdict in a version."""
        judge = self.judge[paper] if isinstance(self.judge, Mapping) else self.judge
        return judge(source, *results)


def lost(result: Result) -> BoolArray:
    """Return whether the person is lost in each frame (F,) after the first; raises InputError without joint errors."""
    if (states := lost_frames(result.series)) is None:
        raise InputError("the runs have no joint errors")
    return states


def tracked(at_least: float = 0.0, at_most: float = 1.0, last_frame: int | None = None) -> Judge:
    """Return the judge of the fraction of seeds in which the person is not lost up to a frame; None: the last."""

    def judge(_: Source, results: SeedResults, *__: SeedResults) -> Verdict:
        n = sum(not lost(result)[:last_frame].any() for result in results)
        units = {"mpjpe_px": "px", "mpjpe_mm": "mm root-aligned", "mpjpe_abs_mm": "mm"}
        errors = [f"{short(mean(results, name))} {unit}" for name, unit in units.items() if name in results[0].metrics]
        outcome = f"tracked{'' if last_frame is None else f' to frame {last_frame}'}; {', '.join(errors)}"
        return Verdict(at_least <= n / len(results) <= at_most, f"{n} of {len(results)} {outcome}")

    return judge


def within(words: str, value: str | Callable[..., float], low: float = -np.inf, high: float = np.inf) -> Judge:
    """Return the judge of "a value lies between two limits". value: of the results of all setups; or a metric, whose
    mean over the seeds of the first setup it is."""
    limits = f"at least {low:g}" if np.isinf(high) else f"{low:g} to {high:g}".replace("-inf to", "at most")

    def judge(_: Source, *results: SeedResults) -> Verdict:
        measured = mean(results[0], value) if isinstance(value, str) else value(*results)
        return Verdict(low <= measured <= high, f"{words} {measured:.3g} ({limits})")

    return judge


def both(*judges: Judge) -> Judge:
    """Return the judge of several conditions on the same results."""

    def judge(source: Source, *results: SeedResults) -> Verdict:
        verdicts = [each(source, *results) for each in judges]
        return Verdict(all(each.holds for each in verdicts), "; ".join(each.numbers for each in verdicts))

    return judge


def mean(results: SeedResults, metric: str) -> float:
    """Return the mean over the seeds of a metric, or of a value over frames; raises InputError where a run lacks it."""
    if any(metric not in {**result.metrics, **result.series} for result in results):
        raise InputError(f"the runs have no metric {metric}")
    values = [result.metrics.get(metric, result.series.get(metric, ())) for result in results]
    return float(np.mean([np.mean(value) for value in values]))


def ratio(metric: str, other: str = "") -> Callable[..., float]:
    """Return the function of the mean of a metric over that of another one, or over that of the second setup."""
    return lambda *results: mean(results[0], metric) / mean(results[-1], other or metric)
