"""Names of the files in a run's folder, and its summary."""

import json
from pathlib import Path
from typing import Any

from workbench.utils.input_limits import check_file

RECORDING = "run.rrd"
PART = "run.rrd.part"
"""Recording of a running, interrupted or failed run."""

RECORDING_SUFFIXES = (".rrd", ".rrd.part")
"""Suffixes of complete and partial recordings."""

SUMMARY = "summary.json"
_MAX_SUMMARY = 10_000_000  # bytes
OVERLAY = "overlay.mp4"
"""Video of a run of `workbench track`, with the skeleton over the images; of several cameras overlay_CAMERA.mp4."""

LOCK = ".lock"
"""File locked by the process that uses the folder; see `run_lock`."""

EARLIER = ".earlier"
"""Folder of earlier complete runs, hidden from readers of recordings."""


def summary_text(folder: Path) -> str:
    """Return the text of summary.json in a folder; raises OSError if it is missing, InputError for another file."""
    path = folder / SUMMARY
    path.stat()
    check_file(path, _MAX_SUMMARY)
    return path.read_text(encoding="utf-8")


def read_summary(folder: Path) -> dict[str, Any] | None:
    """Return the content of summary.json in a folder; None if it is missing or unreadable."""
    try:
        summary = json.loads(summary_text(folder))
    except (OSError, ValueError, RecursionError):
        return None
    return summary if isinstance(summary, dict) else None
