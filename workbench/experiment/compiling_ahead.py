"""Which kernels a run is going to call that take seconds to compile: another process begins with them at once."""

from collections.abc import Iterator, Mapping
from typing import Any

from omegaconf import DictConfig, OmegaConf

from workbench.compiled_beside import compile_beside
from workbench.experiment.compatibility import unread

_ROOM = "workbench.likelihoods"
_MOTION, _ALIGNMENT = f"{_ROOM}.image_motion.kernel", f"{_ROOM}.alignment"
_POINTS = ((_MOTION, "place_points"), f"{_ROOM}.limb_points")
_SLOW: dict[str, tuple[tuple[tuple[str, ...], str], ...]] = {
    f"{_ROOM}.image_motion.ImageMotion": (((_MOTION, "_run"), _MOTION),),
    f"{_ROOM}.alignment.alignment.Alignment": (
        _POINTS,
        ((f"{_ALIGNMENT}.kernels", "place", "see", "place_beside", "turn_axes", "add_normal"), f"{_ALIGNMENT}.kernels"),
        ((f"{_ALIGNMENT}.layers", "_draw_all", "_log_ratios"), f"{_ALIGNMENT}.layers"),
    ),
    f"{_ROOM}.appearance.Appearance": (_POINTS,),
    f"{_ROOM}.background.Background": (_POINTS,),
    f"{_ROOM}.edges.Edges": (_POINTS,),
    f"{_ROOM}.silhouette.Silhouette": (_POINTS,),
}
"""By a likelihood's target, for each process: a module, its kernels, and the module that has them compiled ahead."""


def compile_ahead(config: DictConfig) -> None:
    """Begin to compile what the configured likelihood takes longest to compile, where no earlier run has."""
    if config.likelihood is None or unread(config):
        return
    for target in _targets(OmegaConf.to_container(config.likelihood, resolve=True)):
        for kernels, by in _SLOW.get(target, ()):
            compile_beside(*kernels, by=by)


def _targets(likelihood: Any) -> Iterator[str]:
    """The likelihood's target, or those of a product's terms that have a weight."""
    yield likelihood["_target_"]
    weights: Mapping[str, float] = likelihood.get("weights") or {}
    yield from (term["_target_"] for name, term in (likelihood.get("terms") or {}).items() if weights.get(name))
