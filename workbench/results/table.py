"""Recorded runs as a DataFrame: a row for each run, with configuration and metrics as flat columns."""

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import datetime
from math import isfinite
from pathlib import Path
from typing import Any

import pandas as pd

from workbench.recording.format import check_format
from workbench.recording.settings import choices_of, leaves
from workbench.utils.errors import InputError
from workbench.utils.run_files import PART, RECORDING, RECORDING_SUFFIXES, SUMMARY, summary_text
from workbench.utils.run_lock import is_locked

FIELDS = ("path", "recording", "status", "experiment", "seed", "started", "sweep", "size", "error")
"""path: of the run's folder, or of a recording without one. status: complete, stopped, failed, interrupted, running,
killed, or unreadable with the reason in `error`. started: ISO 8601, UTC. sweep: folder of the run's sweep. size: bytes
of the recording."""
SECTIONS = ("choices", "metrics", "settings", "origin")
"""The chosen option by group; metrics and cost; the resolved configuration by dotted key; the provenance."""

_NOT_A_SUMMARY = (ValueError, TypeError, AttributeError, LookupError, ArithmeticError, RecursionError)
"""Exceptions raised by reading a file that is not a summary."""


def runs(*places: str | Path) -> pd.DataFrame:
    """Return the runs in these folders or recordings, newest first; without arguments those below recordings/.

    Columns are FIELDS, then the chosen option by group (`prior`), the metrics by name (`mpjpe_px`), the configuration
    by dotted key (`inference.n_particles`) and the provenance (`commit`). Raises InputError for a missing place.
    """
    frame = read_runs(*(map(Path, places) if places else [Path("recordings")]))
    names = [name.partition(".") for name in frame]
    frame.columns = pd.Index([key if section in SECTIONS else section for section, _, key in names], dtype=object)
    return frame.loc[:, ~frame.columns.duplicated()].apply(_inferred)


def read_runs(*places: Path) -> pd.DataFrame:
    """Return a row for each run in these folders or recordings, newest first.

    Columns are FIELDS and, after the name of its section, each key of SECTIONS: `choices.prior`, `metrics.mpjpe_px`,
    `settings.inference.n_particles`. Raises InputError for a place that does not exist.
    """
    for place in places:
        if not os.path.exists(place):
            raise InputError(f"{place}: expected a folder of runs or a recording, found nothing there")
    paths = [Path(path) for path in dict.fromkeys(path for place in places for path in runs_in(place))]
    crashing = _crashing([path for path in paths if path.is_file()])
    records = [crashing.get(path) or read_run(path) for path in paths]
    return _frame([record for record in records if record is not None])


def runs_in(place: Path | str) -> Iterator[str]:
    """Yield the folders of runs, and recordings outside of them, at and below a place; links are not followed."""
    if not os.path.isdir(place):
        yield str(place)
    for folder, inner, files in os.walk(place):
        inner[:] = sorted(name for name in inner if not name.startswith("."))
        if SUMMARY in files:
            yield folder
        else:
            yield from (os.path.join(folder, name) for name in sorted(files) if name.endswith(RECORDING_SUFFIXES))


def records_of(runs: pd.DataFrame) -> list[dict[str, Any]]:
    """Return each row of `read_runs` as a dict of FIELDS, and of SECTIONS as dicts."""
    places = [name.partition(".") for name in runs]
    records = []
    for values in runs.itertuples(index=False, name=None):
        record: dict[str, Any] = dict.fromkeys(FIELDS) | {name: {} for name in SECTIONS}
        for (section, dot, key), value in zip(places, values, strict=True):
            if not dot:
                record[section] = value
            elif value == value:  # NaN where the run does not have the key
                record[section][key] = value
        records.append(record)
    return records


def _inferred(column: "pd.Series[Any]") -> "pd.Series[Any]":
    """Return a column with inferred types; text stays unchanged, since file names may not be UTF-8."""
    return column.infer_objects() if pd.api.types.infer_dtype(column, skipna=True) != "string" else column


def _frame(records: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    newest_first = sorted(records, key=lambda record: (record["started"], record["path"]), reverse=True)
    rows = [dict(leaves(record)) for record in newest_first]
    dotted = dict.fromkeys(name for row in rows for name in row if "." in name)
    names = sorted(dotted, key=lambda name: SECTIONS.index(name.partition(".")[0]))
    return pd.DataFrame(rows, columns=pd.Index([*FIELDS, *names], dtype=object), dtype=object)


def read_run(path: Path) -> dict[str, Any] | None:
    """Return FIELDS and SECTIONS of a run's folder or recording; None if another command has just removed it."""
    try:
        return _of_folder(path) if path.is_dir() else _of_recording(path)
    except FileNotFoundError:
        return None


def _of_folder(folder: Path) -> dict[str, Any]:
    record = _unreadable(folder) | {"sweep": str(folder.parent) if folder.name.isdecimal() else ""}
    for recording in map(folder.joinpath, (PART, RECORDING)):
        with suppress(FileNotFoundError):  # a run that ends renames its recording
            record |= {"size": recording.stat().st_size, "recording": str(recording)}
    try:
        summary = json.loads(summary_text(folder))
        check_format(folder / SUMMARY, summary.get("format"), (summary.get("versions") or {}).get("workbench"))
        record |= _of_summary(summary)
    except InputError as error:
        return record | {"error": str(error)}
    except (OSError, *_NOT_A_SUMMARY) as error:
        folder.stat()  # raises if the folder was removed
        reason = f"{folder / SUMMARY}: expected the summary of a run, found {type(error).__name__}: {error}"
        return record | {"error": reason[:300]}
    if record["status"] == "running" and not is_locked(folder):
        record["status"] = "killed"
    if record["status"] in ("running", "killed") and record["recording"] == str(folder / RECORDING):
        # the run was killed between publishing its recording and writing its summary
        whole = _crashing([folder / RECORDING]).get(folder / RECORDING) or _of_recording(folder / RECORDING)
        return whole | {name: record[name] for name in ("path", "sweep", "started")}
    return record


def _of_recording(path: Path) -> dict[str, Any]:
    from workbench.recording.read.reader import read  # here, since it loads Rerun, which lists of runs do not need

    record = _unreadable(path) | {"recording": str(path), "size": path.stat().st_size}
    try:
        run = read(path)
        return record | _of_summary({
            "status": run.status, "experiment": run.provenance.get("experiment", ""),
            "seed": run.provenance.get("seed"), "provenance": run.provenance, "settings": run.settings,
            "metrics": {**run.result, **run.properties.get("cost", {})}, "verdict": run.properties.get("verdict"),
        })  # fmt: skip
    except (InputError, *_NOT_A_SUMMARY) as error:
        return record | {"error": " ".join(str(error).split())[:300]}


def _crashing(paths: Sequence[Path]) -> dict[Path, dict[str, Any]]:
    """Return the records of those recordings whose decoding crashes."""
    if not paths:
        return {}
    from workbench.recording.read.crash_probe import crash_message, crashing_recordings  # here, since it loads Rerun

    return {
        path: _unreadable(path) | {"recording": str(path), "error": crash_message(path)}
        for path in crashing_recordings(paths)
    }


def _unreadable(path: Path) -> dict[str, Any]:
    record = dict.fromkeys(FIELDS, "") | {"path": str(path), "recording": None, "seed": None, "size": 0}
    return record | {"status": "unreadable"} | {name: {} for name in SECTIONS}


def _of_summary(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Return FIELDS and SECTIONS from a summary; raises one of _NOT_A_SUMMARY for other content."""
    origin = dict(summary.get("provenance") or {})
    choices = choices_of(origin.pop("choices", None) or [])
    origin.pop("difference", None)
    if summary.get("verdict"):
        origin["verdict"] = str(summary["verdict"].get("level", ""))
    metrics = {name: value for name, value in summary["metrics"].items() if value is not None and isfinite(value)}
    seed = summary.get("seed")
    return {
        "status": str(summary["status"]), "experiment": str(summary.get("experiment", "")),
        "seed": None if seed is None else int(seed), "started": _iso(str(summary.get("started", ""))),
        "error": " ".join(str(summary.get("error") or "").split())[:300],
        "choices": choices, "metrics": metrics, "settings": dict(leaves(summary.get("settings") or {})),
        "origin": origin | {"identity": summary.get("identity") or origin.get("identity", "")},
    }  # fmt: skip


def _iso(started: str) -> str:
    """Return 20261122T150000.123456Z as 2026-11-22T15:00:00, and anything else unchanged."""
    with suppress(ValueError):
        return datetime.strptime(started, "%Y%m%dT%H%M%S.%fZ").isoformat(timespec="seconds")
    return started
