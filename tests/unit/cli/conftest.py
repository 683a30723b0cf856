"""What tests of several commands need."""

import pytest


@pytest.fixture(autouse=True)
def without_sandbox(trusted):
    """Read recordings and libraries directly."""
