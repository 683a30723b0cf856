"""The curve of a literal row's constant, and the table of deviations."""

import sys

import pytest

from analysis import deviations, literal_constants
from analysis.figures import cached_runs


def test_the_curve_has_a_row_for_each_value(tmp_path, monkeypatch, capsys):
    seen = []

    def measured(run, names):
        seen.append(run)
        sigma = float(run.overrides[-1].partition("=")[2])
        return {name: float(sigma == 50.0) if name == "tracked" else sigma + run.seed for name in names}

    monkeypatch.setattr(cached_runs, "measured", measured)
    arguments = ["walk_circle", "likelihood.sigma", "20", "50", "--clips", "builtin", "--seeds", "100", "102"]
    more = ["--set", "prior.beta=0.1", "--data", "DATA", "-o", str(tmp_path / "runs.jsonl")]
    monkeypatch.setattr(sys, "argv", ["literal_constants", *arguments, *more])
    assert literal_constants.main() == 0
    rows = [line.split(" | ") for line in capsys.readouterr().out.splitlines()[2:]]
    assert [row[0] for row in rows] == ["| likelihood.sigma=20", "| likelihood.sigma=50"]
    assert [(row[1], row[-1]) for row in rows] == [("121.0", "0 of 2 |"), ("151.0", "2 of 2 |")]
    assert all({"paper=literal", "dataset.perturb=false", "prior.beta=0.1"} < set(run.overrides) for run in seen)
    assert {(run.clip, run.seed) for run in seen} == {("builtin", 100), ("builtin", 102)}


@pytest.mark.parametrize("entry", deviations.DEVIATIONS, ids=lambda entry: f"{entry.paper} {entry.place}")
def test_a_deviation_is_one_row_with_its_reason(entry):
    assert all(entry)
    assert not any("|" in cell for cell in entry)
    assert f"| {' | '.join(entry)} |" in deviations.page().splitlines()
