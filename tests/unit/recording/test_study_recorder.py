"""A study's figures, metrics and note are read back; an interrupted one leaves its part."""

import logging

import cv2
import numpy as np
import pytest

from workbench.core.study import Bars, Curves, Scatter, Sticks, StudyResult
from workbench.recording.read.chunks import read_chunks
from workbench.recording.read.reader import read
from workbench.recording.study.drawing import picture
from workbench.recording.study.figures import figure_of, numbers
from workbench.recording.study.study_recorder import _sticks, eye, grid, pages, record_study
from workbench.recording.write.file import RecordingFile
from workbench.utils.errors import InputError

CONFIG = "seed: 7\nstudy:\n  missing: 0.3  # ö\n"
PROVENANCE = {"seed": 7, "version": "0.1.0"}
METRICS = {"n_cycles": 93.0, "explained": 0.1 + 0.2}


def figures():
    """Return figures of every kind and variant with numbers that float32 or text would round."""
    rng = np.random.default_rng(0)
    x = np.cumsum(rng.uniform(0.1, 1.0, 40))
    interrupted = rng.standard_normal(40)
    interrupted[[0, 7, 8, 9, 11, 39]] = np.nan  # frame 10 is a single point between two gaps
    return (
        Curves(
            "first page/SNR (left hip)", x, {"ours": rng.standard_normal(40), "with gaps": interrupted}, "s", "°",
            marks={"found": np.pi, "hip events": np.e}, faint={"z": rng.standard_normal(40), "a": np.full(40, np.nan)},
        ),
        Curves("first page/one point", x[:1], {"only": x[:1]}, "pass", "error"),
        Bars("c3", np.arange(-3.0, 4.0), rng.uniform(size=7), "σ", rng.uniform(size=7)),
        Bars("counts", np.arange(3.0), np.array([0.0, 2.0, 1.0]), "seconds"),
        Sticks("run", rng.standard_normal((5, 4, 3)), np.array([-1, 0, 1, 1]), np.linspace(0.0, 1.0, 5)),
        Sticks("one", rng.standard_normal((1, 2, 3)), np.array([-1, 0]), np.array([0.5])),
    )  # fmt: skip


def recorder(path, run_id="study"):
    return RecordingFile(path, run_id=run_id, config_yaml=CONFIG, provenance=PROVENANCE)


def record(path, figures):
    with recorder(path) as recording:
        record_study(recording, StudyResult(METRICS, tuple(figures), "**Paper B, fig. 1.** A caption."))
    return path


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    return record(tmp_path_factory.mktemp("study") / "new folder" / "run.rrd", figures())


def identical(first, second):
    """Return whether two fields are bitwise identical and equally ordered."""
    if isinstance(first, np.ndarray):
        return first.shape == second.shape and first.dtype == second.dtype and first.tobytes() == second.tobytes()
    if isinstance(first, dict):
        return list(first) == list(second) and all(identical(first[key], second[key]) for key in first)
    return first == second and type(first) is type(second)


def test_figures_are_read_back_bitwise_and_in_order(recorded):
    figures_read = read(recorded).figures
    assert [figure.name for figure in figures_read] == [figure.name for figure in figures()]
    for written, figure in zip(figures(), figures_read, strict=True):
        assert type(written) is type(figure)
        for field in vars(written):
            assert identical(getattr(written, field), getattr(figure, field)), (written.name, field)


def test_figures_are_recorded_as_numbers_without_matplotlib(recorded, tmp_path, monkeypatch):
    monkeypatch.setattr("workbench.recording.study.study_recorder.can_draw", lambda: False)
    without = record(tmp_path / "run.rrd", figures())
    assert [figure.name for figure in read(without).figures] == [figure.name for figure in figures()]
    chunks = [read_chunks(path, ["/figures/**"]) for path in (recorded, without)]
    assert [any(chunk.entity_path.endswith("/drawing") for chunk in part) for part in chunks] == [True, False]


def test_properties_metrics_and_note_are_read_back(recorded):
    recording = read(recorded)
    assert recording.config == CONFIG
    assert recording.status == "complete"
    assert recording.properties["run"]["id"] == "study"
    assert recording.properties["provenance"] == PROVENANCE
    assert recording.properties["metrics"] == METRICS
    assert recording.note == "**Paper B, fig. 1.** A caption."
    assert recording.metric_names == tuple(sorted(METRICS))
    for name, value in METRICS.items():  # a curve of one point
        assert [list(column) for column in recording.metric(name)] == [[0], [value]]
    assert recording.marginals is None
    with pytest.raises(InputError, match="a study, which has no poses"):
        _ = recording.poses


def interrupt(recording):
    with recording:
        assert read(recording.part).status == "running"  # the state after a kill
        raise KeyboardInterrupt


def test_an_interrupted_study_leaves_its_part(tmp_path, caplog):
    recording = recorder(tmp_path / "run.rrd")
    with caplog.at_level(logging.WARNING), pytest.raises(KeyboardInterrupt):
        interrupt(recording)
    assert str(recording.part) in caplog.text
    assert not recording.path.exists()
    part = read(recording.part)
    assert (part.status, part.config, part.figures, part.note) == ("interrupted", CONFIG, (), None)


def test_two_figures_of_one_name_are_rejected(tmp_path):
    figure = figures()[3]
    with pytest.raises(ValueError, match="distinct names"):
        record(tmp_path / "run.rrd", [figure, figure])


@pytest.mark.parametrize(
    "figure",
    [
        *(Curves("f", np.arange(5.0), {"a": y}, "α₁", "σ") for y in (np.zeros(5), np.full(5, np.nan))),
        Curves("f", np.ones(1), {"a": np.ones(1)}, "x", "y"),
        Bars("f", np.zeros(1), np.ones(1), "x"),
        *(Scatter("f", {"a": xy}, "x", "y") for xy in (np.zeros((0, 2)), np.full((2, 2), np.nan))),
    ],
)
def test_a_picture_is_deterministic_and_finer_than_the_view(figure):
    png = picture(figure, 300.0, 200.0)
    assert cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR).shape == (300, 450, 3)
    assert picture(figure, 300.0, 200.0) == png


def test_the_numbers_of_points_are_read_back_bitwise():
    rng = np.random.default_rng(1)
    figure = Scatter("page/s", {"walk": rng.normal(size=(4, 2)), "run": rng.normal(size=(1, 2))}, "α₁", "α₂")
    restored = figure_of(numbers(figure))
    assert isinstance(restored, Scatter)
    assert (restored.name, restored.x_name, restored.y_name) == (figure.name, "α₁", "α₂")
    assert list(restored.points) == ["walk", "run"]
    for label, points in figure.points.items():
        assert restored.points[label].tobytes() == points.tobytes()


def test_figures_of_a_page_are_together_and_at_most_eight():
    names = ["a", *(f"walk/{k}" for k in range(9)), "b", "run/legs/left"]
    figures = [Bars(name, np.zeros(1), np.ones(1), "x") for name in names]
    expected = [("figures", 1), ("walk", 8), ("walk", 1), ("figures", 1), ("run/legs", 1)]
    assert [(title, len(group)) for title, group in pages(figures)] == expected
    assert [figure.name for _, group in pages(figures) for figure in group] == names


@pytest.mark.parametrize(("n", "shape"), [(1, (1, 1)), (3, (3, 1)), (4, (2, 2)), (5, (3, 2)), (7, (4, 2)), (8, (4, 2))])
def test_up_to_three_figures_are_in_one_row_and_more_in_two(n, shape):
    assert grid(n) == shape


def test_bones_connect_joints_with_their_parents_in_the_shade_of_their_skeleton():
    """The shades 0 and 1 are the darkest and the lightest colour, 0.5 is between."""
    positions = np.arange(27.0).reshape(3, 3, 3)
    drawn = dict(_sticks("world", Sticks("run", positions, np.array([-1, 0, 0]), np.array([0.0, 0.5, 1.0]))))
    strips = drawn["world/skeletons"].strips.as_arrow_array().to_pylist()
    expected = [positions[k, [0, joint]] for k in range(3) for joint in (1, 2)]
    np.testing.assert_array_equal(strips, expected)
    colors = [value >> 8 for value in drawn["world/skeletons"].colors.as_arrow_array().to_pylist()]
    shades = [0x462D14, 0xA27637, 0xFFBE5A]  # (70, 45, 20), (162, 118, 55), (255, 190, 90)
    assert colors == [shade for shade in shades for _ in range(2)]


@pytest.mark.parametrize(("length", "across"), [(1.1, (1.0, 0.0)), (0.0, (0.0, -1.0))])
def test_skeletons_are_seen_perpendicular_to_their_path(length, across):
    """The root moves along y, or stays; the hand spans a box of 2 m by 4 m by 4 m about (0, 0, 1)."""
    roots = np.array([0.0, length, 0.0])[None] * np.linspace(-0.5, 0.5, 5)[:, None]
    hand = np.linspace([-1.0, -2.0, -1.0], [1.0, 2.0, 3.0], 5)
    positions = np.stack([roots + np.array([0.0, 0.0, 1.0]), roots, hand], axis=1)
    shown = eye(Sticks("run", positions, np.array([-1, 0, 0]), np.zeros(5)))
    position, target = (
        np.array(field.as_arrow_array().to_pylist()[0]) for field in (shown.position, shown.look_target)
    )
    np.testing.assert_allclose(target, [0.0, 0.0, 1.0], atol=1e-6)
    seen_from = np.array([*across, 0.2]) * 1.15 * 6.0
    away = position - target
    np.testing.assert_allclose(away * np.sign(away @ seen_from), seen_from, atol=1e-5)
