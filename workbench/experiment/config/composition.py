"""Composing the workbench's configuration, also within another Hydra application."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from hydra import compose, initialize_config_module, version
from hydra.core.global_hydra import GlobalHydra
from omegaconf import DictConfig

from workbench.experiment.config.schema import prepare_hydra


def composed(overrides: Sequence[str], with_hydra: bool = False) -> DictConfig:
    """Compose the configuration as the command `workbench` does.

    Parameters
    ----------
    overrides
        As on the command line, such as "experiment=walk_circle" and "seed=3".
    with_hydra
        Keep Hydra's own settings, under `hydra`.

    Raises
    ------
    HydraException, OmegaConfBaseException
        As Hydra.
    """
    prepare_hydra()
    with _own_hydra(), initialize_config_module("workbench.conf", version_base="1.3"):
        return compose("config", list(overrides), return_hydra_config=with_hydra)


@contextmanager
def _own_hydra() -> Iterator[None]:
    """Set the caller's Hydra application, if there is one, aside for the block."""
    application, base = GlobalHydra.instance().hydra, version.getbase()
    GlobalHydra.instance().clear()
    try:
        yield
    finally:
        GlobalHydra.instance().hydra = application
        if application is not None and base is not None:
            version.VersionBase.instance().setbase(base)
