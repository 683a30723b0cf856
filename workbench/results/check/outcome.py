"""Outcomes of checks: tables for a terminal, a file for a build server, an exit code."""

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

from workbench.evaluation.metrics import HEADLINE_ERRORS
from workbench.recording.read.reader import Run
from workbench.results.check.agreement import Agreement, Demand, MetricChange
from workbench.results.formatting import table_of, text
from workbench.utils.atomic_write import whole_file
from workbench.utils.environment import differing
from workbench.utils.text import printable

_COLUMNS = ("recording", "metric", "was", "is", "allowed", "outcome")


@dataclass(frozen=True, eq=False)
class Check:
    """The outcome of one recording's check.

    refused: why it was not checked, or None. was, now: the compared recordings, where there are two. demand: on their
    numbers, where they were compared one by one.
    """

    name: str
    findings: Sequence[MetricChange] = field(default_factory=tuple)
    refused: str | None = None
    was: Run | None = None
    now: Run | None = None
    demand: Demand | None = None

    @property
    def passed(self) -> bool:
        """Whether it was checked without a failure."""
        return self.refused is None and all(finding.passed for finding in self.findings)


def has_moved(finding: MetricChange) -> bool:
    """Return whether a number changed by more than rounding, is new, or failed."""
    return not finding.passed or finding.agreement is None or finding.agreement > Agreement.ROUNDING


def exit_code(checks: Sequence[Check]) -> int:
    """Return 2 if a recording was refused, else 1 if anything failed, else 0."""
    if any(check.refused is not None for check in checks):
        return 2
    return 0 if all(check.passed for check in checks) else 1


def table(checks: Sequence[Check], verbose: bool = False) -> str:
    """Return a row for every failed number, and one for every passed recording; verbose: for every number."""
    return text(table_of(_COLUMNS, (row for check in checks for row in _rows(check, verbose))))


def moved(checks: Sequence[Check]) -> str:
    """Return a row for every changed number."""
    rows = [(check.name, *_cells(finding)) for check in checks for finding in check.findings if has_moved(finding)]
    return text(table_of(_COLUMNS, rows)) if rows else "nothing moved"


def notes(checks: Sequence[Check]) -> list[str]:
    """Return notes on recordings of other environments: the differences, and changes that tolerances hide."""
    groups: dict[str, list[tuple[Demand, Run]]] = {}
    for check in checks:
        if check.demand and check.was and check.now and check.demand.agreement is Agreement.TOLERANCE:
            groups.setdefault(_difference(check.was, check.now), []).append((check.demand, check.was))
    lines = []
    for difference, group in groups.items():
        lines.append(f"{len(group)} of {len(checks)} were recorded in another environment: {difference}.")
        lines.append(f"Their numbers may change within tolerances; undetectable changes: {_undetectable(group)}.")
    return [*lines, "--against REV compares two commits on this machine to rounding."] if lines else []


def _difference(was: Run, now: Run) -> str:
    if not was.environment:
        return "no environment was recorded"
    changes = differing(was.environment, now.environment)
    return "; ".join(f"{name} {old} → {new}" for name, (old, new) in changes.items())


def _undetectable(group: Sequence[tuple[Demand, Run]]) -> str:
    """Return the largest relative changes of the headline errors within tolerances, in words."""
    words = []
    for name in HEADLINE_ERRORS:
        percents = []
        for demand, was in group:
            if (tolerance := demand.of(name)) is not None and (value := was.result.get(name)):
                percents.append(100 * max(tolerance.absolute / abs(value), tolerance.relative))
        if percents:
            words.append(f"{name} by up to {median(percents):.2g} % in half of them, {max(percents):.2g} % in all")
    return "; ".join(words) or "those within the tolerance of each number"


def write_junit(path: Path, checks: Sequence[Check]) -> None:
    """Write a JUnit test suite with a test case for every number; raises InputError where it cannot be written."""
    cases = [(check, finding) for check in checks for finding in check.findings]
    failures = sum(not finding.passed for _, finding in cases)
    refused = [check for check in checks if check.refused is not None]
    counts = {"tests": str(len(cases) + len(refused)), "failures": str(failures), "errors": str(len(refused))}
    suite = ET.Element("testsuite", {"name": "workbench check", **counts})
    for check, finding in cases:
        names = {"classname": printable(check.name), "name": printable(finding.quantity)}
        case = ET.SubElement(suite, "testcase", names)
        if not finding.passed:
            was, now, allowed, outcome = map(printable, _cells(finding)[1:])
            ET.SubElement(case, "failure", {"message": f"was {was}, is {now}, allowed {allowed}: {outcome}"})
    for check in refused:
        case = ET.SubElement(suite, "testcase", {"classname": printable(check.name), "name": "recording"})
        ET.SubElement(case, "error", {"message": printable(check.refused or "")})
    with whole_file(path) as part:
        ET.ElementTree(suite).write(part, encoding="utf-8", xml_declaration=True)


def _rows(check: Check, verbose: bool) -> list[tuple[str, ...]]:
    if check.refused is not None:
        return [(check.name, "", "", "", "", f"REFUSED {check.refused}")]
    if check.passed and not verbose:
        allowed = {finding.allowed for finding in check.findings} - {"identical"} or {"identical"}
        counts = Counter(str(each.agreement) for each in check.findings if each.agreement is not None)
        classes = ", ".join(f"{counts[name]} {name}" for name in map(str, Agreement) if counts[name])
        words = allowed.pop() if len(allowed) == 1 else "by metric"
        return [(check.name, f"all {len(check.findings)}", "", "", words, f"ok {classes}".rstrip())]
    return [(check.name, *_cells(finding)) for finding in check.findings if verbose or not finding.passed]


def _cells(finding: MetricChange) -> tuple[str, ...]:
    was, now = ("" if value is None else f"{value:.6g}" for value in (finding.was, finding.now))
    if was == now and finding.was != finding.now:
        was, now = f"{finding.was:.17g}", f"{finding.now:.17g}"
    outcome = "ok" if finding.passed else "FAILED"
    words = [outcome, "" if finding.agreement is None else f"({finding.agreement})", finding.detail]
    return finding.quantity, was, now, finding.allowed, " ".join(filter(None, words))
