"""Cached runs of experiments, so that interrupted work continues where it stopped.

FOLDER/measured has a file of JSON for every configuration without clip and seed: results by clip and seed, and the
commits that made them. Cached runs are not repeated. The cache is independent of the code; a warning counts the runs of
other code, which a new FOLDER repeats.
"""

import hashlib
import json
import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from omegaconf import DictConfig, OmegaConf

from analysis.figures.recordings import chosen, what_matters
from analysis.figures.unrecorded import Result, composed, measured
from workbench.experiment.provenance import code_state
from workbench.utils.atomic_write import whole_file

Numbers = Mapping[str, float]
UNKNOWN_S = 20.0
"""Estimate of a run's time where nothing like it was measured."""
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Run:
    """One run of an experiment. row: of its table. clip: recorded motion, empty for that of the experiment. overrides:
    all but motion and seed."""

    row: str
    experiment: str
    clip: str
    seed: int
    overrides: tuple[str, ...]

    @property
    def configuration(self) -> DictConfig:
        """The configuration without clip and seed."""
        return _composed((*chosen(self.experiment), *self.overrides))

    @property
    def key(self) -> str:
        """The run among those of its configuration."""
        return f"{self.clip} {self.seed}".lstrip()

    def own_configuration(self) -> DictConfig:
        """Return the configuration with clip and seed."""
        clip = [f"dataset.motion='{self.clip}'"] if self.clip else []
        return composed([*chosen(self.experiment), *clip, *self.overrides, f"seed={self.seed}"])


class RunCache:
    """Results of runs below a folder; those that are missing are run. n_missing: to run, for the estimate of time."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.n_missing = folder / "measured", 0
        self._times_s: list[float] = []
        self._contents: dict[Path, dict[str, Any]] = {}

    def cached(self, run: Run) -> Result | None:
        """Return the result of a run that is cached."""
        entry = self._entries(run).get(run.key)
        return None if entry is None else Result(entry["metrics"], entry["series"], entry["seconds"])

    def expect(self, runs: Iterable[Run]) -> None:
        """Count the runs to make, log an estimate of their time, and warn of cached runs of other code."""
        every = {(self._file(run), run.key): run for run in runs}
        entries = [self._entries(run).get(run.key) for run in every.values()]
        if others := sum(entry is not None and entry["commit"] != _commit() for entry in entries):
            log.warning("%d of %d runs were made by other code; a new folder repeats them", others, len(every))
        missing = [run for run, entry in zip(every.values(), entries, strict=True) if entry is None]
        self.n_missing, seconds = len(missing), 0.0
        for run in missing:
            times_s = [entry["seconds"] for entry in self._entries(run).values()]
            seconds += float(np.mean(times_s)) if times_s else UNKNOWN_S
        if missing:
            log.info("%d runs to make, about %s", len(missing), _duration(seconds))

    def results(self, runs: Iterable[Run]) -> dict[Run, Result]:
        """Return the results of runs, cached or new; raises InputError for a run that is not possible."""
        return {run: self.cached(run) or self._make(run) for run in runs}

    def _make(self, run: Run) -> Result:
        began_s = perf_counter()
        result = measured(run.own_configuration(), run.experiment)
        self._contents.pop(self._file(run), None)  # another process may have added runs
        self._entries(run)[run.key] = {**asdict(result), "commit": _commit()}
        with whole_file(self._file(run), parents=True) as part:
            part.write_text(json.dumps(self._contents[self._file(run)]))
        self._times_s.append(perf_counter() - began_s)
        self.n_missing = max(0, self.n_missing - 1)
        left = f"{self.n_missing} left, about {_duration(self.n_missing * float(np.mean(self._times_s)))}"
        log.info("%s, %s, %s: %.0f s; %s", run.row, run.experiment, run.key, result.seconds, left)
        return result

    def _file(self, run: Run) -> Path:
        return self.folder / f"{run.experiment}-{_digest(run.experiment, run.overrides)}.json"

    def _entries(self, run: Run) -> dict[str, Any]:
        """Return the cached runs of a configuration by their keys."""
        file = self._file(run)
        if file not in self._contents:
            new: dict[str, Any] = {"overrides": run.overrides, "runs": {}}
            self._contents[file] = json.loads(file.read_text()) if file.is_file() else new
        entries: dict[str, Any] = self._contents[file]["runs"]
        return entries


@lru_cache(maxsize=1024)
def _composed(overrides: tuple[str, ...]) -> DictConfig:
    return composed(overrides)


@lru_cache(maxsize=1024)
def _digest(experiment: str, overrides: tuple[str, ...]) -> str:
    plain: Any = OmegaConf.to_container(_composed((*chosen(experiment), *overrides)), resolve=True)
    return hashlib.sha256(json.dumps(what_matters(plain), sort_keys=True).encode()).hexdigest()[:12]


def _commit() -> str:
    """Return the commit of the code, with + where files are changed; empty without a git clone."""
    state = code_state(Path(__file__).parents[2])
    return state.get("commit", "") + ("+" if state.get("changed") == "yes" else "")


def _duration(seconds: float) -> str:
    return f"{seconds / 3600.0:.1f} h" if seconds >= 5400.0 else f"{seconds / 60.0:.0f} min"


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


def numbers_of(runs: Sequence[Run], folder: Path, names: Sequence[str]) -> dict[Run, Numbers]:
    """Return metrics of runs, NaN for missing ones, cached below a folder or by running them."""
    cache = RunCache(folder)
    cache.expect(runs)
    results = cache.results(runs)
    return {run: {name: result.metrics.get(name, np.nan) for name in names} for run, result in results.items()}


def people(which: str, data: Path) -> list[str]:
    """Return the clips of a list in conf/config.yaml, such as "validation" or "test"."""
    return list(composed([f"paths.data={data}"]).clips[which])
