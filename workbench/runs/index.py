"""Every run below a folder, quickly: what was read once is kept in a file there and read again only when it changed."""

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from workbench import __version__
from workbench.errors import InputError
from workbench.files import whole_file
from workbench.runs.entry import SUMMARY, Entry, entry_of_folder, entry_of_recording

INDEX = ".runs.json"
"""May be deleted at any time."""
_SUFFIXES = (".rrd", ".rrd.part")


def entries(*places: Path) -> list[Entry]:
    """The runs at and below these places, folders or recordings, newest first; each once.

    Raises InputError for a place that does not exist.
    """
    found: dict[str, Entry] = {}
    for place in places:
        if not place.exists():
            raise InputError(f"{place}: expected a folder of runs or a recording, found nothing there")
        known = _below(place) if place.is_dir() else [entry_of_recording(place)]
        found |= {entry.path: entry for entry in known}
    return sorted(found.values(), key=lambda entry: (entry.started, entry.path), reverse=True)


def _below(root: Path) -> list[Entry]:
    """The runs below a folder, by its index, which is brought up to date."""
    kept, read = _kept(root), 0
    found: dict[str, Any] = {}
    told = []
    for path in runs_in(root):
        version = _version(path)
        name = str(path.relative_to(root))
        if (was := kept.get(name)) is not None and was["version"] == version and was["entry"]["status"] != "running":
            entry = Entry(**was["entry"])
        else:
            entry, read = (entry_of_folder(path) if path.is_dir() else entry_of_recording(path)), read + 1
        told.append(entry)
        found[name] = {"version": version, "entry": entry.plain}
    if (read or len(found) != len(kept)) and os.access(root, os.W_OK):
        with whole_file(root / INDEX) as part:
            part.write_text(json.dumps({"workbench": __version__, "root": str(root), "runs": found}))
    return told


def runs_in(root: Path) -> Iterator[Path]:
    """Find the folders of runs at and below `root`, and recordings that lie by themselves; links are not followed."""
    for folder, inner, files in os.walk(root):
        inner[:] = sorted(name for name in inner if not name.startswith("."))
        if SUMMARY in files:
            yield Path(folder)
        else:
            yield from (Path(folder, name) for name in sorted(files) if name.endswith(_SUFFIXES))


def _kept(root: Path) -> dict[str, Any]:
    """What the index says; nothing where it is of another place or version, cut off, or not there."""
    try:
        index = json.loads((root / INDEX).read_text(encoding="utf-8"))
        same = (index["workbench"], index["root"]) == (__version__, str(root))
        runs = index["runs"] if same else {}
        return {name: run for name, run in runs.items() if set(run["entry"]) <= _FIELDS and "version" in run}
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return {}


_FIELDS = set(Entry.__dataclass_fields__)


def _version(path: Path) -> list[int]:
    """Identify the version of a run's summary and recording, which changes whenever one is written."""
    files = [path] if path.is_file() else [path / name for name in (SUMMARY, "run.rrd", "run.rrd.part")]
    found = [file.stat() for file in files if file.is_file()]
    return [number for status in found for number in (status.st_size, status.st_mtime_ns)]
