"""Runs that differ in nothing but their seed, grouped; and what is wrong with them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from workbench.errors import InputError
from workbench.recording.read.reader import Run, Unreadable
from workbench.report import variation as varied
from workbench.report.variation import EXPERIMENT, Settings, Variation

STATUS = {"failed": "failed", "running": "cut off or still running"}


@dataclass(frozen=True, eq=False)
class Group:
    """Runs with equal settings. label: how they differ from the other groups'.

    values: of the keys that varied, as far as it has them. settings: all of them. runs: those complete, by seed, one
    each. incomplete: the others. repeats: complete ones of a seed that is there already, left out. missing: seeds that
    other groups have.
    """

    label: str
    values: Settings
    settings: Settings
    runs: tuple[Run, ...]
    incomplete: tuple[Run, ...] = ()
    repeats: tuple[Run, ...] = ()
    missing: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class Grouping:
    """All groups, in the order of their values, and the recordings that could not be read."""

    groups: tuple[Group, ...]
    variation: Variation
    unreadable: tuple[Unreadable, ...] = ()

    @property
    def runs(self) -> tuple[Run, ...]:
        """Select those complete, group by group."""
        return tuple(run for group in self.groups for run in group.runs)

    @property
    def problems(self) -> tuple[str, ...]:
        """Tell what is wrong, a sentence each: failed, cut off, repeated, missing and unreadable runs."""
        found = []
        for group in self.groups:
            for run in group.incomplete:
                again = "; a complete one is there" if seed_of(run) in map(seed_of, group.runs) else ""
                status = STATUS.get(run.status, run.status)
                found.append(f"{group.label}, seed {seed_of(run)}: {status}, not counted{again} ({run.path})")
            found += [
                f"{group.label}, seed {seed_of(run)}: recorded more than once, not counted again ({run.path})"
                for run in group.repeats
            ]
            if group.missing:
                seeds = ", ".join(map(str, group.missing))
                found.append(f"{group.label}: no recording of seed {seeds}, which other groups have")
        return (*found, *(f"not a recording that can be read: {problem.reason}" for problem in self.unreadable))


def seed_of(run: Run) -> int:
    """Return the run's seed; raises InputError when its configuration has none."""
    seed = run.settings.get("seed")
    if not isinstance(seed, int):
        raise InputError(f"{run.path}: expected a configuration with a whole number as its seed, found {seed!r}")
    return seed


def group_runs(runs: Sequence[Run], unreadable: Sequence[Unreadable] = ()) -> Grouping:
    """Group the runs by what varied in their configurations; one without a readable one joins the unreadable."""
    readable: list[tuple[Run, dict[str, Any]]] = []
    problems = list(unreadable)
    for run in runs:
        try:
            seed_of(run)
            readable.append((run, varied.flat(run.settings, str(run.provenance.get(EXPERIMENT, "")))))
        except InputError as error:
            problems.append(Unreadable(Path(run.path), str(error)))
    repeated = varied.seeds_of_parts([settings for _, settings in readable], [seed_of(run) for run, _ in readable])
    readable = [(run, {k: v for k, v in settings.items() if k not in repeated}) for run, settings in readable]
    variation = varied.what_varied([settings for _, settings in readable])
    members: dict[tuple[str, ...], list[tuple[Run, dict[str, Any]]]] = {}
    for run, settings in readable:
        values = tuple(varied.comparable(settings, key) for key in variation.keys)
        members.setdefault(values, []).append((run, settings))
    seeds = {seed_of(run) for run, _ in readable}
    groups = [_group([run for run, _ in found], found[0][1], variation, seeds) for found in members.values()]
    groups.sort(key=lambda group: [_rank(group, key) for key in variation.keys])
    return Grouping(tuple(groups), variation, tuple(problems))


def _group(runs: Sequence[Run], settings: Settings, variation: Variation, seeds: set[int]) -> Group:
    complete: dict[int, Run] = {}
    repeats: list[Run] = []
    for run in sorted(runs, key=lambda run: str(run.properties["run"].get("id", "")), reverse=True):
        if run.status == "complete" and complete.setdefault(seed_of(run), run) is not run:
            repeats.append(run)
    return Group(
        label=varied.label(variation.keys, settings) or str(settings[EXPERIMENT]) or "all runs",
        values={key: settings[key] for key in variation.keys if key in settings},
        settings=settings,
        runs=tuple(complete[seed] for seed in sorted(complete)),
        incomplete=tuple(run for run in runs if run.status != "complete"),
        repeats=tuple(repeats),
        missing=tuple(sorted(seeds - set(map(seed_of, runs)))),
    )


def _rank(group: Group, key: str) -> tuple[int, float, str]:
    """Numbers by size, then text by the alphabet, then groups without the key."""
    if key not in group.values:
        return 2, 0.0, ""
    value = group.values[key]
    return (0, float(value), "") if isinstance(value, int | float) else (1, 0.0, varied.shown(key, value))
