"""A workbench for tracking articulated people in 3-D."""

from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from workbench.kernel_cache import use_kernel_cache

try:
    __version__ = version("workbench")
except PackageNotFoundError:  # imported from a source tree that was never installed
    __version__ = "0+unknown"

use_kernel_cache(Path(__file__).parent)  # before any kernel is defined
