"""`workbench run`: compose a configuration, run it, and print what came out."""

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
from workbench.sweep.table import Watch, close, rest_of
from workbench.utils.errors import InputError
from workbench.utils.signals import interruptible

if TYPE_CHECKING:
    from workbench.experiment.summary import Summary

log = logging.getLogger(__name__)
app = typer.Typer(add_completion=False)

_LAUNCHER_DIED = RuntimeError
"""Base of what joblib (TerminatedWorkerError) and submitit (UncompletedJobError) raise when a worker is killed."""

_NOT_FOR_HYDRA = ("from=", "hydra.run.dir=")
"""Arguments that Hydra does not read where a recorded run goes on."""
_ENVIRONMENT = {
    "HYDRA_FULL_ERROR": "1",  # errors reach `run` instead of Hydra's own report
    "RUST_LOG": "warn,re_log_encoding=off,re_sdk=off",  # a full disk ends the run, which prints one sentence
    "MIMALLOC_PURGE_DELAY": "0",  # Rerun returns free memory at once: a third less for a long run
    "OPENCV_IO_MAX_IMAGE_PIXELS": str(1 << 27),  # of an image file
}
"""Defaults for this process and the workers of its launcher, read when Rerun and OpenCV are imported."""


@app.command(context_settings={"ignore_unknown_options": True})
def run(
    overrides: Annotated[
        list[str] | None,
        typer.Argument(metavar="GROUP=OPTION|KEY=VALUE", help="Components to choose and keys to set."),
    ] = None,
) -> int:
    """Run an experiment and write its recording; with -m, run every combination of the values listed.

    An experiment chooses components and sets their keys, and words on the
    command line replace these; `workbench components` lists what there is.
    Options such as --config-dir=FOLDER, --cfg job and --info are Hydra's;
    --hydra-help lists them.

    \b
    Examples:
      workbench run experiment=walk_circle seed=3 inference.n_particles=2000
      workbench run -m prior=walking,smooth seed=1,2,3
      workbench run from=RUN.rrd seed=4        # a recorded configuration, changed
      workbench run from=RUN.rrd@120 seed=4    # the same from frame 120 on
    """
    for name, value in _ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    logging.raiseExceptions = False  # on a full disk, every line of run.log would bring a traceback
    Watch.progress = None
    code, arguments = 0, list[str]()
    with interruptible(first=Watch.end):
        try:
            words = overrides or []
            plain = _NOT_FOR_HYDRA if any(text.startswith("from=") for text in words) else ()
            arguments = sorted((text if text.startswith(plain) else quoted(text) for text in words), key=_is_override)
            _run(arguments)
        except (Exception, KeyboardInterrupt) as error:
            if (reported := report_error(error)) is None:
                raise
            code = reported
        finally:
            if Watch.progress is not None:
                left = close(Watch.progress, arguments)
                code = code or left
    return code


def _is_override(argument: str) -> bool:
    """Return whether it is no option without a value of its own: Hydra reads overrides on one side of these."""
    return argument not in ("-m", "--multirun") and not re.match("--[a-z-]+=", argument)


def _run(arguments: list[str]) -> None:
    if unnamed := [text for text in arguments if text.startswith("=")]:
        raise InputError(f"expected key=value, found {unnamed[0]!r}")
    allow_packages(packages_in(arguments))
    set_config_dirs(arguments)
    if any(text.startswith("--experimental-rerun") for text in arguments):
        raise InputError("--experimental-rerun would unpickle a file; from=RUN.rrd runs a recorded configuration")
    if any(text.startswith("from=") for text in arguments):
        _branch(arguments)
    else:
        _whole_sweep(arguments)


def _branch(arguments: list[str]) -> None:
    """Run a recorded configuration with changes, which Hydra does not compose."""
    from workbench.experiment.branch import branch  # here, as in `_job`

    root = logging.getLogger()
    root.addHandler(logging.StreamHandler(sys.stdout))
    root.setLevel(logging.INFO)
    print_warnings()
    _log(branch(arguments))


def _whole_sweep(arguments: list[str]) -> None:
    """Run Hydra; when joblib dies of a killed worker, run it again for the jobs that have not begun."""
    before, rest = sys.argv, list[str]()
    while True:
        sys.argv = ["workbench run", *arguments, *rest]  # where Hydra reads them
        try:
            _job()
            return
        except _LAUNCHER_DIED as error:
            if (progress := Watch.progress) is None:
                raise
            progress.stop()
            reason = next(iter(str(error).splitlines()), "")  # pages follow, of what its process printed
            print(f"workbench: the launcher died: {type(error).__name__}: {reason}", file=sys.stderr)
            if not (rest := rest_of(progress)):
                return
            print(f"workbench: it is started again for {len(progress.not_begun())} jobs", file=sys.stderr)
        finally:
            sys.argv = before


@hydra.main(version_base="1.3", config_path="pkg://workbench.conf", config_name="config")
def _job(config: DictConfig) -> float | None:
    """Run one job and return the number that a tuner minimises, see `metric_of`."""
    print_warnings()
    settings, sweep = HydraConfig.get(), config.sweep
    config = OmegaConf.masked_copy(config, [str(key) for key in config if key != "sweep"])  # as when it runs alone
    experiment = str(settings.runtime.choices.get("experiment") or "custom")
    if settings.mode == RunMode.MULTIRUN:
        return run_job(config, sweep, experiment, settings)
    from workbench.experiment.provenance import Command
    from workbench.experiment.run import execute  # here, so that help and a sweep's own process do without

    try:
        choices = {str(group): str(option) for group, option in settings.runtime.choices.items()}
        command = Command(list(settings.overrides.task), choices)
        stop = None if sweep.stop_if is None else parse_stop_condition(sweep.stop_if)
        summary = execute(config, experiment, Path(settings.runtime.output_dir), command=command, stop=stop)
        metric = metric_of({**summary.metrics, **summary.cost}, sweep.objective)
    except Exception as error:
        if (code := report_error(error)) is None:
            raise
        sys.exit(code)  # Hydra adds a line to any exception
    _log(summary)
    return metric


def _log(summary: "Summary") -> None:
    for line in summary_lines(summary):
        log.info("%s", line)


prepare_hydra()  # here, since the workers of a launcher import this module and call no `run`
