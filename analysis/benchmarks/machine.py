"""What a benchmark ran on, for its first line."""

import platform
from pathlib import Path

import numba
import numpy as np


def processor() -> str:
    """The processor's name."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def versions() -> str:
    """Versions of Python, NumPy and numba."""
    return f"Python {platform.python_version()}, NumPy {np.__version__}, numba {numba.__version__}"
