"""Benchmarks: figures against limits and references, exponents of known laws, and small measurements."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.benchmarks import __main__ as benchmarks
from analysis.benchmarks import scaling, tracking
from analysis.benchmarks.figure import Figure, differences, page_table, read_figures
from analysis.benchmarks.measuring import peak_gb
from analysis.benchmarks.scaling import Curve

FAST = Figure("draw_us", 0.9, "µs a draw", 1.2, "lower", "a bar")
MANY = Figure("against_peer", 80.0, "×", 100.0, "higher", "peer: 72 µs")


SIZES = (1.0, 10.0, 100.0, 1000.0, 10_000.0)
TINY = {
    "time_against_particles": lambda: scaling.particles((5, 9), (5, 9), (5, 9)),
    "fit_time_against_length": lambda: scaling.fit_time((6, 9)),
    "fit_memory_against_length": lambda: scaling.fit_memory((6, 9)),
}


def test_a_figure_fails_if_it_is_worse_by_more_than_the_fraction():
    for draw_us, against_peer in ((1.1, 65.0), (0.1, 650.0)):
        assert differences([replace(FAST, value=draw_us), replace(MANY, value=against_peer)], [FAST, MANY], 0.25) == []
    worse = differences([replace(FAST, value=1.2), replace(MANY, value=60.0)], [FAST, MANY], 0.25)
    assert {line.partition(":")[0] for line in worse} == {"draw_us", "against_peer"}
    assert len(differences([], [FAST], 0.25)) == len(differences([FAST], [], 0.25)) == 1
    assert len(differences([replace(FAST, unit="ms")], [FAST], 0.25)) == 1


def test_the_command_fails_only_if_a_figure_is_worse(monkeypatch, tmp_path):
    def run(measured, *arguments):
        made = {figure.name: lambda figure=figure: [figure] for figure in measured}
        monkeypatch.setattr(benchmarks, "BENCHMARKS", made)
        return benchmarks.main([str(argument) for argument in arguments])

    reference = tmp_path / "reference.json"
    assert run([FAST, MANY], "--json", reference) == 0
    assert run([FAST, MANY], "--compare", reference) == 0
    assert run([replace(FAST, value=2.0), MANY], "--compare", reference) == 1
    assert run([replace(FAST, value=2.0), MANY], "--compare", reference, "--worse", 2.0) == 0
    assert run([MANY], "--compare", reference) == 1
    assert run([FAST], "typo") == 2


def test_the_table_of_the_page_is_made_from_the_reference():
    reference = Path(benchmarks.__file__).with_name("reference.json")
    figures = read_figures(reference)
    assert reference.with_suffix(".md").read_text(encoding="utf-8") == page_table(figures)
    rows = [line.split(" | ") for line in page_table([FAST, MANY]).splitlines()[2:]]
    assert [row[1] for row in rows] == ["0.9", "80"]
    assert [row[4] for row in rows] == ["yes |", "no |"]


def law(exponent, cost=0.0):
    return Curve("law", "things", "ms", SIZES, tuple(cost + 3.0 * size**exponent for size in SIZES))


def test_the_exponent_is_fitted_to_the_upper_half_of_the_sizes():
    """A constant cost affects the exponent of the smaller sizes."""
    curve = law(1.0, cost=3.0)
    assert curve.exponent == np.polyfit(np.log(SIZES[2:]), np.log(curve.values[2:]), 1)[0]
    assert np.polyfit(np.log(SIZES), np.log(curve.values), 1)[0] < curve.exponent < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("name", TINY)
def test_every_measurement_has_curves_and_a_figure(name, tmp_path_factory, monkeypatch):
    """With one timed run per function, two frames and one cue."""
    monkeypatch.setattr(scaling, "REPEATS", 1)
    monkeypatch.setattr(tracking, "N_FRAMES", 2)
    monkeypatch.setattr(scaling, "peak_gb", lambda command, environment: 0.1)  # of a process
    monkeypatch.setattr(tracking, "several_cues", lambda: ())  # learning the edge model takes half a minute
    monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path_factory.getbasetemp() / "scaling_cache"))
    monkeypatch.delenv("WORKBENCH_DATA", raising=False)
    curves = TINY[name]()
    assert {*TINY} == {*scaling.MEASURES}
    assert len({curve.name for curve in curves}) == len(curves)
    assert all(len(curve.sizes) == 2 and np.isfinite(curve.exponent) for curve in curves)
    assert scaling.drawn(name, curves).get_axes()[0].has_data()


def test_peak_memory_is_that_of_the_subprocess():
    """Memory of the subprocess counts, and memory of this process, 0.4 GB, does not."""
    memory = np.ones(50_000_000)
    bare, filled = (peak_gb(["-c", code], os.environ) for code in ("pass", "full = b'x' * 200_000_000"))
    assert bare < 0.1 < 1e-9 * memory.nbytes
    assert filled - bare == pytest.approx(0.2, abs=0.005)  # pages and the allocator use 0.001 GB
