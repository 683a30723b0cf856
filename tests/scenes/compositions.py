"""Configurations as Hydra composes them, each once for all tests."""

from functools import cache

from hydra import compose, initialize_config_module
from omegaconf import DictConfig

from workbench.experiment.config.options import options
from workbench.experiment.config.schema import prepare_hydra

TRACKING = sorted(name for name, each in options("experiment").items() if "_study" not in each.text)
"""Experiments that are no studies."""
DATA = "somewhere"
"""In place of the folder with the recordings."""


@cache
def composed(*overrides: str) -> DictConfig:
    """Compose with these overrides, where there are recordings; nobody may change what is returned."""
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        return compose("config", overrides=[f"paths.data={DATA}", *overrides])
