"""Names of the files in a run's folder, and its summary."""

import json
from pathlib import Path
from typing import Any

RECORDING = "run.rrd"
PART = "run.rrd.part"
"""The recording while the run is at work, and what is kept of one that was interrupted or failed."""

RECORDING_SUFFIXES = (".rrd", ".rrd.part")
"""Of recordings of whatever name, complete or not."""

SUMMARY = "summary.json"
LOCK = ".lock"
"""Locked by the process at work in the folder; see `run_lock`."""

EARLIER = ".earlier"
"""Folder of the runs and attempts that the folder held before, hidden from readers of recordings."""


def read_summary(folder: Path) -> dict[str, Any] | None:
    """Read summary.json in a folder; None where there is none or it cannot be read."""
    try:
        summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return summary if isinstance(summary, dict) else None
