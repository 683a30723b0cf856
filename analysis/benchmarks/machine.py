"""What a benchmark ran on, for its first line."""

import os
import platform
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PEERS = ("scikit-fda", "particles", "stonesoup", "filterpy")
"""Other packages that benchmarks measure us against; the extra `bench` installs them."""


def processor() -> str:
    """The processor's name."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def cores() -> int:
    """How many processor cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def versions() -> str:
    """Versions of Python and of what computes, and of the peers that are installed."""
    found = [f"Python {platform.python_version()}"]
    for name in ("numpy", "numba", "scipy", *PEERS):
        with suppress(PackageNotFoundError):
            found.append(f"{name} {version(name)}")
    return ", ".join(found)
