"""Fixtures of the tests of commands."""

import cv2
import numpy as np
import pytest


@pytest.fixture(autouse=True)
def without_sandbox(trusted):
    """Read recordings and libraries directly."""


@pytest.fixture
def images(tmp_path):
    """Return a folder of three images."""
    (tmp_path / "images").mkdir()
    for t in range(3):
        cv2.imwrite(str(tmp_path / "images" / f"{t}.png"), np.full((48, 64, 3), 9, np.uint8))
    return tmp_path / "images"
