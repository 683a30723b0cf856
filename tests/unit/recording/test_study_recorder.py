"""What a study's recording holds, and when it is published."""

import logging

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure

from workbench.core.study import Bars, Curves, Scatter, Sticks, StudyResult
from workbench.recording.read.reader import read
from workbench.recording.study.drawing import draw, picture
from workbench.recording.study.figures import figure_of, numbers
from workbench.recording.study.study_recorder import record_study
from workbench.recording.write.file import RecordingFile
from workbench.utils.errors import InputError

CONFIG = "seed: 7\nstudy:\n  missing: 0.3  # ö\n"
PROVENANCE = {"seed": 7, "version": "0.1.0"}
METRICS = {"n_cycles": 93.0, "explained": 0.1 + 0.2}


def figures():
    """One of each kind and of each variant, with numbers that float32 or text would not keep."""
    rng = np.random.default_rng(0)
    x = np.cumsum(rng.uniform(0.1, 1.0, 40))
    interrupted = rng.standard_normal(40)
    interrupted[[0, 7, 8, 9, 11, 39]] = np.nan  # also a single point between two gaps
    return (
        Curves(
            "first page/SNR (left hip)", x, {"ours": rng.standard_normal(40), "with gaps": interrupted}, "s", "°",
            marks={"found": np.pi, "hip events": np.e}, faint={"z": rng.standard_normal(40), "a": np.full(40, np.nan)},
        ),
        Curves("first page/one point", x[:1], {"only": x[:1]}, "pass", "error"),
        Bars("c3", np.arange(-3.0, 4.0), rng.uniform(size=7), "σ", rng.uniform(size=7)),
        Bars("counts", np.arange(3.0), np.array([0.0, 2.0, 1.0]), "seconds"),
        Sticks(
            "run", rng.standard_normal((5, 4, 3)), np.array([-1, 0, 1, 1]), np.linspace(0.0, 1.0, 5),
            {"left hand": rng.standard_normal((6, 3)), "right hand": rng.standard_normal((2, 3))},
        ),
        Sticks("one", rng.standard_normal((1, 2, 3)), np.array([-1, 0]), np.array([0.5])),
    )  # fmt: skip


def recorder(path, run_id="study"):
    return RecordingFile(path, run_id=run_id, config_yaml=CONFIG, provenance=PROVENANCE)


def record(path, shown):
    with recorder(path) as recording:
        record_study(recording, StudyResult(METRICS, tuple(shown), "**Paper B, fig. 1.** What is to be seen."))
    return path


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    return record(tmp_path_factory.mktemp("study") / "new folder" / "run.rrd", figures())


def same(first, second):
    """Whether two fields are equal bit for bit, in the same order."""
    if isinstance(first, np.ndarray):
        return first.shape == second.shape and first.dtype == second.dtype and first.tobytes() == second.tobytes()
    if isinstance(first, dict):
        return list(first) == list(second) and all(same(first[key], second[key]) for key in first)
    return first == second and type(first) is type(second)


def test_figures_come_back_bit_for_bit_and_in_order(recorded):
    found = read(recorded).figures
    assert [figure.name for figure in found] == [figure.name for figure in figures()]
    for given, back in zip(figures(), found, strict=True):
        assert type(given) is type(back)
        for field in vars(given):
            assert same(getattr(given, field), getattr(back, field)), (given.name, field)


def test_properties_metrics_and_note_come_back(recorded):
    found = read(recorded)
    assert found.config == CONFIG
    assert found.status == "complete"
    assert found.properties["run"]["id"] == "study"
    assert found.properties["provenance"] == PROVENANCE
    assert found.properties["metrics"] == METRICS
    assert found.note == "**Paper B, fig. 1.** What is to be seen."
    assert found.metric_names == tuple(sorted(METRICS))
    for name, value in METRICS.items():  # as curves of one point, too
        assert [list(column) for column in found.metric(name)] == [[0], [value]]
    assert found.marginals is None
    with pytest.raises(InputError, match="a study, which has no poses"):
        _ = found.poses


def fail_in(recording):
    with recording:
        assert read(recording.part).status == "running"  # what a killed process would leave
        raise KeyboardInterrupt


def test_a_study_that_fails_keeps_the_part(tmp_path, caplog):
    recording = recorder(tmp_path / "run.rrd")
    with caplog.at_level(logging.WARNING), pytest.raises(KeyboardInterrupt):
        fail_in(recording)
    assert str(recording.part) in caplog.text
    assert not recording.path.exists()
    found = read(recording.part)
    assert (found.status, found.config, found.figures, found.note) == ("interrupted", CONFIG, (), None)


def test_two_figures_of_one_name_are_refused(tmp_path):
    one = figures()[3]
    with pytest.raises(ValueError, match="distinct names"):
        record(tmp_path / "run.rrd", [one, one])


def drawn(figure):
    axes = Figure().add_subplot()
    draw(axes, figure)
    return axes


@pytest.mark.parametrize(
    "figure",
    [
        *(Curves("f", np.arange(5.0), {"a": y}, "α₁", "σ") for y in (np.zeros(5), np.full(5, np.nan))),
        Curves("f", np.ones(1), {"a": np.ones(1)}, "x", "y"),
        Bars("f", np.zeros(1), np.ones(1), "x"),
        *(Scatter("f", {"a": xy}, "x", "y") for xy in (np.zeros((0, 2)), np.full((2, 2), np.nan))),
    ],
)
def test_a_picture_is_finer_than_the_view_and_always_the_same(figure):
    png = picture(figure, 300.0, 200.0)
    assert cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR).shape == (300, 450, 3)
    assert picture(figure, 300.0, 200.0) == png


def test_the_numbers_of_points_come_back_bit_for_bit():
    rng = np.random.default_rng(1)
    figure = Scatter("page/s", {"walk": rng.normal(size=(4, 2)), "run": rng.normal(size=(1, 2))}, "α₁", "α₂")
    again = figure_of(numbers(figure))
    assert isinstance(again, Scatter)
    assert (again.name, again.x_name, again.y_name) == (figure.name, "α₁", "α₂")
    assert list(again.points) == ["walk", "run"]
    for label, points in figure.points.items():
        assert again.points[label].tobytes() == points.tobytes()
