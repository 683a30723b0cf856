"""Recordings run again and compared with what they hold: one by one, as distributions over seeds, in pairs of seeds."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from omegaconf import DictConfig
from tqdm import tqdm

from workbench.experiment.config.stored import runnable
from workbench.recording.read.crash_probe import open_sound_runs
from workbench.recording.read.reader import Run
from workbench.results.check.again import again, same_but_for_seeds, tolerances, with_other_seeds
from workbench.results.check.compare import Finding, compare, compare_seeds, demand_on
from workbench.results.check.outcome import Check
from workbench.results.check.paired import compare_paired
from workbench.utils.errors import InputError

ONE_SEED = "--paired: expected recordings of two seeds or more, found one"


@dataclass(frozen=True)
class Request:
    """What a check is to do. overrides: key=value. own: today's top level. folder: of the new runs. exact: ask for
    identical numbers."""

    overrides: Sequence[str]
    own: DictConfig
    folder: Path
    exact: bool = False

    def config(self, run: Run) -> DictConfig:
        """The configuration of a recording as it is to run; InputError as `runnable`."""
        return runnable(run, self.overrides, self.own)


def read_sound(paths: Sequence[Path]) -> tuple[list[Run], list[Check]]:
    """The recordings, and those that cannot be read."""
    runs, problems = open_sound_runs(*paths)
    return runs, [Check(str(problem.path), refused=problem.reason) for problem in problems]


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
        try:
            config = request.config(was)
        except InputError as error:
            yield Check(str(was.path), refused=str(error))
            continue
        now = again(was, config, request.folder / f"{k:03d}")
        if isinstance(now, Finding):
            yield Check(str(was.path), [now], was=was)
        else:
            yield check_two(str(was.path), was, now, request)


def check_seeds(runs: Sequence[Run], request: Request, n: int) -> list[Check]:
    """Compare groups of recordings that differ in their seeds with n runs of other seeds."""
    checks, groups = [], []
    for group in same_but_for_seeds(runs):
        try:
            groups.append((group, request.config(group[0])))
        except InputError as error:
            checks.append(Check(str(group[0].path), refused=str(error)))
    n_judged = sum(len(group[0].result) for group, _ in groups)
    for k, (group, config) in enumerate(groups):
        new = with_other_seeds(group, config, n, request.folder / f"{k:03d}")
        found = [new] if isinstance(new, Finding) else compare_seeds(group, new, n_judged)
        checks.append(Check(name_of(group), found))
    return checks


def check_paired(runs: Sequence[Run], request: Request) -> list[Check]:
    """Run groups of recordings that differ in their seeds again and judge the differences, all numbers at once."""
    checks, pairs = [], []
    for k, group in enumerate(same_but_for_seeds([run for run in runs if run.status == "complete"])):
        made = group_again(group, request, f"{k:03d}") if len(group) > 1 else ONE_SEED
        if isinstance(made, list):
            pairs.append((group, made))
        else:
            checks.append(_not_made(group, made))
    found = compare_paired(pairs)
    return checks + [Check(name_of(group), each) for (group, _), each in zip(pairs, found, strict=True)]


def group_again(group: Sequence[Run], request: Request, name: str) -> list[Run] | Finding | str:
    """Run every recording of a group again; what crashed, or why it cannot run, where one does not."""
    new: list[Run] = []
    try:
        for run in tqdm(group, unit="seed", disable=None):
            now = again(run, request.config(run), request.folder / name / str(len(new)))
            if isinstance(now, Finding):
                return now
            new.append(now)
    except InputError as error:
        return str(error)
    return new


def name_of(group: Sequence[Run]) -> str:
    """Name a group of recordings."""
    return str(group[0].path) + (f" and {len(group) - 1} more" if len(group) > 1 else "")


def _not_made(group: Sequence[Run], why: Finding | str) -> Check:
    return Check(name_of(group), [why]) if isinstance(why, Finding) else Check(name_of(group), refused=why)
