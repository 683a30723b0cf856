"""Which commit moved which number: halving, exact where bits are equal, by paired seeds where they are not."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.arrays import FloatArray
from workbench.recording.compare.paired import LEVEL, differences, holm, p_of_mean

Values = Mapping[str, FloatArray]
"""A commit's numbers, each (n,) of n seeds."""


@dataclass(frozen=True)
class Moved:
    """A number that moved.

    commit: with which. was, now: its mean at the ends. exact: whether bits told, at every step.
    """

    name: str
    commit: str
    was: float
    now: float
    exact: bool


def first_moved(commits: Sequence[str], good: Values, values: Callable[[str], Values]) -> list[Moved]:
    """For every number that differs between `good` and the last of the commits, the first commit that has the new one.

    commits: after the good one, oldest first. values: runs a commit; asked once for each that is needed, of 2ᵏ commits
    for k of those between, where one moved them all. Numbers count as moved where `moved_names` says so.
    """
    known: dict[str, Values] = {}

    def at(commit: str) -> Values:
        if commit not in known:
            known[commit] = values(commit)
        return known[commit]

    bad = at(commits[-1])
    return [_search(name, commits, good[name], bad[name], at) for name in moved_names(good, bad)]


def moved_names(good: Values, bad: Values) -> list[str]:
    """The numbers of two commits that differ on equal seeds: of one by more than rounding, of more by Holm's test."""
    names = [name for name in good if name in bad]
    d = {name: differences(good[name], bad[name]) for name in names}
    if all(len(each) < 2 for each in d.values()):
        return [name for name in names if d[name].any()]
    refused = holm(np.array([p_of_mean(d[name]) for name in names]), LEVEL)
    return [name for name, yes in zip(names, refused, strict=True) if yes]


def _search(name: str, commits: Sequence[str], good: FloatArray, bad: FloatArray, at: Callable[[str], Values]) -> Moved:
    low, high, exact = -1, len(commits) - 1, True  # the good one, and the first that is known to be bad
    while high - low > 1:
        middle = (low + high) // 2
        is_bad, by_bits = _side(at(commits[middle]).get(name), good, bad)
        low, high, exact = (low, middle, exact and by_bits) if is_bad else (middle, high, exact and by_bits)
    return Moved(name, commits[high], float(good.mean()), float(bad.mean()), exact)


def _side(values: FloatArray | None, good: FloatArray, bad: FloatArray) -> tuple[bool, bool]:
    """Whether a commit's number is the bad one, and whether its bits say so; where it is missing, it is bad."""
    if values is None or not differences(bad, values).any():
        return True, True
    if not differences(good, values).any():
        return False, True
    return bool(abs((values - bad).mean()) < abs((values - good).mean())), False
