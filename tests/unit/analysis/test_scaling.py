"""How things grow: exponents of known laws, what measures them at tiny sizes, peak memory, tables and figures."""

import json
import os

import numpy as np
import pytest
from matplotlib.text import Text

from analysis.benchmarks import scaling, scaling_figures, step
from analysis.benchmarks.curve import Curve, told, write_curves
from analysis.benchmarks.memory import peak_gb, peaks_gb
from workbench.errors import InputError

SIZES = (1.0, 10.0, 100.0, 1000.0, 10_000.0)
TINY = {
    "time_against_particles": lambda: scaling.particles((5, 9), (5, 9), (5, 9)),
    "time_against_limbs": lambda: scaling.limbs((1, 12), n_particles=9),
    "time_against_samples": lambda: scaling.samples((1, 3), n_particles=9),
    "time_against_pixels": lambda: scaling.pixels((0.1, 0.2), n_particles=9),
    "time_against_database": lambda: scaling.database((100, 300)),
    "time_against_frames": lambda: scaling.frames((4, 6)),
    "time_against_length": lambda: scaling.clip_length((2, 4)),
}


@pytest.fixture(autouse=True)
def brief(tmp_path_factory, monkeypatch):
    """One timed run of each function, two frames of the step, of one cue, and a cache that the tests share; windows
    of generated people, as learning those of the recorded ones takes far longer than what is measured."""
    monkeypatch.setattr(scaling, "REPEATS", 1)
    monkeypatch.setattr(scaling, "REPEATS_OF_LONG", 1)
    monkeypatch.setattr(step, "N_FRAMES", 2)
    monkeypatch.setattr(step, "several_cues", lambda: ())  # which would learn edges first, for half a minute
    monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path_factory.getbasetemp() / "scaling_cache"))
    monkeypatch.delenv("WORKBENCH_DATA", raising=False)


def law(exponent, cost=0.0):
    return Curve("law", "things", "ms", SIZES, tuple(cost + 3.0 * size**exponent for size in SIZES))


@pytest.mark.parametrize("exponent", [-0.5, 0.0, 0.5, 1.0, 2.0])
def test_a_power_law_has_its_exponent(exponent):
    assert law(exponent).exponent == pytest.approx(exponent, abs=1e-12)


def test_the_exponent_is_that_of_the_upper_half():
    """Three of five sizes: what a call costs at the least shows in the smaller ones alone."""
    curve = law(1.0, cost=3.0)
    assert curve.exponent == np.polyfit(np.log(SIZES[2:]), np.log(curve.values[2:]), 1)[0]
    assert np.polyfit(np.log(SIZES), np.log(curve.values), 1)[0] < curve.exponent < 1.0
    assert Curve("law", "things", "ms", (1.0, 2.0), (1.0, 4.0)).exponent == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("sizes", "values"),
    [((1.0,), (1.0,)), ((2.0, 1.0), (1.0, 1.0)), ((0.0, 1.0), (1.0, 1.0)), ((1.0, 2.0), (1.0,)),
     ((1.0, 2.0), (1.0, 0.0)), ((1.0, 2.0), (1.0, np.nan)), ((1.0, 2.0), (1.0, np.inf))],
)  # fmt: skip
def test_a_curve_without_a_law_is_refused(sizes, values):
    with pytest.raises(ValueError, match="rising sizes"):
        Curve("law", "things", "ms", sizes, values)


@pytest.mark.parametrize("name", TINY)
def test_what_is_measured_is_finite_and_positive(name):
    assert {*TINY, "memory_against_particles", "memory_against_length"} == {*scaling.MEASURES}
    curves = TINY[name]()
    assert len({(curve.size, curve.unit) for curve in curves}) == 1
    assert len({curve.name for curve in curves}) == len(curves)
    for curve in curves:  # whose values are checked when it is made
        assert len(curve.sizes) == 2
        assert np.isfinite(curve.exponent)


def test_the_first_limbs_are_those_of_the_whole_person():
    limbs = scaling.scene(np.random.default_rng(0), 1)[0].body.limbs
    part = scaling._first(limbs, 3)
    assert part.names == limbs.names[:3]
    assert len(part) == 3
    for name in ("joints", "starts", "ends", "radii", "spheres"):
        assert np.array_equal(getattr(part, name), getattr(limbs, name)[:3])


def test_peak_memory_is_the_process_own():
    """What it writes to counts; what this process holds, which by far exceeds a bare Python's 10 MB or so, does not."""
    held = np.ones(50_000_000)
    bare, filled = (peak_gb(["-c", code], os.environ) for code in ("pass", "full = b'x' * 200_000_000"))
    assert bare < 0.1 < 1e-9 * held.nbytes
    assert filled - bare == pytest.approx(0.2, abs=0.005)  # pages and the allocator's own: measured 0.001


@pytest.mark.slow
def test_peak_memory_of_a_run_grows_with_its_particles():
    few, many = peaks_gb((5, 50_000))
    assert 0.05 < few < many - 50_000 * 25 * 8e-9  # the poses alone


def test_the_command_prints_keeps_and_draws_what_is_asked(monkeypatch, tmp_path, capsys):
    second = Curve("other", "things", "ms", SIZES[:3], (7.0, 8.0, 9.0))
    monkeypatch.setattr(scaling, "MEASURES", {name: lambda: [law(1.0), second] for name in scaling.MEASURES})
    asked = ("time_against_particles", "time_against_limbs")
    assert scaling.main([*asked, "--out", str(tmp_path / "new" / "figures"), "--json", str(tmp_path / "c.json")]) == 0
    assert sorted(path.stem for path in (tmp_path / "new" / "figures").glob("*.png")) == sorted(asked)
    assert told(law(1.0)) in capsys.readouterr().out
    rows = json.loads((tmp_path / "c.json").read_text())
    assert [row["name"] for row in rows] == ["law", "other"] * 2
    assert rows[0]["exponent"] == pytest.approx(1.0)
    assert rows[1]["values"] == [7.0, 8.0, 9.0]


def test_what_cannot_be_done_is_said(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(scaling, "MEASURES", {"known": lambda: [law(1.0)]})
    (tmp_path / "file").touch()
    for arguments in (["typo"], ["--out", str(tmp_path / "file")], ["--json", str(tmp_path / "file" / "c.json")]):
        assert scaling.main(arguments) == 2
        assert capsys.readouterr().err.startswith("scaling: ")
    with pytest.raises(InputError):
        write_curves(tmp_path / "file" / "c.json", [law(1.0)])


def test_a_figure_names_every_curve_with_its_exponent_and_the_video_rate_over_particles():
    for name in ("time_against_particles", "time_against_frames"):
        figure = scaling_figures.drawn(name, [law(1.0), law(0.5)])
        words = [text.get_text() for text in figure.findobj(Text)]
        assert {"law\np = 1.00", "law\np = 0.50"} <= set(words)
        assert any(word.startswith("video rate") for word in words) == (name == "time_against_particles")
