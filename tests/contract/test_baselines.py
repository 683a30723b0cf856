"""The baselines are small and complete, run on any machine, and are listed in recordings/README.md."""

import re
from pathlib import Path

import pytest

from workbench.recording.read.crash_probe import open_sound_runs

RECORDINGS = Path(__file__).parents[2] / "recordings"


@pytest.mark.slow
def test_the_baselines_are_complete_without_folders_of_a_machine_and_listed_in_the_readme():
    """`workbench check recordings/baselines` runs them."""
    runs, problems = open_sound_runs(RECORDINGS / "baselines")
    assert problems == []
    baselines = {run.path.stem: run for run in runs}
    lines = re.findall(r"^baseline (\w+) (\w+)", (RECORDINGS / "README.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert dict(lines) == {name: run.provenance["experiment"] for name, run in baselines.items()}
    for run in runs:
        assert run.status == "complete"
        assert run.settings["paths"]["data"] in (None, "recordings/baselines/inputs")
        assert run.settings["paths"]["cache"] == "~/.cache/workbench"


def test_the_baselines_are_small():
    sizes = [path.stat().st_size for path in (RECORDINGS / "baselines").glob("*.rrd")]
    assert max(sizes) <= 1.5e6
    assert sum(sizes) <= 7e6
    assert sum(path.stat().st_size for path in (RECORDINGS / "baselines" / "inputs").rglob("*.*")) <= 3e5
