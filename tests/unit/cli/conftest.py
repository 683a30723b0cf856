"""What tests of several commands need."""

import pytest

from workbench import hdf5


@pytest.fixture(autouse=True)
def trusted(monkeypatch):
    """Files of the tests' own making need no other process to read them, first or at all, which takes a second."""
    monkeypatch.setattr("workbench.recording.read.probe.fatal", lambda paths, whole=False: set())
    monkeypatch.setattr("workbench.hdf5._read_apart", hdf5._read_here)
