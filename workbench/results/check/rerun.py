"""Recordings run again and compared with what they hold: one by one, or in groups of several seeds; and renewed."""

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from itertools import count, islice
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf
from tqdm import tqdm

from workbench.experiment.config.stored import runnable_config
from workbench.experiment.run import execute
from workbench.recording.condense import condense, is_condensed
from workbench.recording.read.crash_probe import open_sound_runs
from workbench.recording.read.reader import Run, read
from workbench.recording.settings import NO_EFFECT
from workbench.results.check.agreement import Agreement, MetricChange, Tolerance
from workbench.results.check.compare import compare, demand_on, same_environment
from workbench.results.check.outcome import Check, has_moved
from workbench.results.check.seeds import compare_paired, compare_seeds
from workbench.utils.atomic_write import whole_file
from workbench.utils.errors import InputError
from workbench.utils.input_limits import parse_json
from workbench.utils.run_files import RECORDING

TOLERANCES = "tolerances.json"
"""File next to checked recordings with the tolerances of their numbers in another environment."""
_REASONS = "reasons.md"
"""File next to renewed recordings with the reasons."""


@dataclass(frozen=True)
class Request:
    """A request to check recordings.

    overrides: key=value. own: today's top-level configuration. folder: of the new runs. exact: numbers must be
    identical.
    """

    overrides: Sequence[str]
    own: DictConfig
    folder: Path
    exact: bool = False

    def config(self, run: Run) -> DictConfig:
        """Return the configuration of a recording for a new run; InputError as `runnable_config`."""
        return runnable_config(run, self.overrides, self.own)


class _RunError(Exception):
    """The error that ended a run."""

    @property
    def change(self) -> MetricChange:
        return MetricChange("run", None, None, "complete", False, f"crashed: {self}", Agreement.CHANGED)


def read_sound(paths: Sequence[Path]) -> tuple[list[Run], list[Check]]:
    """Return the readable recordings, and checks that refuse the others."""
    runs, problems = open_sound_runs(*paths)
    return runs, [Check(str(problem.path), refused=problem.reason) for problem in problems]


def tolerances(run: Run, own: DictConfig) -> dict[str, Tolerance]:
    """Return the tolerances of a run's numbers in another environment.

    Measured ones are in `tolerances.json` next to the recording, which `python -m analysis.tolerances` writes. Other
    numbers have those of the recorded configuration, or today's where it has none. Raises InputError for an invalid
    tolerance.
    """
    stored: Any = run.settings.get("check", OmegaConf.to_container(own.check))
    try:
        configured = {
            name: Tolerance(**{key: float(value) for key, value in keys.items()}) for name, keys in stored.items()
        }
    except (AttributeError, TypeError, ValueError):
        raise InputError(f"{run.path}: check: expected the keys absolute and relative for every metric") from None
    path = run.path.parent / TOLERANCES
    if not path.is_file():
        return configured
    content: Any = parse_json(path, path.read_text(encoding="utf-8"))
    try:
        measured = content["tolerances"].get(run.path.stem, {})
        return configured | {str(name): Tolerance(absolute=float(value)) for name, value in measured.items()}
    except (AttributeError, KeyError, TypeError, ValueError):
        raise InputError(f"{path}: expected numbers by recording and metric under 'tolerances'") from None


def check_two(name: str, was: Run, now: Run, request: Request) -> Check:
    """Compare two recordings."""
    try:
        demand = demand_on(was, now, tolerances(was, request.own), request.exact)
        return Check(name, compare(was, now, demand), was=was, now=now, demand=demand)
    except InputError as error:
        return Check(name, refused=str(error))


def check_each(runs: Sequence[Run], request: Request) -> Iterator[Check]:
    """Yield the checks of recordings that are run again; run k is recorded in `folder/00k`."""
    for k, was in enumerate(tqdm(runs, unit="recording", disable=None)):
        name = str(was.path)
        try:
            now = rerun(was, request.config(was), request.folder / f"{k:03d}")
        except InputError as error:
            yield Check(name, refused=str(error))
        except _RunError as crash:
            yield Check(name, [crash.change], was=was)
        else:
            yield check_two(name, was, now, request)


def check_groups(runs: Sequence[Run], request: Request, n_seeds: int | None) -> list[Check]:
    """Return the checks of groups of recordings that differ only in their seeds, with all numbers tested jointly.

    n_seeds: number of runs of other seeds, whose numbers are compared as distributions; None: the complete recordings'
    seeds, compared pair by pair.
    """
    checks, made = [], []
    compared = runs if n_seeds is not None else [run for run in runs if run.status == "complete"]
    for k, group in enumerate(_groups_of_seeds(compared)):
        name = str(group[0].path) + (f" and {len(group) - 1} more" if len(group) > 1 else "")
        try:
            configs = _configs(group, request, n_seeds)
            places = [request.folder / f"{k:03d}" / str(j) for j in range(len(configs))]
            jobs = tqdm(list(zip(configs, places, strict=True)), unit="seed", disable=None)
            made.append((name, group, [rerun(group[0], *job) for job in jobs]))
        except InputError as error:
            checks.append(Check(name, refused=str(error)))
        except _RunError as crash:
            checks.append(Check(name, [crash.change]))
    pairs = [(group, new) for _, group, new in made]
    changes = compare_paired(pairs) if n_seeds is None else compare_seeds(pairs)
    return checks + [Check(name, each) for (name, _, _), each in zip(made, changes, strict=True)]


def _configs(group: Sequence[Run], request: Request, n_seeds: int | None) -> list[DictConfig]:
    """Return the configurations of a group's new runs: its own, or with the n smallest seeds that it does not have.

    Runs of the same seeds would be no independent sample.
    """
    if n_seeds is None:
        if len(group) == 1:
            raise InputError("--paired: expected recordings of two seeds or more, found one")
        return [request.config(run) for run in group]
    used, config = {run.settings.get("seed", 0) for run in group}, request.config(group[0])
    seeds = islice((seed for seed in count() if seed not in used), n_seeds)
    has_own_scenes = len(group) > 1 and all(map(_draws_scene_by_seed, group))
    changes = [{"seed": seed, **({"dataset": {"seed": seed}} if has_own_scenes else {})} for seed in seeds]
    return [OmegaConf.merge(config, change) for change in changes]  # type: ignore[misc]


def _groups_of_seeds(runs: Sequence[Run]) -> list[list[Run]]:
    """Return groups of runs whose configurations differ only in seeds and keys without effect, in order of the first.

    Runs of different scenes are in one group if each scene has the seed of its run.
    """
    groups: dict[str, list[Run]] = {}
    for run in runs:
        same = {key: value for key, value in run.settings.items() if key not in ("seed", "dataset", *NO_EFFECT)}
        dataset = {key: value for key, value in _dataset(run).items() if key != "seed"}
        groups.setdefault(json.dumps([same, dataset], sort_keys=True, default=str), []).append(run)
    split: list[list[Run]] = []
    for group in groups.values():
        scenes = dict.fromkeys(_dataset(run).get("seed") for run in group)
        together = len(scenes) == 1 or all(map(_draws_scene_by_seed, group))
        split += [group] if together else [[r for r in group if _dataset(r).get("seed") == each] for each in scenes]
    return split


def _dataset(run: Run) -> Mapping[str, Any]:
    return run.settings.get("dataset") or {}


def _draws_scene_by_seed(run: Run) -> bool:
    """Return whether the seed of the scene is that of the run."""
    return "seed" in _dataset(run) and bool(_dataset(run)["seed"] == run.settings.get("seed", 0))


def rerun(was: Run, config: DictConfig, folder: Path) -> Run:
    """Run a stored configuration in `folder` and return the new recording; raises _RunError where it crashes."""
    try:
        execute(config, str(was.provenance.get("experiment", "custom")), folder, quiet=True)
        return read(folder / RECORDING)
    except Exception as error:  # noqa: BLE001 (the check continues after any error of a run, and names it)
        raise _RunError(" ".join(f"{type(error).__name__}: {error}".split())) from None


def renew(checks: Sequence[Check], reason: str | None) -> int:
    """Replace recordings by their new runs and return the exit code; refused and crashed ones stay.

    Unchanged condensed recordings stay byte for byte, since every version takes space in the repository. reason:
    written to the file _REASONS next to the recordings whose numbers changed.
    """
    renewed = []
    for check in checks:
        if check.was is None or check.now is None:
            why = check.findings[0].detail if check.refused is None else check.refused
            print(f"{check.name}: is unchanged: {why}", file=sys.stderr)
            continue
        if moved := any(map(has_moved, check.findings)):
            renewed.append(check.was.path)
        if moved or not (same_environment(check.was, check.now) and is_condensed(check.was)):
            with whole_file(check.was.path) as part:
                condense(check.now, part)
    if reason is not None:
        _write_reason(renewed, reason)
    if any(check.refused is not None for check in checks):
        return 2
    return 1 if any(check.now is None for check in checks) else 0


def _write_reason(renewed: Sequence[Path], reason: str) -> None:
    """Add a line to _REASONS in every folder of these recordings: the date, their names, and the reason."""
    for folder in sorted({path.parent for path in renewed}):
        file, names = folder / _REASONS, sorted(path.stem for path in renewed if path.parent == folder)
        before = file.read_text(encoding="utf-8") if file.is_file() else "# Why these recordings were renewed\n\n"
        with whole_file(file) as part:
            line = f"- {date.today()}: {', '.join(names)}: {' '.join(reason.split())}\n"
            part.write_text(before + line, encoding="utf-8")
