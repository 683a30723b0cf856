"""What several tests need."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder with the real recordings; the test is skipped where there is none."""
    folder = Path(os.environ.get("WORKBENCH_DATA", Path(__file__).parents[1] / ".." / "shared" / "data")).resolve()
    if not (folder / "cmu" / "index.csv").is_file():
        pytest.skip(f"no real recordings: set WORKBENCH_DATA (looked in {folder})")
    return folder
