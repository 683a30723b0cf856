"""The tables of how much a likelihood weighs: what they try can be composed, and the least log score is marked."""

import pytest
from hydra import compose, initialize_config_module

from analysis.figures.kept_runs import every_run
from analysis.figures.weights import CHOICES, SCORES, rows_of, table
from workbench.experiment.schema import prepare_hydra


@pytest.mark.parametrize("title", CHOICES)
def test_every_value_is_told_to_the_likelihood(title):
    prepare_hydra()
    rows, told = rows_of(CHOICES[title]), set()
    for experiment, overrides in rows.values():
        with initialize_config_module("workbench.conf", version_base="1.3"):
            config = compose("config", overrides=[f"experiment={experiment}", "dataset.motion='35_02'", *overrides])
        told.add(str(config.likelihood))
    assert len(told) == len(rows) > 2


def test_the_least_log_score_is_marked():
    runs = every_run({"0.5": ("walk_best", ()), "0.1": ("walk_best", ())}, ["a", "b"], 1, ())
    scores = {"0.5": 2.0, "0.1": -1.0}
    lines = table("weight", {run: {**dict.fromkeys(SCORES, 1.0), "log_score": scores[run.row]} for run in runs})
    assert [line.split(" | ")[0] for line in lines.splitlines()[2:]] == ["| 0.5", "| **0.1**"]
