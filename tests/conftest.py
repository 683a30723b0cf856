"""Fixtures and settings of all tests."""

import gc
import os
import signal
import sys
from pathlib import Path

import pytest
from hypothesis import settings

import workbench  # noqa: F401 (before NumPy, as in a command, because NumPy's import selects the BLAS kernels)
from workbench.utils.parallel import single_blas_thread

# Write byte code regardless of the environment; otherwise every worker and subprocess would compile all modules.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# Hypothesis uses the same examples in every run and no deadline; pytest --hypothesis-profile=random tries others.
settings.register_profile("fixed", deadline=None, derandomize=True)
settings.register_profile("random", deadline=None)
settings.load_profile("fixed")


def pytest_addoption(parser):
    parser.addoption("--data", metavar="DIR", help="folder of the real recordings ($WORKBENCH_DATA)")
    parser.addoption("--require-data", action="store_true", help="fail tests without their real recordings")


def pytest_collection_finish():
    """Exclude the collected tests from Python's garbage collection, which would take a tenth of the time."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def default_signals():
    """Restore the handlers of a terminal, because nohup and background jobs ignore signals."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.fixture(scope="session", autouse=True)
def one_blas_thread():
    """Use one BLAS thread, as in a run."""
    with single_blas_thread():
        yield


@pytest.fixture
def trusted(monkeypatch):
    """Read the tests' own files without the sandbox, which takes half a second to start."""
    monkeypatch.setattr("workbench.recording.read.crash_probe.crashing_recordings", lambda paths: set())
    for module in ("workbench.motion.hdf5", "workbench.motion.formats.c3d"):
        monkeypatch.setattr(f"{module}.parse_limited", lambda parse, path, what: dict(parse(path)))


@pytest.fixture(scope="session")
def cache(tmp_path_factory) -> Path:
    """Return the session's cache folder for learned models and rendered scenes; tests of caching use another folder."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "cache"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def data(pytestconfig) -> Path:
    """Return the folder of the real recordings; without it, skip the test, or fail it with --require-data."""
    folder = pytestconfig.getoption("--data") or os.environ.get("WORKBENCH_DATA")
    if folder and (Path(folder) / "cmu" / "index.csv").is_file():
        return Path(folder).resolve()
    message = f"no real recordings: expected --data DIR or $WORKBENCH_DATA with cmu/index.csv, found {folder}"
    if pytestconfig.getoption("--require-data"):
        pytest.fail(message)
    pytest.skip(message)
