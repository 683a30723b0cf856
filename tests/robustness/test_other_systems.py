"""The commands where what only POSIX systems have is missing for the workbench, as on Windows: simulated in every
process. Libraries have what they need on this system."""

import json
import os
import subprocess
import sys

import pytest

from tests.robustness.test_sandbox import CRASH
from workbench.utils import sandbox
from workbench.utils.errors import InputError
from workbench.utils.process_limits import run_watched
from workbench.utils.sandbox import parse_limited

WITHOUT_POSIX = """
import builtins, os, signal
MODULES = {"fcntl", "resource", "termios", "pwd", "grp", "pty"}
usual = builtins.__import__
def without_posix(name, globals=None, *rest, **named):
    if name in MODULES and str((globals or {}).get("__name__")).startswith(("workbench", "__main__")):
        raise ModuleNotFoundError(f"No module named {name!r}")
    return usual(name, globals, *rest, **named)
builtins.__import__ = without_posix
for module, names in ((os, "fork forkpty sched_getaffinity killpg getuid"), (signal, "SIGHUP SIGQUIT SIGUSR1 alarm")):
    for name in names.split():
        if hasattr(module, name):
            delattr(module, name)
"""
COMMANDS = (
    "run dataset.n_frames=3 inference.n_particles=50 hydra.run.dir={0}/one",
    "run -m dataset.n_frames=3 inference.n_particles=50 seed=0,1 hydra.sweep.dir={0}/sweep",
    "run from={0}/one seed=2 hydra.run.dir={0}/again",
    "runs list {0}",
    "runs watch {0}/sweep",
    "check {0}/one/run.rrd",
    "report {0} -o {0}/report",
    "export {0}/one/run.rrd -o {0}/one.trc",
    "components",
    "runs rm {0} seed=2 --yes",
)


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """Return environment variables with which no Python process has what only POSIX systems have."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "sitecustomize.py").write_text(WITHOUT_POSIX)
    return {**os.environ, "PYTHONPATH": str(folder)}


CALLS = """
import json, sys
from workbench.cli.main import main
for words in json.loads(sys.argv[1]):
    try:
        code = main(words)
    except SystemExit as end:
        code = end.code
    assert not code, words
"""


@pytest.mark.slow
def test_commands_run_without_posix(environment, tmp_path):
    words = [[word.format(tmp_path) for word in command.split()] for command in COMMANDS]
    for command in (["-m", "workbench", *words[0]], ["-c", CALLS, json.dumps(words[1:])]):
        done = subprocess.run(
            [sys.executable, *command], env=environment, cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert (done.returncode, "Traceback" in done.stderr) == (0, False), f"{command}: {done.stderr}"


HOARDER = "import time; data = bytearray(300_000_000); data[::4096] = bytes(len(data[::4096])); time.sleep(60)"


def test_a_watched_process_is_killed_with_too_much_memory():
    assert run_watched([sys.executable, "-c", HOARDER], memory_bytes=200_000_000, timeout_s=60.0) == -1


def test_a_watched_process_ends_with_its_code_or_is_killed_after_its_time():
    assert run_watched([sys.executable, "-c", "import sys; sys.exit(3)"], memory_bytes=10**9, timeout_s=60.0) == 3
    with pytest.raises(TimeoutError, match=r"0\.3 s"):
        run_watched([sys.executable, "-c", "while True: pass"], memory_bytes=10**9, timeout_s=0.3)


@pytest.mark.slow
def test_a_parser_is_watched_where_it_cannot_limit_itself(tmp_path, monkeypatch, environment):
    (tmp_path / "a.x").write_text("12345")
    source = "def hoards(path):\n    import numpy as np\n    return {'a': np.ones(10**8)}\n"
    (tmp_path / "hoarding_parser.py").write_text(source)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{environment['PYTHONPATH']}")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sandbox, "CAN_LIMIT", False)
    monkeypatch.setattr(sandbox, "MEMORY_BYTES", 300_000_000)
    with pytest.raises(InputError, match=CRASH):
        parse_limited(__import__("hoarding_parser").hoards, tmp_path / "a.x", what="an x")
