"""The table of people left out: its rows can be run, and its columns are told by part of the body."""

import pytest
from hydra import compose, initialize_config_module

from analysis.figures.kept_runs import every_run
from analysis.figures.left_out import MEASURED, ROWS, SHOWN, TRACKED, table
from workbench.evaluation.step_calibration import GROUPS
from workbench.experiment.compatibility import incompatibility
from workbench.experiment.schema import prepare_hydra


@pytest.mark.parametrize("row", ROWS)
def test_every_row_can_be_run_and_learns_from_others(row):
    prepare_hydra()
    experiment, overrides = ROWS[row]
    with initialize_config_module("workbench.conf", version_base="1.3"):
        config = compose("config", overrides=[f"experiment={experiment}", "dataset.motion='02_01'", *overrides])
    assert incompatibility(config, {}) is None
    assert "02" in config.learn.leave_out
    assert config.dataset.exact == row.endswith("exact")


def test_all_are_shown_as_usual_and_exactly():
    assert len(ROWS) == len(TRACKED) * len(SHOWN) == 10


def test_coverage_is_told_by_group_over_people():
    runs = every_run(dict(list(ROWS.items())[:1]), ["02_01", "05_01"], 1, ())
    numbers = [dict.fromkeys(MEASURED, 0.8), dict.fromkeys(MEASURED, 1.0)]
    header, _, row = table(dict(zip(runs, numbers, strict=True))).splitlines()
    assert [cell.strip() for cell in header.split("|")][3:7] == list(GROUPS)
    assert row.split("|")[2:7] == [" 0.90 ± 0.14 "] * 5
