"""Today's code against other code on equal seeds: until it is decided, over commits, or to measure tolerances."""

import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np
from tqdm import tqdm

from workbench.errors import InputError
from workbench.experiment.checking import Request, name_of
from workbench.experiment.other_code import commits_between, other_code, resolved, run_by, subject
from workbench.experiment.stored import again, same_but_for_seeds
from workbench.recording.compare.bisect import Values, first_moved
from workbench.recording.compare.calibrate import measured
from workbench.recording.compare.compare import Finding, Tolerance
from workbench.recording.compare.paired import LEVEL
from workbench.recording.compare.until import Verdict, judge
from workbench.recording.read.reader import Run
from workbench.report.checks import Check

MOST_PAIRS = 64
LEADING = {"mm": "error_abs_mm", "px": "error_px"}
"""The number of which --until decides, by unit."""


def check_until(runs: Sequence[Run], request: Request, limit: str) -> list[Check]:
    """Run pairs of seeds of each group, by the recorded code and by today's, until it is decided.

    limit: such as 1mm or 0.5px: what LEADING may change by. The recorded seeds come first; for others, the recorded
    commit runs too. Ends after MOST_PAIRS. Raises InputError for a limit that is none, or without a commit to run.
    """
    if not (match := re.fullmatch(r"(\d+(?:\.\d*)?)\s*(mm|px)", limit)) or float(match[1]) <= 0.0:
        raise InputError(f"--until: expected millimetres or pixels such as 1mm or 0.5px, found {limit!r}")
    groups = same_but_for_seeds([run for run in runs if run.status == "complete"])
    judged = partial(judge, leading=LEADING[match[2]], limit=float(match[1]), level=LEVEL / max(len(groups), 1))
    return [_until(group, request.below(f"{k:03d}"), judged) for k, group in enumerate(groups)]


def _until(
    group: Sequence[Run],
    request: Request,
    judged: Callable[[Sequence[Run], Sequence[Run]], tuple[Verdict, list[Finding]]],
) -> Check:
    was: list[Run] = []
    now: list[Run] = []
    findings: Sequence[Finding] = ()
    with ExitStack() as stack, tqdm(total=MOST_PAIRS, unit="pair", disable=None) as bar:
        for old, new in _pairs(group, request, stack):
            if isinstance(new, Finding):
                return Check(name_of(group), [new])
            was, now = [*was, old], [*now, new]
            verdict, findings = judged(was, now)
            bar.update()
            if verdict is not Verdict.OPEN or len(was) == MOST_PAIRS:
                break
    return Check(f"{name_of(group)}: {verdict.value} after {len(was)} pairs", findings)


def _pairs(group: Sequence[Run], request: Request, stack: ExitStack) -> Iterator[tuple[Run, Run | Finding]]:
    """The recorded seeds in their order, then the smallest that none of them has."""
    for k, run in enumerate(group):
        yield run, again(run, request.config(run), request.folder / f"now{k}")
    code, taken = None, {run.settings.get("seed", 0) for run in group}
    for seed in (seed for seed in count() if seed not in taken):
        code = code or stack.enter_context(other_code())(_recorded_commit(group[0]))
        places = [text for text in request.overrides if text.startswith("paths.")]
        (old,) = run_by([group[0].path], [*places, f"seed={seed}"], request.folder / f"was_of_{seed}", code)
        yield old, again(old, request.config(old), request.folder / f"now_of_{seed}")


def _recorded_commit(run: Run) -> str:
    commit = str(run.provenance.get("commit", ""))
    if not re.fullmatch("[0-9a-f]{40}", commit) or run.provenance.get("changed") != "no":
        raise InputError(
            f"{run.path}: --until needs more pairs than are recorded: record more seeds, as this was not recorded by "
            "the code of a commit, which could run them"
        )
    return resolved(commit)


def check_commits(runs: Sequence[Run], request: Request, span: str) -> list[Check]:
    """Say which commit of GOOD..BAD moved which number of each group of recordings that differ in their seeds."""
    good, *commits = commits_between(span)
    groups = enumerate(same_but_for_seeds(runs))
    with other_code() as check_out:
        return [_moved(group, request.below(f"{k:03d}"), good, commits, check_out) for k, group in groups]


def _moved(
    group: Sequence[Run], request: Request, good: str, commits: Sequence[str], check_out: Callable[[str], Path]
) -> Check:
    def values(commit: str) -> Values:
        print(f"{name_of(group)}: by {subject(commit)}", file=sys.stderr)
        folder = request.folder / commit
        made = run_by([run.path for run in group], request.overrides, folder, check_out(commit))
        names = set.intersection(*(set(run.result) for run in made))
        return {name: np.array([run.result[name] for run in made]) for name in sorted(names)}

    findings = [
        Finding(each.name, each.was, each.now, "exact" if each.exact else "paired", False, subject(each.commit))
        for each in first_moved(commits, values(good), values)
    ]
    return Check(name_of(group) + ("" if findings else ": nothing moved"), findings)


def measure_tolerances(runs: Sequence[Run], request: Request, python: str | None) -> dict[str, Tolerance]:
    """Run recordings again on one thread and on all, or by another interpreter; by how much numbers may move.

    Raises InputError where a recording does not run, or there are fewer than two pairs.
    """
    pairs: list[tuple[Run, Run]] = []
    if python is not None:
        made = run_by([run.path for run in runs], request.overrides, request.folder, python=python)
        pairs += zip(runs, made, strict=True)
    for k, run in enumerate(tqdm(runs, unit="recording", disable=None) if python is None else ()):
        for threads in (1, None):
            config = request.config(run)
            config.threads = threads
            new = again(run, config, request.folder / f"{k:03d}" / str(threads or "all"))
            if isinstance(new, Finding):
                raise InputError(f"{run.path}: {new.detail}")
            pairs.append((run, new))
    if len(pairs) < 2:
        raise InputError("--calibrate: expected two pairs of runs or more, found one; give more recordings")
    return measured(pairs)
