"""Runs without a recording; only their metrics and series over frames are returned."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from hydra.errors import HydraException
from omegaconf import DictConfig

from analysis.figures.step_values import step_values
from workbench.experiment.config import schema
from workbench.experiment.config.instantiate import build
from workbench.experiment.summary import Summary
from workbench.experiment.tracking import Meter, assemble, track
from workbench.utils.errors import InputError
from workbench.utils.parallel import single_blas_thread
from workbench.utils.rng import rng_streams

SERIES = (
    "mpjpe_px", "forearm_width_px", "mpjpe_mm", "mpjpe_abs_mm", "knee_flexion_rmse_deg", "hip_flexion_rmse_deg",
    "activity_accuracy",
)  # fmt: skip
"""Errors of every frame that a result contains."""


@dataclass(frozen=True)
class Result:
    """Result of a run. metrics: with its cost. series: over the frames after the first, by name, of SERIES and
    `step_values`; {} of a study. seconds: of the whole run."""

    metrics: Mapping[str, float]
    series: Mapping[str, Sequence[float]]
    seconds: float


def composed(overrides: Sequence[str]) -> DictConfig:
    """Return the configuration that `workbench` would run; raises InputError for invalid overrides."""
    try:
        return schema.composed(overrides)
    except HydraException as error:
        raise InputError(" ".join(str(error).split())) from error


def measured(config: DictConfig, experiment: str) -> Result:
    """Return the result of a configuration's run, on one BLAS thread as in `workbench`; raises InputError likewise."""
    summary, began_s = Summary(experiment, int(config.seed), Path("none")), perf_counter()
    series: dict[str, list[float]] = {}
    with single_blas_thread():
        if config.study is None:
            series = _tracked(config, summary)
        else:
            prior = None if config.prior is None else build(config.prior)
            before_s = perf_counter()
            summary.study = build(config.study, prior=prior).run(rng_streams(int(config.seed))["study"]).metrics
            summary.timing["study"] = perf_counter() - before_s
    return Result({**summary.metrics, **summary.cost}, series, perf_counter() - began_s)


def _tracked(config: DictConfig, summary: Summary) -> dict[str, list[float]]:
    """Track, add the steps to the summary, and return the series."""
    components = assemble(config)
    meter, skeleton = Meter(components), components.body.skeleton
    series: dict[str, list[float]] = {}
    for step, errors in track(components, int(config.seed), meter):
        summary.add(step, errors)
        if summary.frames > 1:
            for name, value in step_values(step, skeleton).items():
                series.setdefault(name, []).append(value)
    summary.run_metrics = meter.run_metrics
    return {name: summary.per_frame[name].tolist() for name in SERIES if name in summary.per_frame} | series
