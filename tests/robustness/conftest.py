"""Bounds on the memory of every test of untrusted files."""

from pathlib import Path

import pytest

MOST_MB = 600
_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def _mb(key):
    (kb,) = (line.split()[1] for line in _STATUS.read_text().splitlines() if line.startswith(key))
    return int(kb) // 1024


@pytest.fixture(autouse=True)
def little_memory():
    """Fail a test whose readers take much memory, even for a moment."""
    if not _RESET.exists():
        yield
        return
    _RESET.write_text("5")  # forgets the peak so far
    before = _mb("VmRSS")
    yield
    assert _mb("VmHWM") - before < MOST_MB
