"""The lock of a folder: held by one process at a time and released by the operating system."""

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
    """Run another process that holds the lock of the folder."""
    with subprocess.Popen([sys.executable, "-c", HOLDER, str(folder)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "locked\n"
        yield process
        process.kill()


def test_a_second_process_is_rejected_until_the_first_is_killed(tmp_path):
    with holder(tmp_path) as process:
        assert is_locked(tmp_path)
        with pytest.raises(InputError, match=f"process {process.pid} on .* uses this folder"), locked(tmp_path):
            pass
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert not is_locked(tmp_path)
        with locked(tmp_path):
            assert f"process {os.getpid()} on " in (tmp_path / ".lock").read_text()


def test_a_waiting_thread_gets_the_lock_after_the_first(tmp_path):
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


def test_checks_of_the_lock_do_not_reject_a_starting_run(tmp_path):
    """A check holds a shared lock for a moment."""
    finished = threading.Event()

    def check():
        while not finished.is_set():
            is_locked(tmp_path)

    readers = [threading.Thread(target=check) for _ in range(2)]
    for reader in readers:
        reader.start()
    try:
        for _ in range(50):
            with locked(tmp_path):
                pass
    finally:
        finished.set()
        for reader in readers:
            reader.join()
