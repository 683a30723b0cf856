"""The curve of a constant in a published configuration, and the table of deviations from the papers."""

import sys

import pytest

from analysis import literal_constants, open_constants
from analysis.figures import cached_runs
from analysis.figures.unrecorded import Result


def test_the_curve_has_one_row_per_value(tmp_path, monkeypatch, capsys):
    calls = []

    def measured(config, experiment):
        calls.append((experiment, config.paper, config))
        numbers = dict.fromkeys(literal_constants.MEASURED, float(config.likelihood.sigma + config.seed))
        return Result({**numbers, "tracked": float(config.likelihood.sigma == 50.0)}, {}, 1.0)

    monkeypatch.setattr(cached_runs, "measured", measured)
    arguments = ["walk_circle", "likelihood.sigma", "20", "50", "--clips", "builtin", "--seeds", "100", "102"]
    options = ["--set", "likelihood.p_occluded=0.1", "--data", str(tmp_path), "--runs", str(tmp_path / "runs")]
    monkeypatch.setattr(sys, "argv", ["literal_constants", *arguments, *options])
    for _ in range(2):
        assert literal_constants.main() == 0
        rows = [line.split(" | ") for line in capsys.readouterr().out.splitlines()[2:]]
        assert [row[0] for row in rows] == ["| likelihood.sigma=20", "| likelihood.sigma=50"]
        assert [(row[1], row[-1]) for row in rows] == [("121.0", "0 of 2 |"), ("151.0", "2 of 2 |")]
    assert len(calls) == 4  # the second command reads the cache
    for experiment, paper, config in calls:
        assert (experiment, paper, config.likelihood.p_occluded) == ("walk_circle", "literal", 0.1)
        assert not config.dataset.perturb
        assert config.dataset.seed == config.seed


@pytest.mark.parametrize("entry", open_constants.OPEN_CONSTANTS, ids=lambda entry: f"{entry.paper} {entry.name}")
def test_an_open_constant_has_its_value_in_the_published_experiment(entry):
    assert all(entry)
    assert entry.value.split()[0] not in ("None", "null")
