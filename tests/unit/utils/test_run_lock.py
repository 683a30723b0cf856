"""The lock of a folder: one process at a time, released by the operating system."""

import os
import signal
import subprocess
import sys
import threading
from contextlib import contextmanager

import pytest

from workbench.utils.errors import InputError
from workbench.utils.run_lock import is_locked, locked

HOLDER = """
import sys, time
from pathlib import Path
from workbench.utils.run_lock import locked
with locked(Path(sys.argv[1])):
    print("locked", flush=True)
    time.sleep(60)
"""


@contextmanager
def holder(folder):
    """Another process that holds the lock of the folder."""
    with subprocess.Popen([sys.executable, "-c", HOLDER, str(folder)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "locked\n"
        yield process
        process.kill()


def test_a_second_process_is_refused_by_name_until_the_first_is_killed(tmp_path):
    with holder(tmp_path) as process:
        assert is_locked(tmp_path)
        with (
            pytest.raises(InputError, match=f"process {process.pid} on .* uses this folder"),
            locked(tmp_path),
        ):
            pass
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert not is_locked(tmp_path)
        with locked(tmp_path):
            assert f"process {os.getpid()} on " in (tmp_path / ".lock").read_text()


def test_one_that_waits_gets_the_lock_after_the_other(tmp_path):
    order = []

    def second():
        with locked(tmp_path, wait=True):
            order.append("second")

    with locked(tmp_path):
        other = threading.Thread(target=second)
        other.start()
        other.join(0.2)
        order.append("first")
    other.join()
    assert order == ["first", "second"]


def test_tests_of_the_lock_do_not_refuse_a_run_that_begins(tmp_path):
    """Each holds a shared lock for a moment."""
    over = threading.Event()

    def look():
        while not over.is_set():
            is_locked(tmp_path)

    readers = [threading.Thread(target=look) for _ in range(2)]
    for reader in readers:
        reader.start()
    try:
        for _ in range(50):
            with locked(tmp_path):
                pass
    finally:
        over.set()
        for reader in readers:
            reader.join()
