"""The recordings kept to check against: small, whole, safe to run, and each made by a line of recordings/README.md."""

import re
from pathlib import Path

import pytest

from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.config.stored import current_defaults, runnable_config
from workbench.recording.read.crash_probe import open_sound_runs
from workbench.results.check.rerun import tolerances

RECORDINGS = Path(__file__).parents[2] / "recordings"


@pytest.fixture(scope="module")
def baselines():
    runs, problems = open_sound_runs(RECORDINGS / "baselines")
    assert problems == []
    return {run.path.stem: run for run in runs}


@pytest.mark.slow
def test_each_is_made_by_a_line_of_the_readme(baselines):
    lines = re.findall(r"^baseline (\w+) (\w+)", (RECORDINGS / "README.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert dict(lines) == {name: run.provenance["experiment"] for name, run in baselines.items()}


def test_they_are_small(baselines):
    sizes = [run.path.stat().st_size for run in baselines.values()]
    assert max(sizes) <= 1.5e6
    assert sum(sizes) <= 6e6


def test_they_are_complete_and_may_be_run_by_anybody(baselines):
    prepare_hydra()
    own = current_defaults(["paths.data=null", "paths.cache=/some/cache"])
    for run in baselines.values():
        assert run.status == "complete"
        assert run.settings["paths"] == {"data": None, "cache": "~/.cache/workbench"}  # nobody's own folder
        assert runnable_config(run, [], own).paths.cache == "/some/cache"
        assert "default" in tolerances(run, own)
