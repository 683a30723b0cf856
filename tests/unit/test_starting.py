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


COLLECTED = """
import gc, sys
usual = gc.get_threshold()
sys.argv = {argv!r}
sys.orig_argv = [sys.executable, *sys.argv]
from workbench.starting import collect_as_usual
rarely = gc.get_threshold() > usual and gc.get_freeze_count() == 0
collect_as_usual()
print(rarely, gc.get_threshold() == usual, gc.get_freeze_count() > 0)
"""


@pytest.mark.parametrize(
    ("argv", "rarely"),
    [
        (["/usr/bin/workbench", "seed=3"], True), (["-m", "workbench", "seed=3"], True),
        (["/usr/bin/workbench-runs"], False), (["-m", "workbench.sweep.process"], False), (["mine.py"], False),
    ],
)  # fmt: skip
def test_a_run_and_no_other_command_looks_for_garbage_rarely_until_its_first_frame(argv, rarely):
    command = [sys.executable, "-c", COLLECTED.format(argv=argv)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.split() == [str(rarely), "True", str(rarely)]
