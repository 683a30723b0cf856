"""What tests of several commands need."""

import pytest


@pytest.fixture(autouse=True)
def trusted(monkeypatch):
    """Recordings of the tests' own making need no other process to read them first, which takes a second."""
    monkeypatch.setattr("workbench.recording.read.probe.fatal", lambda paths, whole=False: set())
