"""One code path of OpenBLAS on every processor, so that a run's bits do not depend on which one it is on."""

import os
from collections.abc import MutableMapping
from pathlib import Path

_VARIABLE = "OPENBLAS_CORETYPE"
_CPU_INFO = Path("/proc/cpuinfo")


def use_one_code_path(environment: MutableMapping[str, str] = os.environ, cpu_info: Path = _CPU_INFO) -> None:
    """Have OpenBLAS take what x86 processors have had since 2013, before NumPy and SciPy load it.

    Left to itself it takes what is fastest on the processor it finds, whose sums round otherwise; a particle filter
    makes another run of that. Says nothing where the user has chosen, and where there is no such processor or Linux.
    """
    if _VARIABLE in environment:
        return
    try:
        told = cpu_info.read_text(errors="replace")
    except OSError:  # another system, which keeps its own way
        return
    flags = next((line.split() for line in told.splitlines() if line.startswith("flags")), [])
    if {"avx2", "fma"} <= set(flags):
        environment[_VARIABLE] = "Haswell"
