"""Configurations composed by Hydra, cached for all tests."""

from functools import cache

from hydra import compose, initialize_config_module
from omegaconf import DictConfig

from workbench.experiment.config.options import options
from workbench.experiment.config.schema import prepare_hydra

TRACKING = sorted(name for name, option in options("experiment").items() if "_study" not in option.text)
"""Experiments that are not studies."""
DATA = "somewhere"
"""A placeholder for the folder with the recordings."""


@cache
def composed(*overrides: str) -> DictConfig:
    """Return the configuration with these overrides and recorded motions; callers must not change it."""
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        return compose("config", overrides=[f"paths.data={DATA}", *overrides])
