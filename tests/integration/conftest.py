"""The main command as the integration tests call it: without recordings, and with a cache of their own."""

import json
import logging
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from workbench.cli.main import main


@dataclass(frozen=True)
class Done:
    """What a command came to: its exit code, what it printed, the folder of the run. Unpacks to code, told, folder."""

    code: int
    out: str
    err: str
    folder: Path

    def __iter__(self):
        return iter((self.code, self.out + self.err, self.folder))


@pytest.fixture(autouse=True)
def no_handlers_left():
    """Hydra's would go on writing to the output of the test that called it, which is closed by then."""
    yield
    root = logging.getLogger()
    for handler in root.handlers[:]:
        if type(handler) in (logging.StreamHandler, logging.FileHandler):
            root.removeHandler(handler)


@pytest.fixture
def run(tmp_path, cache, monkeypatch, capfd, request):
    """Run the command in this process, which saves the imports; within: the folder to stand in, with a cache there.

    suspicious: recordings and libraries go through the sandbox, as usual, which takes a second more."""

    def command(folder, *overrides, within=None, suspicious=False):
        if not suspicious:
            request.getfixturevalue("trusted")
        monkeypatch.chdir(within or tmp_path)
        monkeypatch.setenv("WORKBENCH_CACHE", str(within / "cache" if within else cache))
        monkeypatch.delenv("WORKBENCH_DATA", raising=False)
        try:
            code = main(["run", *overrides, f"hydra.run.dir={tmp_path / folder}"])
        except SystemExit as end:
            code = end.code
        logging.captureWarnings(False)
        return Done(code, *capfd.readouterr(), tmp_path / folder)

    return command


@pytest.fixture
def summary_of(run):
    """Run the command within a folder, to the end; what its summary.json says."""

    def command(within, *overrides):
        done = run("out", *overrides, within=within)
        assert done.code == 0, done.err
        return json.loads((done.folder / "summary.json").read_text())

    return command


@pytest.fixture
def process(tmp_path, cache):
    """Run the command as a process of its own."""

    def command(folder, *overrides):
        environment = {**os.environ, "WORKBENCH_CACHE": str(cache)}
        environment.pop("WORKBENCH_DATA", None)
        done = subprocess.run(
            [sys.executable, "-m", "workbench", "run", *overrides, f"hydra.run.dir={tmp_path / folder}"],
            cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300, check=False,
        )  # fmt: skip
        return Done(done.returncode, done.stdout, done.stderr, tmp_path / folder)

    return command
