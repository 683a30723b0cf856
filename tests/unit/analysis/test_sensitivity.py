"""The table of what a tracker loses: its rows are what datasets know, and its numbers are over people."""

import yaml

from analysis.figures.kept_runs import every_run
from analysis.figures.sensitivity import ROWS, table
from workbench.datasets.synthetic import Synthetic


def test_every_row_but_one_is_exact_otherwise_and_of_departures_that_there_are():
    assert [row for row, overrides in ROWS.items() if "dataset.exact=true" not in overrides] == ["all below, as usual"]
    for overrides in ROWS.values():
        for key, value in (override.split("=", 1) for override in overrides):
            if key == "dataset.departures":
                Synthetic(exact=True, departures=yaml.safe_load(value))  # which refuses what it does not know


def test_numbers_are_means_over_people_and_spreads_over_people_and_seeds():
    def numbers(error):
        return {"error_abs_mm": error, "error_px": 0.1 * error, "held": float(error < 50.0)}

    runs = every_run({"nothing": ("walk_best", ())}, ["a", "b"], 2, ())
    errors = {("a", 0): 10.0, ("a", 1): 20.0, ("b", 0): 50.0, ("b", 1): 60.0}
    lines = table({run: numbers(errors[run.clip, run.seed]) for run in runs}).splitlines()
    # people 15 and 55: 35 ± 28; seeds of each 7.1 apart
    assert lines[2:] == ["| nothing | 35 ± 28, 7 | 3.5 ± 2.8, 0.7 | 2/4 |"]
