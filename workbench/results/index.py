"""Every run below a folder, quickly: what was read once is kept in a file there and read again only when it changed."""

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from stat import S_ISDIR
from typing import Any

from workbench import __version__
from workbench.results.entry import Entry, entry_kept, entry_of_folder, entry_of_recording
from workbench.utils.atomic_write import whole_file
from workbench.utils.errors import InputError
from workbench.utils.run_files import PART, RECORDING, RECORDING_SUFFIXES, SUMMARY

INDEX = ".runs.json"
"""May be deleted at any time."""
_SHARED = ("settings", "origin")
"""Fields of which runs have much in common: what all would repeat is written once."""

_Version = list[int]
_Kept = dict[str, tuple[_Version, Mapping[str, Any]]]


def entries(*places: Path) -> list[Entry]:
    """The runs at and below these places, folders or recordings, newest first; each once.

    Raises InputError for a place that does not exist.
    """
    found: dict[str, Entry] = {}
    for place in places:
        known = _below(place) if os.path.isdir(place) else [_read(str(place), _damaged([str(place)]))]
        if None in known:
            raise InputError(f"{place}: expected a folder of runs or a recording, found nothing there")
        found |= {entry.path: entry for entry in known if entry is not None}
    return sorted(found.values(), key=lambda entry: (entry.started, entry.path), reverse=True)


def _below(root: Path) -> list[Entry | None]:
    """The runs below a folder, by its index, which is brought up to date where it can be written."""
    kept = _kept(root)
    known: dict[str, tuple[_Version, Entry | None]] = {}
    for path in runs_in(root):
        was, fields = kept.get(path, ([], {}))
        version = _version(path)
        entry = entry_kept(path, fields) if was == version else None
        known[path] = version, None if entry is not None and entry.status == "running" else entry
    new = [path for path, (_, entry) in known.items() if entry is None]
    damaged = _damaged(new)
    read = ((path, version, entry or _read(path, damaged)) for path, (version, entry) in known.items())
    found = {path: (version, entry) for path, version, entry in read if entry is not None}
    if (new or len(found) != len(kept)) and len(found) > 1 and os.access(root, os.W_OK):  # of one run none is needed
        with suppress(InputError), whole_file(root / INDEX) as part:  # as on a full disk: all is known without it
            part.write_text(json.dumps(_index(root, found)))
    return [entry for _, entry in found.values()]


def _damaged(paths: Sequence[str]) -> Mapping[str, str]:
    """Return a message for each of the recordings whose decoding crashes, see `probe`; folders are not searched."""
    if not (recordings := [Path(path) for path in paths if os.path.isfile(path)]):
        return {}
    from workbench.recording.read.crash_probe import (  # here, as an index seldom needs it, and it takes long
        damage,
        fatal,
    )

    return {str(path): damage(path) for path in fatal(recordings)}


def _read(path: str, damaged: Mapping[str, str]) -> Entry | None:
    """The run at a path; None where another command has just removed it. damaged: see there."""
    try:
        if path in damaged:
            return Entry(path, "unreadable", path, size=os.path.getsize(path), error=damaged[path])
        return entry_of_folder(Path(path)) if os.path.isdir(path) else entry_of_recording(Path(path))
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None


def runs_in(root: Path | str) -> Iterator[str]:
    """Find the folders of runs at and below `root`, and recordings that lie by themselves; links are not followed."""
    for folder, inner, files in os.walk(root):
        inner[:] = sorted(name for name in inner if not name.startswith("."))
        if SUMMARY in files:
            yield folder
        else:
            yield from (os.path.join(folder, name) for name in sorted(files) if name.endswith(RECORDING_SUFFIXES))


def _index(root: Path, found: Mapping[str, tuple[_Version, Entry]]) -> dict[str, Any]:
    """What is written: of each run its version and its fields, but what the run in the middle has, too."""
    plain = {path: (version, entry.plain) for path, (version, entry) in found.items()}
    middle = list(plain.values())[len(plain) // 2 :][:1]
    shared = {name: fields[name] for _, fields in middle for name in _SHARED}
    runs = {path: [version, *_apart(shared, fields)] for path, (version, fields) in plain.items()}
    return {"workbench": __version__, "root": str(root), "shared": shared, "runs": runs}


def _apart(shared: Mapping[str, Any], fields: dict[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """The fields without what is shared, and the names of those that share; they have every key of what is shared."""
    names = [name for name in _SHARED if shared[name].keys() <= fields[name].keys()]
    own = {name: {key: value for key, value in fields[name].items() if shared[name].get(key, ...) != value}
           for name in names}  # fmt: skip
    return fields | own, names


def _kept(root: Path) -> _Kept:
    """What the index says; nothing where it is of another place or version, cut off, or not there."""
    try:
        index = json.loads((root / INDEX).read_text(encoding="utf-8"))
        if (index["workbench"], index["root"]) != (__version__, str(root)):
            return {}
        return {path: (version, _whole(index["shared"], fields, names))
                for path, (version, fields, names) in index["runs"].items()}  # fmt: skip
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return {}


def _whole(shared: Mapping[str, Any], fields: dict[str, Any], names: Sequence[str]) -> dict[str, Any]:
    return fields | {name: {**shared[name], **fields[name]} for name in names}


def _version(path: str) -> _Version:
    """Identify the version of a run's summary and recording, which changes whenever one is written."""
    found: _Version = []
    for file in (path, *(f"{path}/{name}" for name in (SUMMARY, RECORDING, PART))):
        try:
            status = os.stat(file)
        except OSError:  # a run has not all of them, and a recording that lies by itself none
            continue
        if not S_ISDIR(status.st_mode):
            found += [status.st_size, status.st_mtime_ns]
    return found
