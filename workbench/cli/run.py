"""`workbench run`: compose a configuration, run it, and print a summary."""

import logging
import os
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import hydra
import typer
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from workbench.cli.error_messages import report_error
from workbench.cli.hydra_quoting import quoted
from workbench.cli.run_output import print_warnings, summary_lines
from workbench.experiment.config.options import allow_packages, packages_in, set_config_dirs
from workbench.experiment.config.schema import prepare_hydra
from workbench.sweep.early_stop import parse_stop_condition
from workbench.sweep.job import metric_of, run_job
from workbench.sweep.table import Watch, close
from workbench.utils.errors import InputError
from workbench.utils.signals import check_interrupted, interruptible

if TYPE_CHECKING:
    from workbench.experiment.summary import Summary

log = logging.getLogger(__name__)
app = typer.Typer(add_completion=False)

_LAUNCHER_DIED = RuntimeError
"""Base of the errors of joblib (TerminatedWorkerError) and submitit (UncompletedJobError) for a killed worker."""

_NOT_FOR_HYDRA = ("from=", "hydra.run.dir=")
"""Arguments that Hydra does not parse when a recorded run is repeated."""
_ENVIRONMENT = {
    "HYDRA_FULL_ERROR": "1",  # errors reach `run` instead of Hydra's report
    "RUST_LOG": "warn,re_log_encoding=off,re_sdk=off",  # a full disk ends the run with one message
    "MIMALLOC_PURGE_DELAY": "0",  # Rerun returns free memory at once: a third less for a long run
    "OPENCV_IO_MAX_IMAGE_PIXELS": str(1 << 27),  # limit for image files
    "PYTHONSAFEPATH": "1",  # workers import nothing from the current folder
}
"""Defaults for this process and the workers of its launcher, read when Rerun, OpenCV and the workers start."""


@app.command(context_settings={"ignore_unknown_options": True})
def run(
    overrides: Annotated[
        list[str] | None, typer.Argument(metavar="GROUP=OPTION|KEY=VALUE", help="Components to choose and keys to set.")
    ] = None,
) -> int:
    """Run an experiment and write its recording; with -m, run all combinations of the listed values.

    An experiment chooses components and sets their keys; arguments override
    these. `workbench components` lists experiments and components. Options such
    as --config-dir=FOLDER, --cfg job and --info are Hydra's; see --hydra-help.

    Examples:
      workbench run experiment=walk_circle seed=3 inference.n_particles=2000
      workbench run -m experiment=walk_straight prior=walking,smooth seed=1,2,3
      workbench run from=RUN.rrd seed=4        # a recorded run with another seed
    """
    added = {name: value for name, value in _ENVIRONMENT.items() if name not in os.environ}
    os.environ.update(added)
    logging.raiseExceptions = False  # else every log line on a full disk prints a traceback
    Watch.progress = None
    code, arguments = 0, list[str]()
    with interruptible(first=Watch.end):
        try:
            words = overrides or []
            plain = _NOT_FOR_HYDRA if any(text.startswith("from=") for text in words) else ()
            arguments = sorted((text if text.startswith(plain) else quoted(text) for text in words), key=_is_override)
            _run(arguments)
            check_interrupted()  # a launcher may have ignored it
        except (Exception, KeyboardInterrupt) as error:
            if (reported := report_error(error)) is None:
                raise
            code = reported
        finally:
            if Watch.progress is not None:
                left = close(Watch.progress, arguments)
                code = code or left
            for name in added:
                os.environ.pop(name, None)  # a caller in the same process keeps its environment
    return code


def _is_override(argument: str) -> bool:
    """Return whether an argument is no option, as Hydra expects all overrides after the options."""
    return argument not in ("-m", "--multirun") and not re.match("--[a-z-]+=", argument)


def _run(arguments: list[str]) -> None:
    if unnamed := [text for text in arguments if text.startswith("=")]:
        raise InputError(f"expected key=value, found {unnamed[0]!r}")
    allow_packages(packages_in(arguments))
    set_config_dirs(arguments)
    if any(text.startswith("--experimental-rerun") for text in arguments):
        raise InputError("--experimental-rerun would unpickle a file; use from=RUN.rrd to repeat a recorded run")
    if any(text.startswith("from=") for text in arguments):
        _repeat(arguments)
    else:
        _run_hydra(arguments)


def _repeat(arguments: list[str]) -> None:
    """Run a recorded configuration with changes, without Hydra."""
    from workbench.experiment.repeat import repeat  # imported here, as in `_job`

    root = logging.getLogger()
    root.addHandler(logging.StreamHandler(sys.stdout))
    root.setLevel(logging.INFO)
    print_warnings()
    _log(repeat(arguments))


def _run_hydra(arguments: list[str]) -> None:
    """Run Hydra; a killed worker, which ends the launcher, is reported, and `close` lists the incomplete jobs."""
    before, sys.argv = sys.argv, ["workbench run", *arguments]  # Hydra reads them here
    try:
        _job()
    except _LAUNCHER_DIED as error:
        if Watch.progress is None:
            raise
        Watch.progress.stop()
        reason = next(iter(str(error).splitlines()), "")  # the output of its process follows
        print(f"workbench: the launcher was terminated: {type(error).__name__}: {reason}", file=sys.stderr)
    finally:
        sys.argv = before


@hydra.main(version_base="1.3", config_path="pkg://workbench.conf", config_name="config")
def _job(config: DictConfig) -> float | None:
    """Run one job and return the objective of a tuner, see `metric_of`."""
    print_warnings()
    settings, sweep = HydraConfig.get(), config.sweep
    config = OmegaConf.masked_copy(config, [str(key) for key in config if key != "sweep"])  # as without a sweep
    experiment = str(settings.runtime.choices.get("experiment") or "custom")
    if settings.mode == RunMode.MULTIRUN:
        return run_job(config, sweep, experiment, settings)
    from workbench.experiment.provenance import Command
    from workbench.experiment.run import execute  # imported here, as the help does not need it

    try:
        choices = {str(group): str(option) for group, option in settings.runtime.choices.items()}
        command = Command(list(settings.overrides.task), choices)
        stop = None if sweep.stop_if is None else parse_stop_condition(sweep.stop_if)
        summary = execute(config, experiment, Path(settings.runtime.output_dir), command=command, stop=stop)
        metric = metric_of({**summary.metrics, **summary.cost}, sweep.objective)
    except Exception as error:
        if (code := report_error(error)) is None:
            raise
        sys.exit(code)  # Hydra would add a line to an exception
    _log(summary)
    return metric


def _log(summary: "Summary") -> None:
    for line in summary_lines(summary):
        log.info("%s", line)


prepare_hydra()  # here, as the workers of a launcher import this module without calling `run`
