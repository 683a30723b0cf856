"""What checks of recordings came to: tables for a terminal, a file for a build server, an exit code."""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from workbench.files import whole_file
from workbench.recording.compare.compare import Finding
from workbench.recording.read.reader import Run
from workbench.report.tables import Table, printable, text

_COLUMNS = ("recording", "metric", "was", "is", "tolerance", "verdict")
_NUMBERS = frozenset(("was", "is"))


@dataclass(frozen=True, eq=False)
class Check:
    """One recording's outcome.

    refused: why it was not checked, where it was not. was, now: what was compared, where there are two recordings.
    """

    name: str
    findings: Sequence[Finding] = field(default_factory=tuple)
    refused: str | None = None
    was: Run | None = None
    now: Run | None = None

    @property
    def passed(self) -> bool:
        """Tell whether it was checked and nothing in it failed."""
        return self.refused is None and all(finding.passed for finding in self.findings)

    @property
    def unmoved(self) -> bool:
        """Tell whether it passed and every number is what it was."""
        return self.passed and not any(map(has_moved, self.findings))


def has_moved(finding: Finding) -> bool:
    """Tell whether a number is not what it was, or failed."""
    return finding.was != finding.now or not finding.passed


def exit_code(checks: Iterable[Check]) -> int:
    """2 when a recording was refused, else 1 when anything failed, else 0."""
    checks = list(checks)
    if any(check.refused is not None for check in checks):
        return 2
    return 0 if all(check.passed for check in checks) else 1


def table(checks: Sequence[Check], verbose: bool = False) -> str:
    """A row for every number that failed, and one for every recording that passed; verbose: for every number."""
    return text(Table(_COLUMNS, tuple(row for check in checks for row in _rows(check, verbose)), _NUMBERS))


def moved(checks: Sequence[Check]) -> str:
    """A row for every number that is not what it was."""
    rows = tuple((check.name, *_cells(finding)) for check in checks for finding in check.findings if has_moved(finding))
    return text(Table(_COLUMNS, rows, _NUMBERS)) if rows else "nothing moved"


def write_junit(path: Path, checks: Sequence[Check]) -> None:
    """A test suite with one test case for every number. Raises InputError when the file cannot be written."""
    cases = [(check, finding) for check in checks for finding in check.findings]
    failures = sum(not finding.passed for _, finding in cases)
    refused = [check for check in checks if check.refused is not None]
    counts = {"tests": str(len(cases) + len(refused)), "failures": str(failures), "errors": str(len(refused))}
    suite = ET.Element("testsuite", {"name": "workbench-check", **counts})
    for check, finding in cases:
        names = {"classname": printable(check.name), "name": printable(finding.quantity)}
        case = ET.SubElement(suite, "testcase", names)
        if not finding.passed:
            was, now, tolerance, verdict = map(printable, _cells(finding)[1:])
            ET.SubElement(case, "failure", {"message": f"was {was}, is {now}, tolerance {tolerance}: {verdict}"})
    for check in refused:
        case = ET.SubElement(suite, "testcase", {"classname": printable(check.name), "name": "recording"})
        ET.SubElement(case, "error", {"message": printable(check.refused or "")})
    with whole_file(path) as part:
        ET.ElementTree(suite).write(part, encoding="utf-8", xml_declaration=True)


def _rows(check: Check, verbose: bool) -> list[tuple[str, ...]]:
    if check.refused is not None:
        return [(check.name, "", "", "", "", f"REFUSED {check.refused}")]
    if check.passed and not verbose:
        tolerances = {finding.tolerance for finding in check.findings}
        tolerance = tolerances.pop() if len(tolerances) == 1 else "by metric"
        return [(check.name, f"all {len(check.findings)}", "", "", tolerance, "ok")]
    return [(check.name, *_cells(finding)) for finding in check.findings if verbose or not finding.passed]


def _cells(finding: Finding) -> tuple[str, ...]:
    was, now = ("" if value is None else f"{value:.6g}" for value in (finding.was, finding.now))
    verdict = "ok" if finding.passed else "FAILED"
    return finding.quantity, was, now, finding.tolerance, f"{verdict} {finding.detail}".rstrip()
