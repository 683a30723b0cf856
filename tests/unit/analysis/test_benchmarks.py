"""The table of benchmarks: what is printed, kept as JSON, and compared."""

import json
import math
from pathlib import Path

import pytest

from analysis.benchmarks import __main__ as benchmarks
from analysis.benchmarks.figure import Figure, differences, not_measured, read_figures, table, write_figures
from workbench.errors import InputError

REFERENCE = Path(benchmarks.__file__).with_name("reference.json")
FAST = Figure("draw_us", 0.9, "µs a draw", 1.2, "lower", "a bar")
MANY = Figure("against_peer", 80.0, "×", 100.0, "higher", "peer: 72 µs")
UNKNOWN = not_measured("with_peer", "×", 0.1, "lower", "peer is not installed")


def test_a_figure_reaches_its_bar_on_the_better_side():
    assert FAST.reached
    assert Figure("x", 1.2, "µs", 1.2, "lower", "").reached
    assert not MANY.reached
    assert Figure("x", 100.0, "×", 100.0, "higher", "").reached
    assert not UNKNOWN.reached
    with pytest.raises(ValueError, match="better"):
        Figure("x", 1.0, "µs", 1.0, "faster", "")


def test_the_table_has_a_line_a_figure_and_says_what_was_not_measured_and_why():
    head, fast, many, unknown = table([FAST, MANY, UNKNOWN]).splitlines()
    assert head.split()[:5] == ["name", "figure", "bar", "unit", "reached"]
    assert fast.split()[:4] == ["draw_us", "0.9", "≤", "1.2"]
    assert " yes " in fast
    assert many.split()[:4] == ["against_peer", "80", "≥", "100"]
    assert " no " in many
    assert unknown.split()[1] == "-"
    assert unknown.endswith("not measured: peer is not installed")


def test_figures_survive_json(tmp_path):
    write_figures(tmp_path / "figures.json", [FAST, UNKNOWN])
    rows = json.loads((tmp_path / "figures.json").read_text())
    assert [set(row) for row in rows] == [{"name", "value", "unit", "bar", "better", "reference"}] * 2
    assert rows[1]["value"] is None
    fast, unknown = read_figures(tmp_path / "figures.json")
    assert fast == FAST
    assert math.isnan(unknown.value)


@pytest.mark.parametrize("text", ["", "{}x", '{"name": 1}', '[{"name": "x"}]', '[{"value": "many"}]', "[3]"])
def test_a_file_of_something_else_is_refused(tmp_path, text):
    (tmp_path / "figures.json").write_text(text)
    with pytest.raises(InputError, match=r"figures\.json"):
        read_figures(tmp_path / "figures.json")


def changed(figure, value):
    return Figure(figure.name, value, figure.unit, figure.bar, figure.better, figure.reference)


def test_a_figure_fails_when_it_is_worse_by_more_than_the_share():
    assert differences([changed(FAST, 1.1), changed(MANY, 65.0)], [FAST, MANY], 0.25) == []
    assert differences([changed(FAST, 0.1), changed(MANY, 650.0)], [FAST, MANY], 0.25) == []
    slower, fewer = differences([changed(FAST, 1.2), changed(MANY, 60.0)], [FAST, MANY], 0.25)[::-1]
    assert slower == "draw_us: 1.2, was 0.9 µs a draw; lower is better"
    assert fewer.startswith("against_peer: 60, was 80")


@pytest.mark.parametrize("value", [math.nan, math.inf, 0.0, -1.0])
def test_what_was_not_measured_fails_on_either_side(value):
    assert len(differences([changed(FAST, value)], [FAST], 0.25)) == 1
    assert len(differences([FAST], [changed(FAST, value)], 0.25)) == 1


def test_a_missing_figure_fails_on_either_side():
    assert differences([], [FAST], 0.25) == ["draw_us: missing from this run"]
    assert differences([FAST], [], 0.25) == ["draw_us: missing from the reference"]


def run(monkeypatch, measured, *arguments):
    monkeypatch.setattr(benchmarks, "BENCHMARKS", {figure.name: lambda figure=figure: [figure] for figure in measured})
    return benchmarks.main([str(argument) for argument in arguments])


def test_the_command_fails_only_where_something_got_worse(monkeypatch, tmp_path, capsys):
    kept = tmp_path / "kept.json"
    assert run(monkeypatch, [FAST, MANY], "--json", kept) == 0
    assert run(monkeypatch, [FAST, MANY], "--compare", kept) == 0
    assert run(monkeypatch, [changed(FAST, 2.0), MANY], "--compare", kept) == 1
    assert "draw_us: 2, was 0.9" in capsys.readouterr().out
    assert run(monkeypatch, [changed(FAST, 2.0), MANY], "--compare", kept, "--worse", 2.0) == 0
    assert run(monkeypatch, [changed(FAST, 2.0), MANY], "against_peer", "--compare", kept) == 0
    assert run(monkeypatch, [changed(FAST, math.nan), MANY], "draw_us", "--compare", kept) == 1
    assert run(monkeypatch, [MANY], "--compare", kept) == 1
    assert run(monkeypatch, [FAST], "typo") == 2
    assert "typo" in capsys.readouterr().err
    assert run(monkeypatch, [FAST], "--compare", tmp_path / "nowhere.json") == 2


def test_figures_measured_together_are_measured_once(monkeypatch):
    asked = []

    def both():
        asked.append(1)
        return [FAST, MANY]

    monkeypatch.setattr(benchmarks, "BENCHMARKS", {"draw_us": both, "against_peer": both})
    assert benchmarks.main([]) == 0
    assert len(asked) == 1


def test_the_kept_reference_has_every_figure():
    kept = {figure.name: figure for figure in read_figures(REFERENCE)}
    assert set(benchmarks.BENCHMARKS) <= set(kept)
    assert not [name for name, figure in kept.items() if not figure.value > 0.0]
