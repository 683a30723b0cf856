"""Runs without a recording; only their metrics are returned."""

from collections.abc import Sequence
from pathlib import Path

from hydra import compose, initialize_config_module
from hydra.errors import HydraException
from omegaconf import DictConfig
from threadpoolctl import threadpool_limits

from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.summary import Summary
from workbench.experiment.tracking import Meter, assemble, track
from workbench.utils.errors import InputError


def composed(overrides: Sequence[str]) -> DictConfig:
    """Return the configuration that `workbench` would run; raises InputError for invalid overrides."""
    prepare_hydra()
    try:
        with initialize_config_module("workbench.conf", version_base="1.3"):
            return compose("config", overrides=list(overrides))
    except HydraException as error:
        raise InputError(" ".join(str(error).split())) from error


def finished(config: DictConfig, experiment: str) -> Summary:
    """Return the summary of a configuration's run, on one BLAS thread as in `workbench`; raises InputError likewise."""
    summary = Summary(experiment=experiment, seed=int(config.seed), recording=Path("none"))
    with threadpool_limits(limits=1, user_api="blas"):
        parts = assemble(config)
        meter = Meter(parts)
        for step, errors in track(parts, int(config.seed), meter):
            summary.add(step, errors)
    summary.run_metrics = meter.run_metrics
    return summary
