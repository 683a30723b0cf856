"""The main command: compose a configuration, run it, say what came out."""

import errno
import logging
import os
import re
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from workbench import __version__
from workbench.cli import error_messages as sentences
from workbench.cli.components import listing
from workbench.cli.hydra_quoting import quoted, unquoted
from workbench.cli.run_output import lines, tell_warnings
from workbench.experiment.config.options import name_config_dir, name_parts, parts_in
from workbench.experiment.config.schema import prepare_hydra
from workbench.sweep.early_stop import stop_when
from workbench.sweep.job import metric_of, run_job
from workbench.sweep.table import Watch, close, rest_of
from workbench.utils.errors import InputError, shortened
from workbench.utils.signals import Interrupted, interruptible

log = logging.getLogger(__name__)

if TYPE_CHECKING:
    from workbench.experiment.summary import Summary

MENDABLE = (InputError, HydraException, OmegaConfBaseException, KeyboardInterrupt)
"""What is told in one sentence; anything else is a defect of ours and shows its traceback."""

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""What the operating system says where there is no room to write; told in one sentence, too."""

LAUNCHER_DIED = RuntimeError
"""What joblib (TerminatedWorkerError) and submitit (UncompletedJobError) raise when a process of theirs is killed."""

PLAIN = ("from=", "hydra.run.dir=")
"""Arguments that are not for Hydra where a recording's configuration runs."""

ENVIRONMENT = {
    "HYDRA_FULL_ERROR": "1",  # errors reach `main` instead of Hydra's own report
    "RUST_LOG": "warn,re_log_encoding=off,re_sdk=off",  # a full disk ends the run, which prints one sentence
    "MIMALLOC_PURGE_DELAY": "0",  # Rerun returns free memory at once: a third less for a long run
    "OPENCV_IO_MAX_IMAGE_PIXELS": str(1 << 27),  # of an image file
}
"""What the command sets for itself and the workers of its launcher, unless the user has; read when Rerun and OpenCV are
imported."""

HELP = """usage: workbench [group=option | key=value]... [-m]

To begin with:
  workbench                                           track a person who walks; its last line says how to look at it
  workbench seed=3 inference.n_particles=2000         the same with other numbers
  workbench experiment=points_walk_steady             another experiment; they are listed below
  workbench -m seed=1,2,3                             a sweep; then workbench-view, workbench-report on its folder
  workbench-view RUN.rrd                              look at a run; workbench-runs lists them
  workbench-parts prior.jitter                        what the keys of an option are

Your own video, with a calibrated camera and joints marked or detected:
  workbench experiment=custom dataset=video body=height body.height_m=1.72 dataset.source=walk.mp4 prior=activity \\
      dataset.camera=camera.toml dataset.keypoints=joints.csv likelihood=keypoints inference=least_squares

An experiment chooses the parts and sets their keys; what stands on the command line replaces that:
  workbench experiment=walk_best prior=implicit seed=3
  workbench from=RUN.rrd seed=4                       the configuration of a recording, with changes
  workbench from=RUN.rrd@120 seed=4                   the same from frame 120 on, as the recorded run had got there
--cfg job prints the configuration and runs nothing, --version says which workbench this is, --hydra-help says what
else there is.

{}"""


def main() -> int:
    """`workbench [overrides]`: exit code 0 when all runs are complete, 2 for bad input, 1 for any other failure.

    128 + n where signal n ended it: SIGINT, SIGTERM, SIGHUP.
    """
    for name, value in ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    logging.raiseExceptions = False  # on a full disk, every line of run.log would bring a traceback
    with interruptible(first=Watch.end):
        return _main()


def _main() -> int:
    Watch.progress = None
    arguments: list[str] = []
    code = 0
    try:
        arguments = sorted(map(quoted, sys.argv[1:]), key=_is_override)
        if unnamed := [text for text in arguments if text.startswith("=")]:
            raise InputError(f"expected key=value, found {unnamed[0]!r}")
        name_parts(parts_in(arguments))
        name_config_dir(arguments)
        if "--version" in arguments:
            print(f"workbench {__version__}")
            return 0
        if "--help" in arguments or "-h" in arguments:
            print(HELP.format(listing()))
            return 0
        if any(text.startswith("--experimental-rerun") for text in arguments):
            raise InputError("--experimental-rerun would unpickle a file; from=RUN.rrd runs a recorded configuration")
        if any(text.startswith("from=") for text in arguments):
            _branch([_plain(text) if text.startswith(PLAIN) else text for text in arguments])
        elif there := sentences.mistyped(arguments):
            return _print([*there[:-1], shortened(there[-1])], code=2)
        else:
            _whole_sweep(arguments)
    except MENDABLE as error:
        code = _tell(error)
    except OSError as error:
        if error.errno not in FULL:
            raise
        code = _tell(error)
    finally:
        if Watch.progress is not None:
            left = close(Watch.progress, arguments)
            code = code or left
    return code


def _is_override(argument: str) -> bool:
    """Tell whether it is none of the options that stand for themselves: Hydra reads overrides on one side of these."""
    return argument not in ("-m", "--multirun") and not re.match("--[a-z-]+=", argument)


def _plain(argument: str) -> str:
    key, _, value = argument.partition("=")
    return f"{key}={unquoted(value)}"


def _branch(arguments: list[str]) -> None:
    """Run a recorded configuration with changes, without Hydra's own way of composing one."""
    from workbench.experiment.resume import branch  # here, as in `_job`

    root = logging.getLogger()
    root.addHandler(logging.StreamHandler(sys.stdout))
    root.setLevel(logging.INFO)
    tell_warnings()
    _report(branch(arguments))


def _whole_sweep(arguments: list[str]) -> None:
    """Run Hydra; when joblib dies of a killed worker, run it again for the jobs that have not begun."""
    rest: list[str] = []
    while True:
        sys.argv[1:] = [*arguments, *rest]
        try:
            _job()
            return
        except LAUNCHER_DIED as error:
            if (progress := Watch.progress) is None:
                raise
            progress.stop()
            reason = next(iter(str(error).splitlines()), "")  # pages follow, of what its process printed
            print(f"workbench: the launcher died: {type(error).__name__}: {reason}", file=sys.stderr)
            if not (rest := rest_of(progress)):
                return
            print(f"workbench: it is started again for {len(progress.not_begun())} jobs", file=sys.stderr)


@hydra.main(version_base="1.3", config_path="pkg://workbench.conf", config_name="config")
def _job(config: DictConfig) -> float | None:
    """One job; returns the number a tuner minimises, see `metric_of`."""
    tell_warnings()
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
        stop = None if sweep.stop_when is None else stop_when(sweep.stop_when)
        summary = execute(config, experiment, Path(settings.runtime.output_dir), command=command, stop=stop)
        metric = metric_of({**summary.metrics, **summary.cost}, sweep.metric)
    except MENDABLE as error:
        sys.exit(_tell(error))
    except OSError as error:
        if error.errno not in FULL:
            raise
        sys.exit(_tell(error))
    except _degenerate_weights() as error:
        sys.exit(_tell(error))
    _report(summary)
    return metric


def _degenerate_weights() -> type[Exception]:
    """Return what a filter ends with where it is asked to; a filter takes long to import, which this one has done."""
    from workbench.inference.smc.particle_filter import DegenerateWeights

    return DegenerateWeights


def _tell(error: BaseException) -> int:
    """Print the error as one sentence; the exit code it stands for."""
    if isinstance(error, KeyboardInterrupt):
        number = error.number if isinstance(error, Interrupted) else signal.SIGINT
        by = signal.Signals(number).name
        print(f"workbench: interrupted by {by}; what was recorded is kept", file=sys.stderr)
        return 128 + number
    *there, sentence = sentences.lines(error)
    mendable = isinstance(error, MENDABLE)
    return _print([*there, shortened(sentence) if mendable else sentence], code=2 if mendable else 1)


def _print(told: list[str], code: int) -> int:
    """Print what there is, a line each, and the sentence that comes last; gives the exit code back."""
    *there, sentence = told
    print("\n".join([*there, f"workbench: {sentence}"]), file=sys.stderr)
    return code


def _report(summary: "Summary") -> None:
    for line in lines(summary):
        log.info("%s", line)


prepare_hydra()  # here, since the workers of a launcher import this module and call no `main`
