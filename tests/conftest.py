"""What several tests need."""

import os
from pathlib import Path

import pytest
from threadpoolctl import threadpool_limits


@pytest.fixture(scope="session", autouse=True)
def one_blas_thread():
    """As in a run: results do not depend on the number of threads, and small products are not slowed by many."""
    with threadpool_limits(limits=1, user_api="blas"):
        yield


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder with the real recordings; the test is skipped where there is none."""
    folder = Path(os.environ.get("WORKBENCH_DATA", Path(__file__).parents[1] / ".." / "shared" / "data")).resolve()
    if not (folder / "cmu" / "index.csv").is_file():
        pytest.skip(f"no real recordings: set WORKBENCH_DATA (looked in {folder})")
    return folder
