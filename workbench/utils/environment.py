"""Environment that determines the last bits of results: processor features, BLAS code path, versions."""

import platform
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version

import cv2
import numba
import numpy as np
from llvmlite import binding as llvm  # type: ignore[import-untyped]
from threadpoolctl import threadpool_info

_LISTED = 6  # maximum number of listed processor features
PACKAGES = ("numpy", "scipy", "numba", "llvmlite", "opencv-python-headless")


@cache
def environment() -> dict[str, str]:
    """Return the properties that must be equal for bitwise identical runs, by name.

    system: operating system, architecture and C library, which provides `sin`, `exp` and `log`. numpy_cpu,
    opencv_cpu: the processor features in use. numba_cpu: the processor and the features that kernels are compiled for.
    blas: the libraries that are loaded, each with its version and code path. python, numpy, scipy, …: versions.
    """
    libc = "".join(platform.libc_ver())
    return {
        "system": f"{platform.system()} {platform.machine()} {libc}".rstrip(),
        "numpy_cpu": " ".join(np.show_config(mode="dicts")["SIMD Extensions"].get("found", ["baseline"])),
        "opencv_cpu": cv2.getCPUFeaturesLine().strip(),
        "numba_cpu": _numba_cpu(),
        "blas": "; ".join(sorted(_blas())),
        "python": platform.python_version(),
        **{name: version(name) for name in PACKAGES},
    }


def differing(was: Mapping[str, str], now: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    """Return the differing entries with both values; of feature lists only the differing features."""
    pairs = {name: (str(was.get(name, "unknown")), str(now.get(name, "unknown"))) for name in {**was, **now}}
    changed = {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}
    return {name: _shortened(*pair) if name.endswith("_cpu") else pair for name, pair in changed.items()}


def _shortened(first: str, second: str) -> tuple[str, str]:
    one, other = first.split(), second.split()
    unique = ([word for word in one if word not in other], [word for word in other if word not in one])
    texts = [
        " ".join(words[:_LISTED]) + f" and {len(words) - _LISTED} more" * (len(words) > _LISTED) for words in unique
    ]
    return texts[0] or "fewer", texts[1] or "fewer"


def _numba_cpu() -> str:
    name: str = numba.config.CPU_NAME or llvm.get_host_cpu_name()  # type: ignore[attr-defined]
    features: str | None = numba.config.CPU_FEATURES  # type: ignore[attr-defined]
    if features is None:
        features = "" if name == "generic" else llvm.get_host_cpu_features().flatten()
    return " ".join([name, *sorted(name for name in features.split(",") if name.startswith("+"))])


def _blas() -> list[str]:
    import scipy.linalg  # noqa: F401 (loads SciPy's BLAS)

    libraries = [library for library in threadpool_info() if library["user_api"] == "blas"]
    return [f"{item['prefix']} {item['version']} {item.get('architecture', '')}".rstrip() for item in libraries]
