"""What tests of several models need."""

import pytest

from workbench import hdf5


@pytest.fixture(autouse=True)
def trusted(monkeypatch):
    """Libraries of the tests' own making need no other process to read them, which takes half a second each time."""
    monkeypatch.setattr("workbench.hdf5._read_apart", hdf5._read_here)
