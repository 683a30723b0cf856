"""The main command as the end-to-end tests call it: without recordings, and with a cache of their own."""

import json
import logging
import os
import subprocess
import sys

import pytest

from workbench.cli.run import main


@pytest.fixture(autouse=True)
def no_handlers_left():
    """Hydra's would go on writing to the output of the test that called it, which is closed by then."""
    yield
    root = logging.getLogger()
    for handler in root.handlers[:]:
        if type(handler) in (logging.StreamHandler, logging.FileHandler):
            root.removeHandler(handler)


@pytest.fixture
def run(tmp_path, monkeypatch, capfd):
    """Run the command in this process, which saves the imports: (exit code, what it told, its folder)."""

    def command(folder, *overrides):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path / "cache"))
        monkeypatch.delenv("WORKBENCH_DATA", raising=False)
        monkeypatch.setattr(sys, "argv", ["workbench", *overrides, f"hydra.run.dir={tmp_path / folder}"])
        try:
            code = main()
        except SystemExit as end:
            code = end.code
        logging.captureWarnings(False)
        return code, "".join(capfd.readouterr()), tmp_path / folder

    return command


@pytest.fixture
def summary_of(tmp_path):
    """Run the command as a process of its own in a folder, which keeps the cache too; what its summary.json says."""

    def command(folder, *overrides):
        environment = {**os.environ, "WORKBENCH_CACHE": str(folder / "cache")}
        environment.pop("WORKBENCH_DATA", None)
        done = subprocess.run(
            [sys.executable, "-m", "workbench", *overrides, f"hydra.run.dir={tmp_path / 'out'}"],
            cwd=folder, env=environment, capture_output=True, text=True, timeout=300, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return json.loads((tmp_path / "out" / "summary.json").read_text())

    return command
