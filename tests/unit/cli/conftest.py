"""Fixtures of the tests of commands."""

import pytest


@pytest.fixture(autouse=True)
def without_sandbox(trusted):
    """Read recordings and libraries directly."""
