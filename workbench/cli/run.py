"""The main command: compose a configuration, run it, say what came out."""

import logging
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from workbench.cli.parts import listing
from workbench.errors import InputError
from workbench.experiment.parts import name_parts, parts_in
from workbench.experiment.schema import prepare_hydra
from workbench.sweep.plan import metric_of, run_job
from workbench.sweep.progress import Watch, close, rest_of

log = logging.getLogger(__name__)

if TYPE_CHECKING:
    from workbench.experiment.summary import Summary

MENDABLE = (InputError, HydraException, OmegaConfBaseException, KeyboardInterrupt)
"""What is told in one sentence; anything else is a defect of ours and shows its traceback."""

LAUNCHER_DIED = RuntimeError
"""What joblib (BrokenProcessPool) and submitit (UncompletedJobError) raise when a process of theirs is killed."""

HELP = """usage: workbench [group=option | key=value]... [-m]

{}

An experiment chooses the parts and sets their keys; what stands on the command line replaces that:
  workbench experiment=walk_best prior=implicit seed=3
  workbench from=RUN.rrd seed=4                       the configuration of a recording, with changes
workbench-parts prior.jitter says what the keys of an option are. -m runs a sweep: seed=1,2,3 or 'seed=range(5)'.
--cfg job prints the configuration and runs nothing, --hydra-help says what else there is."""


def main() -> int:
    """`workbench [overrides]`: exit code 0 when all runs are complete, 2 for bad input, 1 for any other failure."""
    os.environ.setdefault("HYDRA_FULL_ERROR", "1")  # errors reach us instead of Hydra's own report
    arguments, Watch.progress = sys.argv[1:], None
    code = 0
    try:
        name_parts(parts_in(arguments))
        if "--help" in arguments or "-h" in arguments:
            print(HELP.format(listing()))
            return 0
        if any(text.startswith("from=") for text in arguments):
            _branch(arguments)
        else:
            _whole_sweep(arguments)
    except MENDABLE as error:
        code = _tell(error)
    finally:
        if Watch.progress is not None:
            Watch.progress.stop()
            code = code if code == 2 else max(code, close(Watch.progress, arguments))
    return code


def _branch(arguments: list[str]) -> None:
    """Run a recorded configuration with changes, without Hydra's own way of composing one."""
    from workbench.experiment.branch import branch  # here, as in `_job`

    root = logging.getLogger()
    root.addHandler(logging.StreamHandler(sys.stdout))
    root.setLevel(logging.INFO)
    logging.captureWarnings(True)
    _report(branch(arguments))


def _whole_sweep(arguments: list[str]) -> None:
    """Run Hydra; when a sweep's launcher dies of one job, run it again for those that have not ended."""
    left: list[str] = []
    while True:
        sys.argv[1:] = [*arguments, *left]
        try:
            _job()
            return
        except LAUNCHER_DIED as error:
            if (progress := Watch.progress) is None:
                raise
            progress.stop()
            before, left = left, rest_of(progress)
            reason = next(iter(str(error).splitlines()), "")  # pages follow, of what its process printed
            print(f"workbench: the launcher died: {type(error).__name__}: {reason}", file=sys.stderr)
            if not left or left == before:  # all have ended, or none did this time
                return
            print(f"workbench: it is started again for {len(progress.cut())} jobs", file=sys.stderr)


@hydra.main(version_base="1.3", config_path="pkg://workbench.conf", config_name="config")
def _job(config: DictConfig) -> float | None:
    """One job; returns the number a tuner minimises, see `metric_of`."""
    logging.captureWarnings(True)
    settings, sweep = HydraConfig.get(), config.sweep
    name_parts(parts_in(settings.overrides.task))  # as a launcher's worker has not seen the command line
    config = OmegaConf.masked_copy(config, [str(key) for key in config if key != "sweep"])  # as when it runs alone
    experiment = str(settings.runtime.choices.get("experiment") or "custom")
    if settings.mode == RunMode.MULTIRUN:
        return run_job(config, sweep, experiment, settings)
    from workbench.experiment.execute import execute  # here, so that help and a sweep's own process do without
    from workbench.experiment.provenance import Command
    from workbench.inference.particles.filter import DegenerateWeights

    try:
        choices = {str(group): str(option) for group, option in settings.runtime.choices.items()}
        command = Command(list(settings.overrides.task), choices)
        summary = execute(config, experiment, Path(settings.runtime.output_dir), command=command)
        metric = metric_of({**summary.metrics, **summary.cost}, sweep.metric)
    except (*MENDABLE, DegenerateWeights) as error:
        sys.exit(_tell(error))
    _report(summary)
    return metric


def _tell(error: BaseException) -> int:
    """Print the error as one sentence; the exit code it stands for."""
    if isinstance(error, KeyboardInterrupt):
        print("workbench: interrupted; what was recorded is kept as run.rrd.part", file=sys.stderr)
        return 130
    print(f"workbench: {_sentence(error)}", file=sys.stderr)
    return 2 if isinstance(error, MENDABLE) else 1


def _report(summary: "Summary") -> None:
    width = max(map(len, summary.metrics), default=0)
    for name, value in summary.metrics.items():
        log.info("%-*s %10.4g", width, name, value)
    log.info("look at it: workbench-view %s", os.path.relpath(summary.recording))


def _sentence(error: BaseException) -> str:
    """The error and, for Hydra's wrappers, its cause, in one line without Hydra's hints on debugging."""
    parts: list[str] = []
    cause: BaseException | None = error
    while cause is not None:
        text = " ".join(str(cause).split())
        if text and not any(text in part for part in parts):
            parts.append(text)
        cause = cause.__cause__
    return ": ".join(parts)


prepare_hydra()  # here, since the workers of a launcher import this module and call no `main`
