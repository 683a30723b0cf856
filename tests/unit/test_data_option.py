"""A test without its recordings is skipped, or fails with --require-data."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(("options", "code", "word"), [([], 0, "skipped"), (["--require-data"], 1, "error")])
@pytest.mark.slow
def test_missing_recordings_skip_a_test_or_fail_it_on_request(options, code, word, tmp_path):
    hidden = ("WORKBENCH_DATA", "PYTEST_ADDOPTS")
    environment = {name: value for name, value in os.environ.items() if name not in hidden}
    command = [sys.executable, "-m", "pytest", "-n", "0", "-p", "no:cacheprovider"]
    command.append("tests/real_data/test_points_recorded.py")
    done = subprocess.run(
        [*command, "-m", "", "--data", tmp_path, *options], cwd=ROOT, env=environment, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert (done.returncode, word in done.stdout, "passed" in done.stdout) == (code, True, False), done.stdout
    assert "expected --data DIR or $WORKBENCH_DATA" in done.stdout or code == 0
