"""What tests of several models need."""

import pytest


@pytest.fixture(autouse=True)
def without_sandbox(trusted):
    """Read libraries and models directly."""
