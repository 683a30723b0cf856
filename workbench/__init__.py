"""A workbench for tracking articulated people in 3-D."""

import workbench.starting  # noqa: F401 (before anything that takes long)

# isort: split
import os
from importlib import import_module
from pathlib import Path
from typing import Any

from workbench.blas import use_one_code_path
from workbench.kernel_cache import use_kernel_cache

__version__ = "0.1.0"  # here alone: pyproject.toml reads it

use_kernel_cache(Path(__file__).parent)  # before any kernel is defined

# Read when numba is imported. Its own 3 compiles kernels a fifth longer, to the same bits, which then run no faster
# but for image motion, by a twentieth.
os.environ.setdefault("NUMBA_OPT", "2")

use_one_code_path()  # before NumPy is loaded

os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(1 << 27))  # of an image file, which OpenCV asks when it loads

_HOMES = {
    "Clip": "core.clip",
    "Cyclic": "priors.cyclic",
    "ImageMotion": "likelihoods.image_motion",
    "ParticleFilter": "inference.particles.filter",
    "Parts": "experiment.tracking",
    "Recorder": "recording.write.recorder",
    "Smooth": "priors.smooth",
    "Synthetic": "datasets.synthetic",
    "person": "body.limbs",
    "read": "recording.read.reader",
    "record": "api",
    "run": "api",
    "runs": "catalog.runs",
    "track": "experiment.tracking",
    "walking_model": "learning.training",
}
"""What `from workbench import …` gives, and the module it is from, which is imported when it is asked for."""

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'workbench' has no attribute {name!r}")
    return getattr(import_module(f"workbench.{_HOMES[name]}"), name)
