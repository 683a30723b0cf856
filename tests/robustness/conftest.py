"""Bound the memory that a test of untrusted files may take."""

from pathlib import Path

import pytest

MAX_MB = 600
_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def _mb(key):
    (kb,) = (line.split()[1] for line in _STATUS.read_text().splitlines() if line.startswith(key))
    return int(kb) // 1024


@pytest.fixture(autouse=True)
def memory_limit():
    """Fail a test whose peak memory exceeds that before it by MAX_MB."""
    if not _RESET.exists():
        yield
        return
    _RESET.write_text("5")  # resets the peak
    before = _mb("VmRSS")
    yield
    assert _mb("VmHWM") - before < MAX_MB
