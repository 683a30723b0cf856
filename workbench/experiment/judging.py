"""The verdict on a run of these parts and this configuration, and which of its numbers say nothing by construction."""

from collections.abc import Mapping
from typing import Any

from omegaconf import DictConfig

from workbench.body.angles import FLEXIONS
from workbench.core.capabilities import EVEN_WEIGHTS, FIT, IMAGES, KEYPOINTS, POINTS
from workbench.evaluation.verdict import RunInputs
from workbench.experiment.config.compatibility import traits_of
from workbench.experiment.tracking import Parts


def told(config: DictConfig, settings: Mapping[str, Any], parts: Parts) -> RunInputs:
    """Collect what a run was told that its frames may contradict. settings: the configuration, resolved."""
    known, body = parts.clip.known, settings.get("body") or {}
    iterations = (settings.get("inference") or {}).get("max_iterations")
    return RunInputs(
        height_m=body.get("height_m"),
        max_iterations=float(iterations) if isinstance(iterations, int) else None,
        rate_hz=known.rate_hz,
        source_rate_hz=known.source_rate_hz,
        seen=bool(traits_of(config.dataset).offers & {IMAGES, KEYPOINTS, POINTS}),
    )


def constant(config: DictConfig, parts: Parts) -> frozenset[str]:
    """Name the numbers that are the same in every run of such parts: those of even weights, which a likelihood that
    sees nothing leaves too, and of a fit, the flexion of legs that do not move."""
    offers = traits_of(config.inference).offers
    seen = frozenset() if config.likelihood is None else traits_of(config.likelihood).offers
    names = {"ess", "ess_mean"} if EVEN_WEIGHTS in offers | seen else set()
    names |= {f"{error}_map" for error in ("error_abs_mm", "error_rel_mm", "error_px")} if FIT in offers else set()
    for joint in ("knee", "hip"):
        angles = {angle for name, signs in FLEXIONS.items() if name.endswith(joint) for angle in signs}
        names |= set() if angles & set(parts.parameters) else {f"{joint}_deg"}
    return frozenset(names)
