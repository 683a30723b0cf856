"""A workbench for tracking articulated people in 3-D.

Importing it changes nothing in the process: no environment variables, signal handlers or settings of other packages.
"""

from importlib import import_module
from typing import Any

__version__ = "0.2.0"  # here alone: pyproject.toml reads it

_MODULES = {
    "Components": "experiment.tracking",
    "Cyclic": "priors.cyclic",
    "FrameCache": "core.frame_cache",
    "ImageMotion": "likelihoods.image_motion",
    "ParticleFilter": "inference.smc.particle_filter",
    "Recorder": "recording.write.recorder",
    "Smooth": "priors.smooth",
    "Synthetic": "datasets.synthetic",
    "check": "api",
    "person": "body.limbs",
    "read": "recording.read.reader",
    "record": "api",
    "run": "api",
    "runs": "results.table",
    "track": "experiment.tracking",
    "walking_model": "motion.models.training",
}
"""Public names of the package by module; a module is imported on first use."""

__all__ = list(_MODULES)


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'workbench' has no attribute {name!r}")
    return getattr(import_module(f"workbench.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
