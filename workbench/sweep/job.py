"""One job of a sweep, run by a launcher. Whatever ends it, its summary.json is correct and the sweep continues."""

import json
import logging
import math
import os
import shutil
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from workbench.evaluation.metrics import HEADLINE_ERRORS
from workbench.sweep.early_stop import StopCondition, parse_stop_condition
from workbench.utils.atomic_write import NotWrittenError, whole_file
from workbench.utils.errors import InputError
from workbench.utils.run_files import RECORDING, SUMMARY, read_summary
from workbench.utils.run_lock import is_locked, locked

log = logging.getLogger(__name__)

ASIDE = ".aside"
"""Folder in a sweep's folder for runs whose job number now belongs to another configuration."""

FAILED = ".failed"
"""File in a sweep's folder with the number of a job that has failed since the sweep began."""

_ALONE, _DETACHED = "BasicLauncher", "submitit"
"""Parts of launcher names: the first runs jobs in the sweep's process, jobs of the second survive that process."""


def run_job(config: DictConfig, sweep: DictConfig, experiment: str, settings: Any) -> float | None:
    """Run one job of a sweep, unless a complete run with the same identity exists.

    Parameters
    ----------
    config : the configuration without the section `sweep`.
    sweep : that section.
    experiment : name of the experiment.
    settings : Hydra's settings of this job.

    Returns
    -------
    The objective of a tuner; the worst value for a job that is not complete or has no finite objective.

    Raises
    ------
    InputError : the run has no metric sweep.objective.
    Interrupted : a signal interrupts the sweep's process; in another process of the launcher it ends the job only.
    """
    folder, launcher = Path(settings.runtime.output_dir), str(settings.launcher._target_)
    chosen = sweep.job_ids is None or settings.job.num in sweep.job_ids
    if chosen and (_DETACHED in launcher or is_locked(folder.parent)):  # else the sweep has ended
        try:
            with locked(folder, wait=True):
                _run_unless_complete(config, sweep, experiment, settings, folder)
        except KeyboardInterrupt:
            if launcher.endswith(_ALONE):
                raise
    summary = read_summary(folder) or {}
    complete = summary.get("status") == "complete"
    objective = metric_of(summary["metrics"], sweep.objective) if complete else None
    if objective is None and (sweep.objective is not None or not complete):
        return -math.inf if "maximize" in str(settings.sweeper.get("direction")) else math.inf
    return objective


def metric_of(metrics: Mapping[str, float | None], name: str | None) -> float | None:
    """Return the metric `name`, for None the first of HEADLINE_ERRORS; InputError if it does not exist."""
    if name is None:
        return next((metrics[error] for error in HEADLINE_ERRORS if error in metrics), None)
    if name not in metrics:
        raise InputError(f"sweep.objective: expected one of {', '.join(sorted(metrics))}, found {name!r}")
    return metrics[name]


def _run_unless_complete(config: DictConfig, sweep: DictConfig, experiment: str, settings: Any, folder: Path) -> None:
    """Run a job whose folder is locked; an exception is logged, and the run's summary contains it."""
    stop = None if sweep.stop_if is None else parse_stop_condition(sweep.stop_if)
    if _is_complete(config, sweep, folder, stop) or (sweep.fail_fast and (folder.parent / FAILED).is_file()):
        return
    root = logging.getLogger()
    for handler in [handler for handler in root.handlers if type(handler) is logging.StreamHandler]:
        root.removeHandler(handler)  # only the table prints to the terminal
    try:
        with warnings.catch_warnings():  # so that each job logs its warnings
            _run(config, experiment, settings, folder, stop)
    except Exception:
        (folder.parent / FAILED).write_text(folder.name)
        log.exception("job %s failed", folder.name)


def _run(config: DictConfig, experiment: str, settings: Any, folder: Path, stop: StopCondition | None) -> None:
    """Run the configuration in the folder; the partial recording of an earlier attempt is replaced."""
    from workbench.experiment.provenance import Command
    from workbench.experiment.run import ending, run_checked
    from workbench.experiment.summary import Summary

    choices = {str(group): str(option) for group, option in settings.runtime.choices.items()}
    command = Command(list(settings.overrides.task), choices)
    summary = Summary(experiment=experiment, seed=int(config.seed), recording=folder / RECORDING)
    with ending(summary):
        run_checked(config, summary, True, command, stop)


def _is_complete(config: DictConfig, sweep: DictConfig, folder: Path, stop: StopCondition | None) -> bool:
    """Return whether the folder has a complete run of the same identity, or one was reused from another folder.

    sweep.resume and sweep.reuse are the other folders. The summary gets the current time, which marks the job as ended.
    """
    places = [Path(place) for place in (sweep.resume, sweep.reuse) if place is not None]
    if not places:
        return False
    from workbench.experiment.provenance import identity  # imported here, as the sweep's process may not need it

    try:
        expected = identity(config)
    except (InputError, OmegaConfBaseException):  # the run reports it
        return False
    summary = read_summary(folder) or {}
    stopped = str(summary.get("stopped")).rpartition(" in frame ")[0]
    ended = summary.get("status") == "complete" or (summary.get("status") == "stopped" and stopped == str(stop))
    if ended and (folder / RECORDING).is_file() and summary.get("identity") == expected:
        os.utime(folder / SUMMARY)
        return True
    _set_aside(folder)
    return reuse_run(expected, folder, places)


def reuse_run(identity: str, folder: Path, places: Sequence[Path]) -> bool:
    """Put a complete run of this identity from one of the places into `folder`; return whether there is one.

    The recording is linked, or copied to a file system without links. Its summary contains the source folder.
    """
    for source in _runs(places):
        summary = read_summary(source) or {}
        if source == folder or (summary.get("status"), summary.get("identity")) != ("complete", identity):
            continue
        try:
            with whole_file(folder / RECORDING) as part:
                _link(source / RECORDING, part)
        except NotWrittenError:  # another process has removed it
            continue
        with whole_file(folder / SUMMARY) as part:
            part.write_text(json.dumps({**summary, "taken_from": str(source)}, indent=2) + "\n")
        if source.parent.name == ASIDE:
            shutil.rmtree(source, ignore_errors=True)  # another sweep may be reusing it
        return True
    return False


def _set_aside(folder: Path) -> None:
    """Move a complete run of another configuration to ASIDE, where `reuse_run` finds it."""
    summary = read_summary(folder) or {}
    if summary.get("status") != "complete" or not (folder / RECORDING).is_file():
        return
    target = folder.parent / ASIDE / str(summary.get("identity"))
    target.mkdir(parents=True, exist_ok=True)
    for name in (RECORDING, SUMMARY):
        os.replace(folder / name, target / name)


def _runs(places: Sequence[Path]) -> Iterator[Path]:
    """Yield the run folders in the places, those in ASIDE last, as they may be new."""
    for place in places:
        for folder in (place, place / ASIDE):
            if folder.is_dir():
                yield from (Path(path) for path in sorted(entry.path for entry in os.scandir(folder) if entry.is_dir()))


def _link(source: Path, target: Path) -> None:
    """Link a file, or copy it if the file system does not allow the link."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)
