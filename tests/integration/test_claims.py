"""`python -m analysis.claims`: claims of the papers, at small size on generated people."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_two_claims_hold_and_are_measured_once(tmp_path, cache):
    environment = {**os.environ, "WORKBENCH_CACHE": str(cache), "PYTHONPATH": str(ROOT)}
    environment.pop("WORKBENCH_DATA", None)

    def command():
        arguments = [sys.executable, "-m", "analysis.claims", "B1", "C3", "--quick", "--runs", "runs"]
        return subprocess.run(
            arguments, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300, check=False
        )

    first = command()
    assert first.returncode == 0, first.stderr
    assert "runs to make" in first.stderr
    verdicts = {tuple(line.split()[:2]): line for line in first.stdout.splitlines()[1:]}
    assert verdicts.keys() == {(name, paper) for name in ("B1", "C3") for paper in ("literal", "ours")}
    for name, paper in (("B1", "literal"), ("B1", "ours"), ("C3", "ours")):
        assert verdicts[name, paper].endswith("  holds")
    assert verdicts["C3", "literal"].endswith("does not hold, known")  # the paper's tree approximates the odds
    second = command()
    assert (second.returncode, second.stdout) == (0, first.stdout)
    assert "runs to make" not in second.stderr
