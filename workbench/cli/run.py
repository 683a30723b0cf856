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
from workbench.errors import InputError
from workbench.inference.particle_filter import DegenerateWeights

log = logging.getLogger(__name__)

MENDABLE = (InputError, DegenerateWeights, HydraException, OmegaConfBaseException, KeyboardInterrupt)
"""What is told in one sentence; anything else is a defect of ours and shows its traceback."""


def main() -> int:
    """`workbench [overrides]`: exit code 0 when all runs are complete, 2 for bad input, 1 for any other failure."""
    os.environ.setdefault("HYDRA_FULL_ERROR", "1")  # errors reach us instead of Hydra's own report
    prepare_hydra()
    try:
        _job()
    except MENDABLE as error:
        return _tell(error)
    return 0


def prepare_hydra() -> None:
    """Register what `conf/` refers to: the groups' schemas and its resolvers."""
    register_schemas()
    OmegaConf.register_new_resolver("unless_builtin", _unless_builtin, replace=True)
    OmegaConf.register_new_resolver("recorded_or_builtin", _recorded_or_builtin, replace=True)


@hydra.main(version_base="1.3", config_path="pkg://workbench.conf", config_name="config")
def _job(config: DictConfig) -> float | None:
    """One job; returns the error a sweep minimises: error_abs_mm, or error_px where there is no truth in 3-D."""
    logging.captureWarnings(True)
    settings = HydraConfig.get()
    experiment = str(settings.runtime.choices.get("experiment") or "custom")
    folder = Path(settings.runtime.output_dir)
    many = settings.mode == RunMode.MULTIRUN
    try:
        summary = execute(config, experiment, folder, quiet=many)
    except MENDABLE as error:
        if many:
            raise  # Hydra goes on with the other jobs
        sys.exit(_tell(error))
    _report(summary)
    metrics = summary.metrics
    return metrics.get("error_abs_mm", metrics.get("error_px"))


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
    log.info("look at it: rerun %s", os.path.relpath(summary.recording))


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


def _recorded_or_builtin(data: str | None) -> str:
    """The motions to study: recorded walks where there is a folder with recordings."""
    return "builtin" if data is None else "cmu"


if __name__ == "__main__":
    sys.exit(main())
