"""Recordings that are renewed: what a check ran goes in their place, and the reason beside them."""

import sys
from collections.abc import Sequence
from datetime import date
from pathlib import Path

from workbench.recording.condense import condense, is_condensed
from workbench.results.check.compare import same_environment
from workbench.results.check.outcome import Check, has_moved
from workbench.utils.atomic_write import whole_file

REASONS = "reasons.md"
"""Beside renewed recordings: why they were."""


def renew(checks: Sequence[Check], why: str | None) -> int:
    """Put what the runs came to in place of the recordings; the exit code. What was refused or crashed stays.

    So does, byte for byte, what came out the same and has no pictures: a recording kept with the code costs room in
    every version of it. why: goes into the file REASONS beside those whose numbers moved.
    """
    for check in checks:
        if check.refused is not None:
            print(f"{check.name}: stays as it is: {check.refused}", file=sys.stderr)
        elif check.was is None or check.now is None:
            print(f"{check.name}: stays as it is: {check.findings[0].detail}", file=sys.stderr)
        elif not (check.unmoved and same_environment(check.was, check.now) and is_condensed(check.was)):
            with whole_file(check.was.path) as part:
                condense(check.now, part)
    if why is not None:
        _keep_reason([check for check in checks if check.now is not None and any(map(has_moved, check.findings))], why)
    if any(check.refused is not None for check in checks):
        return 2
    return 1 if any(check.now is None for check in checks) else 0


def _keep_reason(moved: Sequence[Check], why: str) -> None:
    """Add a line to REASONS in every folder of the recordings whose numbers moved: the date, their names, and why."""
    names: dict[Path, list[str]] = {}
    for check in moved:
        if check.was is not None:
            names.setdefault(check.was.path.parent, []).append(check.was.path.stem)
    for folder, renewed in names.items():
        file = folder / REASONS
        before = file.read_text(encoding="utf-8") if file.is_file() else "# Why these recordings were renewed\n\n"
        with whole_file(file) as part:
            line = f"- {date.today()}: {', '.join(sorted(renewed))}: {' '.join(why.split())}\n"
            part.write_text(before + line, encoding="utf-8")
