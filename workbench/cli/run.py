"""The main command: compose a configuration, run it, say what came out."""

import logging
import os
import sys
from pathlib import Path

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from workbench.cli.execute import execute
from workbench.cli.schema import register_schemas
from workbench.cli.summary import Summary
from workbench.cli.sweep import metric_of, run_job
from workbench.cli.watch import Watch, close, rest_of
from workbench.errors import InputError
from workbench.inference.particle_filter import DegenerateWeights

log = logging.getLogger(__name__)

MENDABLE = (InputError, DegenerateWeights, HydraException, OmegaConfBaseException, KeyboardInterrupt)
"""What is told in one sentence; anything else is a defect of ours and shows its traceback."""

LAUNCHER_DIED = RuntimeError
"""What joblib (BrokenProcessPool) and submitit (UncompletedJobError) raise when a process of theirs is killed."""


def main() -> int:
    """`workbench [overrides]`: exit code 0 when all runs are complete, 2 for bad input, 1 for any other failure."""
    os.environ.setdefault("HYDRA_FULL_ERROR", "1")  # errors reach us instead of Hydra's own report
    arguments, Watch.progress = sys.argv[1:], None
    code = 0
    try:
        _whole_sweep(arguments)
    except MENDABLE as error:
        code = _tell(error)
    finally:
        if Watch.progress is not None:
            Watch.progress.stop()
            code = code if code == 2 else max(code, close(Watch.progress, arguments))
    return code


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


def prepare_hydra() -> None:
    """Register what `conf/` refers to: the groups' schemas and its resolvers."""
    register_schemas()
    OmegaConf.register_new_resolver("unless_builtin", _unless_builtin, replace=True)
    OmegaConf.register_new_resolver("recorded_or_builtin", _recorded_or_builtin, replace=True)
    OmegaConf.register_new_resolver("either", _either, replace=True)


@hydra.main(version_base="1.3", config_path="pkg://workbench.conf", config_name="config")
def _job(config: DictConfig) -> float | None:
    """One job; returns the number a tuner minimises, see `metric_of`."""
    logging.captureWarnings(True)
    settings, sweep = HydraConfig.get(), config.sweep
    config = OmegaConf.masked_copy(config, [str(key) for key in config if key != "sweep"])  # as when it runs alone
    experiment = str(settings.runtime.choices.get("experiment") or "custom")
    if settings.mode == RunMode.MULTIRUN:
        return run_job(config, sweep, experiment, settings)
    try:
        summary = execute(config, experiment, Path(settings.runtime.output_dir))
        metric = metric_of({**summary.metrics, **summary.cost}, sweep.metric)
    except MENDABLE as error:
        sys.exit(_tell(error))
    _report(summary)
    return metric


def _tell(error: BaseException) -> int:
    """Print the error as one sentence; the exit code it stands for."""
    if isinstance(error, KeyboardInterrupt):
        print("workbench: interrupted; what was recorded is kept as run.rrd.part", file=sys.stderr)
        return 130
    print(f"workbench: {_sentence(error)}", file=sys.stderr)
    return 1 if isinstance(error, DegenerateWeights) else 2


def _report(summary: Summary) -> None:
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


def _unless_builtin(motion: str, value: object, otherwise: object) -> object:
    """`value` where the motion is a recorded clip, `otherwise` for the built-in walker."""
    return otherwise if motion == "builtin" else value


def _either(value: object, otherwise: object) -> object:
    """`value` where there is one."""
    return otherwise if value is None else value


def _recorded_or_builtin(data: str | None) -> str:
    """The motions to study: recorded walks where there is a folder with recordings."""
    return "builtin" if data is None else "cmu"


prepare_hydra()  # here, since the workers of a launcher import this module and call no `main`


if __name__ == "__main__":
    sys.exit(main())
