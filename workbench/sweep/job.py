"""One job of a sweep, run by its launcher: however it ends, its summary.json is true and the sweep goes on."""

import json
import logging
import math
import os
import shutil
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from time import time_ns
from typing import Any

from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from workbench.evaluation.headline import ERRORS
from workbench.sweep.early_stop import StopWhen, stop_when
from workbench.utils.atomic_write import NotWrittenError, whole_file
from workbench.utils.errors import InputError
from workbench.utils.run_files import EARLIER, PART, RECORDING, SUMMARY, read_summary
from workbench.utils.run_lock import is_locked, locked

log = logging.getLogger(__name__)

ASIDE = ".aside"
"""In a sweep's folder: where a job's run waits whose number now belongs to another."""

FAILED = ".failed"
"""In a sweep's folder: the number of a job that has failed since the sweep began."""

_ALONE, _DETACHED = "BasicLauncher", "submitit"
"""In the names of launchers: one runs jobs in the sweep's own process, the other's jobs survive that process."""


def run_job(config: DictConfig, sweep: DictConfig, experiment: str, settings: Any) -> float | None:
    """Run one job of a sweep, unless a complete run that would come out the same exists.

    Parameters
    ----------
    config : the configuration without the keys of `sweep`.
    sweep : the keys of that name.
    experiment : its name.
    settings : Hydra's own, for this job.

    Returns
    -------
    The metric that a tuner minimises; the worst number for a job that did not complete or has no finite metric.

    Raises
    ------
    InputError : the run has no number called sweep.metric.
    Interrupted : a signal asked the sweep's own process to end; a launcher's other process only ends its job.
    """
    folder, launcher = Path(settings.runtime.output_dir), str(settings.launcher._target_)
    chosen = sweep.jobs is None or settings.job.num in sweep.jobs
    if chosen and (_DETACHED in launcher or is_locked(folder.parent)):  # else the sweep has ended
        try:
            with locked(folder, wait=True):
                _run_unless_there(config, sweep, experiment, settings, folder)
        except KeyboardInterrupt:
            if launcher.endswith(_ALONE):
                raise
    summary = read_summary(folder) or {}
    complete = summary.get("status") == "complete"
    metric = metric_of(summary["metrics"], sweep.metric) if complete else None
    if metric is None and (sweep.metric is not None or not complete):
        return -math.inf if "maximize" in str(settings.sweeper.get("direction")) else math.inf
    return metric


def metric_of(metrics: Mapping[str, float | None], name: str | None) -> float | None:
    """Return the run's number called `name`, of None the usual error; raises InputError when there is none."""
    if name is None:
        return next((metrics[error] for error in ERRORS if error in metrics), None)
    if name not in metrics:
        raise InputError(f"sweep.metric: expected one of {', '.join(sorted(metrics))}, found {name!r}")
    return metrics[name]


def _run_unless_there(config: DictConfig, sweep: DictConfig, experiment: str, settings: Any, folder: Path) -> None:
    """Run a job whose folder is locked; a defect is logged, as the run's summary describes it."""
    stop = None if sweep.stop_when is None else stop_when(sweep.stop_when)
    if _is_there(config, sweep, folder, stop) or (sweep.fail_fast and (folder.parent / FAILED).is_file()):
        return
    root = logging.getLogger()
    for handler in [each for each in root.handlers if type(each) is logging.StreamHandler]:
        root.removeHandler(handler)  # the terminal is the table's
    try:
        with warnings.catch_warnings():  # so that each job logs its warnings
            _run(config, experiment, settings, folder, stop)
    except Exception:
        (folder.parent / FAILED).write_text(folder.name)
        log.exception("job %s failed", folder.name)


def _run(config: DictConfig, experiment: str, settings: Any, folder: Path, stop: StopWhen | None) -> None:
    """Run the configuration in the folder, from where an earlier attempt ended if it has checkpoints."""
    from workbench.experiment.provenance import Command
    from workbench.experiment.resume import resumed
    from workbench.experiment.run import ending, run_checked
    from workbench.experiment.summary import Summary

    choices = {str(group): str(option) for group, option in settings.runtime.choices.items()}
    command = Command(list(settings.overrides.task), choices)
    attempts = _earlier_attempts(folder)
    summary = Summary(experiment=experiment, seed=int(config.seed), recording=folder / RECORDING)
    with ending(summary):
        found = None if stop is not None else resumed(config, attempts)  # an attempt may have missed the condition
        continued, summary.restart_reason = (None, found) if isinstance(found, str) else (found, None)
        run_checked(config, summary, True, command, continued, stop)
    for attempt in attempts:
        attempt.unlink()
    if attempts and not os.listdir(folder / EARLIER):
        (folder / EARLIER).rmdir()


def _earlier_attempts(folder: Path) -> list[Path]:
    """Move what the last attempt recorded to where no run writes; return the recordings of all attempts."""
    aside = folder / EARLIER
    if (folder / PART).is_file():
        aside.mkdir(exist_ok=True)
        os.replace(folder / PART, aside / f"{time_ns()}.rrd.part")
    return list(aside.glob("*.rrd.part"))


def _is_there(config: DictConfig, sweep: DictConfig, folder: Path, stop: StopWhen | None) -> bool:
    """Return whether a complete run that would come out the same is in the folder, or could be taken over from another.

    sweep.resume and sweep.reuse say where else to look. The time of its summary becomes now, which marks it as ended.
    """
    places = [Path(place) for place in (sweep.resume, sweep.reuse) if place is not None]
    if not places:
        return False
    from workbench.experiment.provenance import identity  # here and below, as the sweep's own process may do without

    try:
        wanted = identity(config)
    except (InputError, OmegaConfBaseException):  # the run itself will report it
        return False
    summary = read_summary(folder) or {}
    stopped = str(summary.get("stopped")).rpartition(" in frame ")[0]
    ended = summary.get("status") == "complete" or (summary.get("status") == "stopped" and stopped == str(stop))
    if ended and (folder / RECORDING).is_file() and summary.get("identity") == wanted:
        os.utime(folder / SUMMARY)
        return True
    _set_aside(folder)
    return take_over(wanted, folder, places)


def take_over(identity: str, folder: Path, places: Sequence[Path]) -> bool:
    """Put a complete run of this identity, if any of the places holds one, into `folder`; tells whether it did.

    The recording is linked where the file system allows that, else copied; its summary says where it is from.
    """
    for source in _runs(places):
        summary = read_summary(source) or {}
        if source == folder or (summary.get("status"), summary.get("identity")) != ("complete", identity):
            continue
        try:
            with whole_file(folder / RECORDING) as part:
                _link(source / RECORDING, part)
        except NotWrittenError:  # another process has just removed it
            continue
        with whole_file(folder / SUMMARY) as part:
            part.write_text(json.dumps({**summary, "taken_from": str(source)}, indent=2) + "\n")
        if source.parent.name == ASIDE:
            shutil.rmtree(source, ignore_errors=True)  # another sweep may take it over, too
        return True
    return False


def _set_aside(folder: Path) -> None:
    """Move a complete run out of the way of another that is to have its folder, where `take_over` finds it."""
    summary = read_summary(folder) or {}
    if summary.get("status") != "complete" or not (folder / RECORDING).is_file():
        return
    target = folder.parent / ASIDE / str(summary.get("identity"))
    target.mkdir(parents=True, exist_ok=True)
    for name in (RECORDING, SUMMARY):
        os.replace(folder / name, target / name)


def _runs(places: Sequence[Path]) -> Iterator[Path]:
    """The folders of runs in the places, those set aside last, as they may have just been."""
    for place in places:
        for folder in (place, place / ASIDE):
            if folder.is_dir():
                yield from (Path(each) for each in sorted(each.path for each in os.scandir(folder) if each.is_dir()))


def _link(source: Path, target: Path) -> None:
    """Link a file, or copy it to another file system or one without links."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)
