"""What a check comes to: the table for people, JUnit's XML for machines."""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from workbench.files import whole_file
from workbench.recording.compare import Finding
from workbench.recording.reader import Run

_COLUMNS = ("recording", "metric", "was", "is", "tolerance", "verdict")
_NUMBERS = (2, 3)


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
        """Whether it was checked and nothing in it failed."""
        return self.refused is None and all(finding.passed for finding in self.findings)

    @property
    def unmoved(self) -> bool:
        """Whether it passed and every number is what it was."""
        return self.passed and not any(map(_moved, self.findings))


def exit_code(checks: Iterable[Check]) -> int:
    """2 when a recording was refused, else 1 when anything failed, else 0."""
    checks = list(checks)
    if any(check.refused is not None for check in checks):
        return 2
    return 0 if all(check.passed for check in checks) else 1


def table(checks: Sequence[Check], verbose: bool = False) -> str:
    """A row for every number that failed, and one for every recording that passed; verbose: for every number."""
    rows = [row for check in checks for row in _rows(check, verbose)]
    return _aligned([_COLUMNS, *rows])


def moved(checks: Sequence[Check]) -> str:
    """A row for every number that is not what it was."""
    changed = [(check.name, *_cells(finding)) for check in checks for finding in check.findings if _moved(finding)]
    return _aligned([_COLUMNS, *changed]) if changed else "nothing moved"


def _moved(finding: Finding) -> bool:
    return finding.was != finding.now or not finding.passed


def write_junit(path: Path, checks: Sequence[Check]) -> None:
    """A test suite with one test case for every number. Raises InputError when the file cannot be written."""
    cases = [(check, finding) for check in checks for finding in check.findings]
    failures = sum(not finding.passed for _, finding in cases)
    refused = [check for check in checks if check.refused is not None]
    counts = {"tests": str(len(cases) + len(refused)), "failures": str(failures), "errors": str(len(refused))}
    suite = ET.Element("testsuite", {"name": "workbench-check", **counts})
    for check, finding in cases:
        names = {"classname": _printable(check.name), "name": _printable(finding.quantity)}
        case = ET.SubElement(suite, "testcase", names)
        if not finding.passed:
            _, was, now, tolerance, verdict = _printables(("", *_cells(finding)[1:]))
            ET.SubElement(case, "failure", {"message": f"was {was}, is {now}, tolerance {tolerance}: {verdict}"})
    for check in refused:
        case = ET.SubElement(suite, "testcase", {"classname": _printable(check.name), "name": "recording"})
        ET.SubElement(case, "error", {"message": _printable(check.refused or "")})
    with whole_file(path) as part:
        ET.ElementTree(suite).write(part, encoding="utf-8", xml_declaration=True)


def _rows(check: Check, verbose: bool) -> list[tuple[str, ...]]:
    if check.refused is not None:
        return [(check.name, "", "", "", "", f"REFUSED {check.refused}")]
    if check.passed and not verbose:
        tolerances = {finding.tolerance for finding in check.findings}
        text = tolerances.pop() if len(tolerances) == 1 else "by metric"
        return [(check.name, f"all {len(check.findings)}", "", "", text, "ok")]
    return [(check.name, *_cells(finding)) for finding in check.findings if verbose or not finding.passed]


def _cells(finding: Finding) -> tuple[str, ...]:
    was, now = ("" if value is None else f"{value:.6g}" for value in (finding.was, finding.now))
    verdict = "ok" if finding.passed else "FAILED"
    return finding.quantity, was, now, finding.tolerance, f"{verdict} {finding.detail}".rstrip()


def _aligned(rows: Sequence[Sequence[str]]) -> str:
    """Columns of one width; numbers to the right."""
    columns = [_printables(column) for column in zip(*rows, strict=True)]
    for k, column in enumerate(columns):
        width = max(map(len, column))
        columns[k] = [cell.rjust(width) if k in _NUMBERS else cell.ljust(width) for cell in column]
    return "\n".join("  ".join(row).rstrip() for row in zip(*columns, strict=True))


def _printables(row: Iterable[str]) -> list[str]:
    return [_printable(cell) for cell in row]


def _printable(text: str) -> str:
    """In one line and without control characters, which names in a stranger's recording may hold."""
    return "".join(letter if letter.isprintable() else " " for letter in text)
