"""Fixtures that run `workbench run` without real recordings and with the cache of the test session."""

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
class Result:
    """Exit code, standard output, standard error and run folder of a command; unpacks to code, output, folder."""

    code: int
    out: str
    err: str
    folder: Path

    def __iter__(self):
        return iter((self.code, self.out + self.err, self.folder))


@pytest.fixture(autouse=True)
def remove_log_handlers():
    """Remove the log handlers that Hydra adds: they would write to the closed output of the previous test."""
    yield
    root = logging.getLogger()
    for handler in root.handlers[:]:
        if type(handler) in (logging.StreamHandler, logging.FileHandler):
            root.removeHandler(handler)


@pytest.fixture
def run(tmp_path, cache, monkeypatch, capfd, request):
    """Return a function that runs the command in this process, which saves the imports.

    within: working folder, with a cache of its own. sandboxed: read recordings and libraries in the sandbox, which
    takes a second more."""

    def command(folder, *overrides, within=None, sandboxed=False):
        if not sandboxed:
            request.getfixturevalue("trusted")
        monkeypatch.chdir(within or tmp_path)
        monkeypatch.setenv("WORKBENCH_CACHE", str(within / "cache" if within else cache))
        monkeypatch.delenv("WORKBENCH_DATA", raising=False)
        try:
            code = main(["run", *overrides, f"hydra.run.dir={tmp_path / folder}"])
        except SystemExit as end:
            code = end.code
        logging.captureWarnings(False)
        return Result(code, *capfd.readouterr(), tmp_path / folder)

    return command


@pytest.fixture
def summary_of(run):
    """Return a function that runs the command in a working folder and returns the content of its summary.json."""

    def command(within, *overrides):
        result = run("out", *overrides, within=within)
        assert result.code == 0, result.err
        return json.loads((result.folder / "summary.json").read_text())

    return command


@pytest.fixture
def process(tmp_path, cache):
    """Return a function that runs the command in a subprocess."""

    def command(folder, *overrides):
        environment = {**os.environ, "WORKBENCH_CACHE": str(cache)}
        environment.pop("WORKBENCH_DATA", None)
        completed = subprocess.run(
            [sys.executable, "-m", "workbench", "run", *overrides, f"hydra.run.dir={tmp_path / folder}"],
            cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300, check=False,
        )  # fmt: skip
        return Result(completed.returncode, completed.stdout, completed.stderr, tmp_path / folder)

    return command
