"""Which kernels a run is going to call that take seconds to compile: another process begins with them at once."""

from collections.abc import Iterator, Mapping
from typing import Any

from omegaconf import DictConfig, OmegaConf

from workbench.compiled_beside import compile_beside
from workbench.experiment.compatibility import unread

_ROOM = "workbench.likelihoods"
_KERNEL, _POINTS = f"{_ROOM}.image_motion.kernel", f"{_ROOM}.limb_points"
_LONGEST = {
    f"{_ROOM}.image_motion.ImageMotion": ("_run", _KERNEL),
    f"{_ROOM}.alignment.alignment.Alignment": ("place_points", _POINTS),
    f"{_ROOM}.appearance.Appearance": ("place_points", _POINTS),
    f"{_ROOM}.background.Background": ("place_points", _POINTS),
    f"{_ROOM}.edges.Edges": ("place_points", _POINTS),
    f"{_ROOM}.silhouette.Silhouette": ("place_points", _POINTS),
}
"""By a likelihood's target: which of _KERNEL takes longest, and the module that can have it compiled ahead."""


def compile_ahead(config: DictConfig) -> None:
    """Begin to compile what the configured likelihood takes longest to compile, where no earlier run has."""
    if config.likelihood is None or unread(config):
        return
    for target in _targets(OmegaConf.to_container(config.likelihood, resolve=True)):
        if target in _LONGEST:
            kernel, by = _LONGEST[target]
            compile_beside(_KERNEL, kernel, by=by)


def _targets(likelihood: Any) -> Iterator[str]:
    """The likelihood's target, or those of a product's terms that have a weight."""
    yield likelihood["_target_"]
    weights: Mapping[str, float] = likelihood.get("weights") or {}
    yield from (term["_target_"] for name, term in (likelihood.get("terms") or {}).items() if weights.get(name))
