"""Runs that are complete already, whatever their number: found by their identity, taken over by a link, never lost."""

import json
import os
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from workbench.utils.atomic_write import whole_file
from workbench.utils.run_files import RECORDING, SUMMARY

ASIDE = ".aside"
"""Where in a sweep's folder a job's run waits whose number now belongs to another."""


def read_summary(folder: Path) -> dict[str, Any] | None:
    """Read summary.json in a folder; None where there is none or it cannot be read."""
    try:
        summary = json.loads((folder / SUMMARY).read_text())
    except (OSError, ValueError):
        return None
    return summary if isinstance(summary, dict) else None


def take_over(identity: str, folder: Path, places: Sequence[Path]) -> bool:
    """Put a complete run of this identity, if any of the places holds one, into `folder`; tells whether it did.

    The recording is linked where the file system allows that, else copied; its summary says where it is from.
    """
    for source in _runs(places):
        summary = read_summary(source) or {}
        if source == folder or (summary.get("status"), summary.get("identity")) != ("complete", identity):
            continue
        if _linked(source / RECORDING, folder / RECORDING):
            with whole_file(folder / SUMMARY) as part:
                part.write_text(json.dumps({**summary, "taken_from": str(source)}, indent=2) + "\n")
            if source.parent.name == ASIDE:
                shutil.rmtree(source, ignore_errors=True)  # another sweep may take it over, too
            return True
    return False


def set_aside(folder: Path) -> None:
    """Move a complete run out of the way of another that is to have its folder, where `take_over` finds it."""
    summary = read_summary(folder) or {}
    if summary.get("status") != "complete" or not (folder / RECORDING).is_file():
        return
    target = folder.parent / ASIDE / str(summary.get("identity"))
    target.mkdir(parents=True, exist_ok=True)
    for name in (RECORDING, SUMMARY):
        os.replace(folder / name, target / name)


def left_aside(folder: Path) -> int:
    """Count the runs of an earlier sweep in this folder that are none of its jobs any more."""
    return len(list((folder / ASIDE).glob(f"*/{SUMMARY}")))


def _runs(places: Sequence[Path]) -> Iterator[Path]:
    """The folders of runs in the places, those set aside last, as they may have just been."""
    for place in places:
        for folder in (place, place / ASIDE):
            if folder.is_dir():
                yield from (Path(each) for each in sorted(each.path for each in os.scandir(folder) if each.is_dir()))


def _linked(source: Path, target: Path) -> bool:
    """Link a recording, or copy it; False where another process has just set it aside or removed it."""
    part = target.with_name(f"{target.name}.{os.getpid()}.part")
    try:
        try:
            os.link(source, part)
        except OSError:  # on another file system, or one without links
            shutil.copyfile(source, part)
        os.replace(part, target)
    except FileNotFoundError:
        return False
    finally:
        part.unlink(missing_ok=True)
    return True
