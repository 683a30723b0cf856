"""The baselines are small and complete, run on any machine, and are listed in recordings/README.md."""

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
def test_the_readme_lists_every_baseline_with_its_experiment(baselines):
    lines = re.findall(r"^baseline (\w+) (\w+)", (RECORDINGS / "README.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert dict(lines) == {name: run.provenance["experiment"] for name, run in baselines.items()}


def test_the_baselines_are_small(baselines):
    sizes = [run.path.stat().st_size for run in baselines.values()]
    assert max(sizes) <= 1.5e6
    assert sum(sizes) <= 6.5e6


def test_the_baselines_are_complete_and_run_with_the_users_own_folders(baselines):
    prepare_hydra()
    own = current_defaults(["paths.data=null", "paths.cache=/some/cache"])
    for run in baselines.values():
        assert run.status == "complete"
        assert run.settings["paths"] == {"data": None, "cache": "~/.cache/workbench"}  # of no particular machine
        assert runnable_config(run, [], own).paths.cache == "/some/cache"
        assert "default" in tolerances(run, own)
