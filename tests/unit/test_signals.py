"""Signals that ask a process to end."""

import importlib
import os
import signal
import subprocess
import sys
import time
import timeit

import pytest

from workbench import signals
from workbench.signals import Asked, ending_as_interrupted, held_back


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_interrupts_once_and_what_was_before_is_there_again(number):
    before = signal.getsignal(number)
    caught = []

    def work():
        try:
            os.kill(os.getpid(), number)
        finally:  # closing is not interrupted
            os.kill(os.getpid(), signal.SIGTERM)
            caught.append(number)

    with pytest.raises(Asked, match=number.name) as error, ending_as_interrupted():
        work()
    assert (error.value.number, caught) == (number, [number])
    assert isinstance(error.value, KeyboardInterrupt)
    assert signal.getsignal(number) is before


def test_it_waits_where_it_would_be_lost(monkeypatch):
    """Below functions of some files, as callbacks from LLVM are."""
    monkeypatch.setattr(signals, "_NOT_IN", ("/timeit.py",))
    reached = []

    def callback():
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.12)
        reached.append(1)

    def work():
        timeit.repeat(callback, repeat=1, number=1)
        time.sleep(1.0)
        reached.append(2)

    with pytest.raises(Asked, match="SIGTERM"), ending_as_interrupted():
        work()
    assert reached == [1]


def test_it_waits_until_a_module_is_whole(tmp_path, monkeypatch):
    kill = f"os.kill(os.getpid(), {int(signal.SIGTERM)})"
    (tmp_path / "asked_in_an_import.py").write_text(f"import os, time\n{kill}\ntime.sleep(0.12)\nwhole = True\n")
    monkeypatch.syspath_prepend(tmp_path)

    def work():
        importlib.import_module("asked_in_an_import")
        time.sleep(1.0)

    with pytest.raises(Asked, match="SIGTERM"), ending_as_interrupted():
        work()
    assert sys.modules.pop("asked_in_an_import").whole


def test_what_is_ignored_as_under_nohup_stays_so():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with ending_as_interrupted():
            os.kill(os.getpid(), signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_process_gets_what_was_held_back_when_it_is_ready():
    ready = """
import sys
from workbench import signals
from workbench.signals import Asked, ending_as_interrupted
try:
    with ending_as_interrupted():
        print("too far")
except Asked as asked:
    print(asked)
"""
    with held_back() as release:
        process = subprocess.Popen([sys.executable, "-c", ready], stdout=subprocess.PIPE, text=True)
        release()
    process.send_signal(signal.SIGTERM)  # in its first moments, in which it would otherwise end without a word
    assert process.communicate()[0] == "SIGTERM\n"
