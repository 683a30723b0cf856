"""A workbench for tracking articulated people in 3-D."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("workbench")
except PackageNotFoundError:  # imported from a source tree that was never installed
    __version__ = "0+unknown"
