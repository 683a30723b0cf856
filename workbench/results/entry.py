"""What is known of one run without opening it in a viewer: how it ended, its configuration, its numbers."""

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from datetime import datetime
from math import isfinite
from pathlib import Path
from types import NoneType
from typing import Any

from workbench.recording.settings import choices_of, leaves
from workbench.utils.errors import InputError
from workbench.utils.run_files import PART, RECORDING, SUMMARY
from workbench.utils.run_lock import is_locked

_NO_SUMMARY = (ValueError, TypeError, AttributeError, LookupError, ArithmeticError, RecursionError)
"""What reading something else than a summary ends with."""


@dataclass(frozen=True)
class Entry:
    """A run. path: its folder, or its recording where that lies by itself. recording: None where there is none.

    status: complete, failed, interrupted, running, killed; or unreadable, and `error` says why. started: ISO 8601, UTC,
    to the second. choices: the option chosen, by group. settings: the resolved configuration by dotted key. metrics:
    its numbers, with what it cost. origin: its provenance but for the choices, the difference of code left out. sweep:
    the folder of the sweep that it is a job of. size: bytes of its recording.
    """

    path: str
    status: str
    recording: str | None = None
    experiment: str = ""
    seed: int | None = None
    started: str = ""
    choices: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    metrics: Mapping[str, float] = field(default_factory=dict)
    origin: Mapping[str, Any] = field(default_factory=dict)
    sweep: str = ""
    size: int = 0
    error: str = ""

    @property
    def plain(self) -> dict[str, Any]:
        """As JSON takes it."""
        return asdict(self)


_TYPES: Mapping[str, tuple[type, ...]] = {
    "path": (str,), "status": (str,), "recording": (str, NoneType), "experiment": (str,), "seed": (int, NoneType),
    "started": (str,), "choices": (dict,), "settings": (dict,), "metrics": (dict,), "origin": (dict,), "sweep": (str,),
    "size": (int,), "error": (str,),
}  # fmt: skip


def entry_kept(path: str, fields: Mapping[str, Any]) -> Entry | None:
    """The entry of these fields, as an index keeps them; None where they are not those of a run at this path."""
    if fields.keys() != _TYPES.keys() or not all(isinstance(fields[name], _TYPES[name]) for name in _TYPES):
        return None
    entry = Entry(**fields)
    places = (None, path, *(f"{path}/{name}" for name in (RECORDING, PART)))
    numbers, texts = entry.metrics.values(), entry.choices.values()
    whole = all(isinstance(value, float) for value in numbers) and all(isinstance(word, str) for word in texts)
    return entry if whole and entry.path == path and entry.recording in places else None


def entry_of_folder(folder: Path) -> Entry:
    """A run's folder, by its summary.json; without one that can be read the entry is `unreadable`.

    Raises FileNotFoundError for a folder that is not there any more.
    """
    known: dict[str, Any] = {"path": str(folder), "sweep": str(folder.parent) if folder.name.isdecimal() else ""}
    for recording in map(folder.joinpath, (PART, RECORDING)):
        with suppress(FileNotFoundError):  # a run that ends just now gives its recording another name
            known |= {"size": recording.stat().st_size, "recording": str(recording)}
    try:
        summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
        entry = Entry(**known, **_of_summary(summary))
        if entry.status == "running" and not is_locked(folder):
            entry = replace(entry, status="killed")
        if entry.status in ("running", "killed") and entry.recording == str(folder / RECORDING):
            # published, and then killed before it could say so
            whole = entry_of_recording(Path(entry.recording), suspicious=True)
            return replace(whole, path=entry.path, sweep=entry.sweep, started=entry.started)
        return entry
    except (OSError, *_NO_SUMMARY) as error:
        folder.stat()  # raises where all of it is gone
        reason = f"{folder / SUMMARY}: expected what a run leaves, found {type(error).__name__}: {error}"
        return Entry(**known, status="unreadable", error=reason[:300])


def entry_of_recording(path: Path, suspicious: bool = False) -> Entry:
    """Return the entry of a recording without a run's folder, such as a baseline.

    suspicious: decode it in the sandbox first, see `probe`. Raises FileNotFoundError for one that is not there.
    """
    from workbench.recording.read.crash_probe import (
        read_sound_run,  # here, as an index seldom needs it, and it takes long
    )
    from workbench.recording.read.reader import read

    known: dict[str, Any] = {"path": str(path), "recording": str(path), "size": path.stat().st_size}
    try:
        run = read_sound_run(path) if suspicious else read(path)
        origin = dict(run.provenance)
        numbers = {**run.result, **run.properties.get("cost", {})}
        summary = {
            "status": run.status, "experiment": origin.get("experiment", ""), "seed": origin.get("seed"),
            "provenance": origin, "settings": run.settings, "metrics": numbers,
            "verdict": run.properties.get("verdict"),
        }  # fmt: skip
        return Entry(**known, **_of_summary(summary))
    except (InputError, *_NO_SUMMARY) as error:
        return Entry(**known, status="unreadable", error=" ".join(str(error).split())[:300])


def _of_summary(summary: Mapping[str, Any]) -> dict[str, Any]:
    """The fields that summary.json tells of; raises one of _NO_SUMMARY for what is none."""
    origin = dict(summary.get("provenance") or {})
    words = origin.pop("choices", None) or []
    origin.pop("difference", None)
    numbers = {str(name): float(value) for name, value in summary["metrics"].items() if value is not None}
    metrics = {name: value for name, value in numbers.items() if isfinite(value)}
    origin |= {"verdict": str((summary.get("verdict") or {}).get("kind", ""))} if summary.get("verdict") else {}
    seed = summary.get("seed")
    return {
        "status": str(summary["status"]),
        "experiment": str(summary.get("experiment", "")),
        "seed": None if seed is None else int(seed),
        "started": _iso(str(summary.get("started", ""))),
        "choices": choices_of(words),
        "settings": dict(leaves(summary.get("settings") or {})),
        "metrics": metrics,
        "origin": origin | {"identity": summary.get("identity") or origin.get("identity", "")},
        "error": " ".join(str(summary.get("error") or "").split())[:300],
    }


def _iso(started: str) -> str:
    """20261122T150000.123456Z as 2026-11-22T15:00:00; anything else as it is."""
    try:
        return datetime.strptime(started, "%Y%m%dT%H%M%S.%fZ").isoformat(timespec="seconds")
    except ValueError:
        return started
