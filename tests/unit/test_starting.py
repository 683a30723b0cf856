"""A command that is asked to end before it has begun says so in a sentence, wherever in its imports it is."""

import signal
import subprocess
import sys

import pytest

ASKED = """
import os, runpy, signal, sys
number, wanted, reached = signal.{number}, {at!r}, False
sys.orig_argv, sys.argv = [sys.executable, "-m", "workbench"], ["-m", "--help"]
def asked(event, arguments):
    global reached
    if event == "import" and arguments[0] == wanted and not reached:
        reached = True
        os.kill(os.getpid(), number)
sys.addaudithook(asked)
runpy.run_module("workbench", run_name="__main__", alter_sys=True)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("at", ["importlib.metadata", "workbench.cli", "hydra", "omegaconf", "workbench.cli.sentences"])
def test_a_command_that_is_asked_to_end_while_it_imports_says_so(number, at):
    command = [sys.executable, "-c", ASKED.format(number=number.name, at=at)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (
        128 + number,
        "",
        f"workbench: interrupted by {number.name}\n",
    )
