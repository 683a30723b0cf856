"""Recordings run again and compared with what they hold: one by one, or in groups of several seeds; and renewed."""

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import date
from itertools import count, islice
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf
from tqdm import tqdm

from workbench.experiment.config.stored import runnable
from workbench.experiment.run import execute
from workbench.recording.condense import condense, is_condensed
from workbench.recording.migrations import renamed_metrics
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
"""Next to recordings that are checked: by how much their numbers may move in another environment."""
_REASONS = "reasons.md"
"""Next to renewed recordings: why they were."""


@dataclass(frozen=True)
class Request:
    """How recordings are to be checked: overrides (key=value), today's top-level configuration, the folder of the new
    runs, and whether numbers must be identical."""

    overrides: Sequence[str]
    own: DictConfig
    folder: Path
    exact: bool = False

    def config(self, run: Run) -> DictConfig:
        """Return the configuration of a recording as it is to run; InputError as `runnable`."""
        return runnable(run, self.overrides, self.own)


class _RunError(Exception):
    """The error that ended a run."""

    @property
    def change(self) -> MetricChange:
        return MetricChange("run", None, None, "complete", False, f"crashed: {self}", Agreement.CHANGED)


def read_sound(paths: Sequence[Path]) -> tuple[list[Run], list[Check]]:
    """Return the recordings, and those that cannot be read."""
    runs, problems = open_sound_runs(*paths)
    return runs, [Check(str(problem.path), refused=problem.reason) for problem in problems]


def tolerances(run: Run, own: DictConfig) -> dict[str, Tolerance]:
    """Return by how much a run's numbers may move in another environment.

    Measured ones from `tolerances.json` next to the recording, which `python -m analysis.tolerances` writes; of other
    numbers those in the recorded configuration, or today's where it has none. Raises InputError for what is no
    tolerance.
    """
    stored: Any = run.settings.get("check", OmegaConf.to_container(own.check))
    try:
        usual = {name: Tolerance(**{key: float(value) for key, value in keys.items()}) for name, keys in stored.items()}
    except (AttributeError, TypeError, ValueError):
        raise InputError(f"{run.path}: check: expected absolute and relative for every metric, found others") from None
    path = run.path.parent / TOLERANCES
    if not path.is_file():
        return usual
    content: Any = parse_json(path, path.read_text(encoding="utf-8"))
    try:
        measured = content["tolerances"].get(run.path.stem, {})
        return usual | {
            str(name): Tolerance(absolute=float(value)) for name, value in renamed_metrics(measured).items()
        }
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
    """Run each recording again and compare; run k goes to `folder/00k`."""
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
    """Run groups of recordings that differ only in their seeds again and compare all numbers at once.

    n_seeds: runs of other seeds, whose numbers are compared as distributions; None: the complete recordings' own seeds,
    pair by pair.
    """
    checks, made = [], []
    chosen = runs if n_seeds is not None else [run for run in runs if run.status == "complete"]
    for k, group in enumerate(_same_but_for_seeds(chosen)):
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
    """Return the configurations of a group's runs: its own, or with the n smallest seeds that none of it has, as runs
    of the same seeds are no independent sample."""
    if n_seeds is None:
        if len(group) == 1:
            raise InputError("--paired: expected recordings of two seeds or more, found one")
        return [request.config(run) for run in group]
    used, config = {run.settings.get("seed", 0) for run in group}, request.config(group[0])
    seeds = islice((seed for seed in count() if seed not in used), n_seeds)
    return [OmegaConf.merge(config, {"seed": seed}) for seed in seeds]  # type: ignore[misc]


def _same_but_for_seeds(runs: Sequence[Run]) -> list[list[Run]]:
    """Group runs whose configurations differ only in the seed and what affects no number, in order of their first."""
    groups: dict[str, list[Run]] = {}
    for run in runs:
        same = {key: value for key, value in run.settings.items() if key not in ("seed", *NO_EFFECT)}
        groups.setdefault(json.dumps(same, sort_keys=True, default=str), []).append(run)
    return list(groups.values())


def rerun(was: Run, config: DictConfig, folder: Path) -> Run:
    """Run a stored configuration again in `folder` and return its recording; raises _RunError where it crashes."""
    try:
        execute(config, str(was.provenance.get("experiment", "custom")), folder, quiet=True)
        return read(folder / RECORDING)
    except Exception as error:  # noqa: BLE001 (whatever ends a run, the check goes on and names it)
        raise _RunError(" ".join(f"{type(error).__name__}: {error}".split())) from None


def renew(checks: Sequence[Check], reason: str | None) -> int:
    """Replace recordings by their new runs and return the exit code; what was refused or crashed stays.

    What came out the same and has no pictures stays byte for byte, as every version of a recording kept with the code
    takes room. reason: is kept in the file _REASONS next to the recordings whose numbers moved.
    """
    renewed = []
    for check in checks:
        if check.was is None or check.now is None:
            why = check.findings[0].detail if check.refused is None else check.refused
            print(f"{check.name}: stays as it is: {why}", file=sys.stderr)
            continue
        if moved := any(map(has_moved, check.findings)):
            renewed.append(check.was.path)
        if moved or not (same_environment(check.was, check.now) and is_condensed(check.was)):
            with whole_file(check.was.path) as part:
                condense(check.now, part)
    if reason is not None:
        _keep_reason(renewed, reason)
    if any(check.refused is not None for check in checks):
        return 2
    return 1 if any(check.now is None for check in checks) else 0


def _keep_reason(renewed: Sequence[Path], reason: str) -> None:
    """Add a line to _REASONS in every folder of these recordings: the date, their names, and the reason."""
    for folder in sorted({path.parent for path in renewed}):
        file, names = folder / _REASONS, sorted(path.stem for path in renewed if path.parent == folder)
        before = file.read_text(encoding="utf-8") if file.is_file() else "# Why these recordings were renewed\n\n"
        with whole_file(file) as part:
            line = f"- {date.today()}: {', '.join(names)}: {' '.join(reason.split())}\n"
            part.write_text(before + line, encoding="utf-8")
