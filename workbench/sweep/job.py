"""One job of a sweep, in another process: however violently it ends, the sweep and its other jobs go on.

A process whose job ended well waits for the next one, so that imports, kernels and what was learned are there already.
"""

import fcntl
import json
import os
import platform
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter, time_ns
from typing import Any

from omegaconf import DictConfig, OmegaConf

from workbench.files import replace_text
from workbench.signals import SIGNALS, Interrupted, held_back
from workbench.sweep.process import BEFORE, CONFIG, STOP_WHEN, WARNING, process_for

ENDED = ("complete", "stopped", "failed", "interrupted")
"""What `status` in summary.json comes to; before that it is "running"."""

KILLED = "killed by"
"""How the error of a job begins that a signal ended."""

CUT_OFF = "cut off: its process is gone"
"""Of a job that was killed together with whoever started it."""


@contextmanager
def alone(folder: Path) -> Iterator[int]:
    """Wait until no other process works in the folder, then keep others waiting; gives the lock's file descriptor.

    A process that inherits the descriptor keeps the lock until it ends, too.
    """
    with (folder / ".lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield file.fileno()


def at_work(folder: Path) -> bool:
    """Tell whether a process works in the folder."""
    try:
        with (folder / ".lock").open() as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except FileNotFoundError:
        pass
    return False


def run_apart(
    config: DictConfig, experiment: str, folder: Path, output: Path, lock: int, stop: str | None = None
) -> None:
    """Run the configured experiment in another process, which leaves run.rrd and summary.json in `folder`.

    stop: see `stopping.stop_when`. What it prints is added to the file `output`. The process inherits `lock`. Whatever
    becomes of it, summary.json says so afterwards: "failed" with the signal or the exit code where it could not say so
    itself.
    """
    (folder / CONFIG).parent.mkdir(exist_ok=True)
    (folder / CONFIG).write_text(OmegaConf.to_yaml(config, resolve=True))
    (folder / STOP_WHEN).write_text(stop or "")
    (folder / "summary.json").unlink(missing_ok=True)  # an earlier attempt's, which says nothing about this one
    began = perf_counter()
    with output.open("ab") as out, held_back(WARNING) as release:
        process = process_for(out)
        try:
            process.begin(experiment, folder, lock, out)
            release()
            code = process.wait()
        except KeyboardInterrupt as error:
            process.end(error.number if isinstance(error, Interrupted) and error.number != signal.SIGINT else None)
            raise
    summary = read_summary(folder) or {"experiment": experiment, "metrics": {}}
    if summary.get("status") not in ENDED:
        _write_end(folder, code, output.name, {**summary, "wall_s": round(perf_counter() - began, 3)})


def _write_end(folder: Path, code: int, output: str, summary: dict[str, Any]) -> None:
    """Write what became of a job that could not say so itself, or was asked to end before it began."""
    if code in (asked := {128 + number: number for number in (*SIGNALS, WARNING)}):
        _write(folder, {**summary, "status": "interrupted", "error": f"Interrupted: {Interrupted(asked[code])}"})
    else:
        cause = f"{KILLED} {signal.Signals(-code).name}" if code < 0 else f"ended with code {code}, see {output}"
        write_failure(folder, cause, summary)


def put_back(folder: Path, stop: str | None) -> None:
    """Move what an attempt that did not complete recorded to where the next one finds it and may go on with it.

    stop: the condition that may end the next one; where the last had another, it may have gone on for too long.
    """
    written = folder / STOP_WHEN
    if stop and (not written.is_file() or written.read_text() != stop):
        return
    for name in ("run.rrd", "run.rrd.part"):
        if (path := folder / name).is_file():
            (folder / BEFORE).mkdir(exist_ok=True)
            os.replace(path, folder / BEFORE / f"{time_ns()}.rrd.part")


def read_summary(folder: Path) -> dict[str, Any] | None:
    """Read what summary.json in the folder says; None where there is none or it cannot be read."""
    try:
        summary = json.loads((folder / "summary.json").read_text())
    except (OSError, ValueError):
        return None
    return summary if isinstance(summary, dict) else None


def write_failure(folder: Path, error: str, summary: dict[str, Any]) -> None:
    """Write the summary again as that of a failed run."""
    _write(folder, {**summary, "status": "failed", "error": error})


def say_if_gone(folder: Path) -> None:
    """Write that a job was cut off where its summary says "running" and this machine has no such process any more."""
    summary = read_summary(folder) or {}
    if (summary.get("status"), summary.get("host")) == ("running", platform.node()):
        try:
            os.kill(summary["pid"], 0)
        except ProcessLookupError:
            write_failure(folder, CUT_OFF, summary)


def _write(folder: Path, summary: dict[str, Any]) -> None:
    replace_text(folder / "summary.json", json.dumps(summary, indent=2) + "\n")
