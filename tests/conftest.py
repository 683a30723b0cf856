"""What several tests need."""

import gc
import os
import signal
import sys
from pathlib import Path

import pytest
from hypothesis import settings
from threadpoolctl import threadpool_limits

import workbench  # noqa: F401 (before NumPy, as a command does: which BLAS is taken is settled when that is loaded)

# Keep byte code whatever the environment says: each worker, and each process that a test starts, would compile it anew.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# Time is measured in benchmarks, not in tests; and whether a change lands is no matter of luck: the same examples every
# time. pytest --hypothesis-profile=anew tries others.
settings.register_profile("same", deadline=None, derandomize=True)
settings.register_profile("anew", deadline=None)
settings.load_profile("same")


def pytest_addoption(parser):
    parser.addoption("--data", metavar="DIR", help="the real recordings ($WORKBENCH_DATA)")
    parser.addoption("--require-data", action="store_true", help="a test without the real recordings it needs fails")


def pytest_collection_finish():
    """Leave what is there before the first test, thousands of tests among it, out of what Python's collector looks
    through again and again, which took a tenth of the time."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def usual_signals():
    """As in a terminal, also where signals are ignored, as by nohup and by jobs in the background."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.fixture(scope="session", autouse=True)
def one_blas_thread():
    """As in a run: results do not depend on the number of threads, and small products are not slowed by many."""
    with threadpool_limits(limits=1, user_api="blas"):
        yield


@pytest.fixture
def trusted(monkeypatch):
    """Read files of the tests' own making without the sandbox, whose start takes half a second."""
    monkeypatch.setattr("workbench.recording.read.crash_probe.crashing_recordings", lambda paths: set())
    monkeypatch.setattr("workbench.utils.hdf5.parse_limited", lambda parse, path, what: dict(parse(path)))


@pytest.fixture(scope="session")
def cache(tmp_path_factory) -> Path:
    """A folder for learned models and rendered scenes, of all tests of a session, so that each is made once; a test
    that looks at what is made has one of its own."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "cache"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def data(pytestconfig) -> Path:
    """The folder with the real recordings; where there is none, the test is skipped, or fails by --require-data."""
    place = pytestconfig.getoption("--data") or os.environ.get("WORKBENCH_DATA")
    if place and (Path(place) / "cmu" / "index.csv").is_file():
        return Path(place).resolve()
    sentence = f"no real recordings: expected --data DIR or $WORKBENCH_DATA with cmu/index.csv, found {place}"
    if pytestconfig.getoption("--require-data"):
        pytest.fail(sentence)
    pytest.skip(sentence)
