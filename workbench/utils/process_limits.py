"""Limits and use of memory, time and disk of processes, by what the operating system has.

Windows has no `resource`: there a process cannot limit itself, and its parent watches it, see `run_watched`.
"""

import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import psutil

try:
    import resource
except ModuleNotFoundError:
    resource = None  # type: ignore[assignment]

CAN_LIMIT = resource is not None
"""Whether a process can limit its own memory, processor time and output."""
_PERIOD_S = 0.05


def limit_process(memory_bytes: int, cpu_s: int) -> None:
    """Limit this process's memory and files, processor time, and core dumps, where the system can."""
    if not CAN_LIMIT:
        return
    for limit, maximum in {"DATA": memory_bytes, "FSIZE": memory_bytes, "CPU": cpu_s, "CORE": 0}.items():
        number = getattr(resource, f"RLIMIT_{limit}")
        hard = resource.getrlimit(number)[1]
        resource.setrlimit(number, (hard if 0 <= hard < maximum else maximum,) * 2)


def run_watched(command: Sequence[str], *, memory_bytes: int, timeout_s: float, **options: Any) -> int:
    """Run a command to its end and return its exit code, or −1 if it was killed since it had more memory.

    options: of `subprocess.Popen`. Raises TimeoutError if it was killed after timeout_s.
    """
    with subprocess.Popen(command, **options) as process:
        watched, latest = psutil.Process(process.pid), time.monotonic() + timeout_s
        while process.poll() is None:
            if time.monotonic() > latest:
                process.kill()
                raise TimeoutError(f"{command[0]}: killed after the time limit of {timeout_s:g} s")
            try:
                used = watched.memory_info().rss
            except psutil.Error:  # it has just ended
                used = 0
            if used > memory_bytes:
                process.kill()
                return -1
            time.sleep(_PERIOD_S)
        return process.returncode


def largest_file() -> int | None:
    """Return the largest size of a file that this process may write, bytes; None without a limit."""
    if not CAN_LIMIT:
        return None
    limit, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    return None if limit == resource.RLIM_INFINITY else limit


def peak_bytes() -> int:
    """Return the most memory that this process has had so far, bytes."""
    if (status := Path("/proc/self/status")).is_file():  # `resource` includes what a parent process had
        (peak,) = (line for line in status.read_text(encoding="ascii").splitlines() if line.startswith("VmHWM"))
        return int(peak.split()[1]) * 1024
    if CAN_LIMIT:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # bytes on macOS
    return int(psutil.Process().memory_info()._asdict().get("peak_wset", 0))  # Windows
