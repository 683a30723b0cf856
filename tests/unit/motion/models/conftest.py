"""Fixtures of the tests of motion models."""

import pytest


@pytest.fixture(autouse=True)
def without_sandbox(trusted):
    """Read libraries and models directly."""
