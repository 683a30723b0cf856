"""Recorder of a study: its figures as drawings and as numbers, its note and its metrics."""

from collections.abc import Sequence
from itertools import groupby

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from workbench.core.study import Figure, Sticks, StudyResult
from workbench.recording.study.figures import can_draw, numbers
from workbench.recording.write.columns import Entities
from workbench.recording.write.file import RecordingFile, arrow

_WINDOW, _TITLE = (1500.0, 690.0), 26.0
"""Size of a page of figures, and height of a view's title bar, points."""
_PAPER = (255, 255, 255)
_PER_PAGE = 8
_MIN_PATH_M = 0.5
_DARKEST, _LIGHTEST = np.array([70.0, 45.0, 20.0]), np.array([255.0, 190.0, 90.0])


def record_study(file: RecordingFile, result: StudyResult) -> None:
    """Record a study's result in an open file.

    The numbers of a figure are components of `figures/<name>`, from which `read.reader.read` restores a bitwise
    identical figure; its drawing is below this path. The note is at `note`, the metrics are the property `metrics`.
    Without matplotlib there is a warning instead of drawings. Raises ValueError when two figures have one name, OSError
    when the disk is nearly full.
    """
    if len({figure.name for figure in result.figures}) < len(result.figures):
        raise ValueError(f"study: expected figures of distinct names, found {[f.name for f in result.figures]}")
    file.check_space()
    file.send_numbers("metrics", result.metrics)
    # also curves of one point on the timeline of runs, which tools that select a frame expect
    file.stream.set_time("frame", sequence=0)
    file.send((f"metrics/{name}", rr.Scalars(float(value))) for name, value in result.metrics.items())
    file.stream.log("note", rr.TextDocument(result.note, media_type="text/markdown"), static=True)
    if not can_draw():
        file.warn("only the numbers of figures are recorded: drawings need matplotlib, the extra 'plots'")
    tabs, order = [], {figure.name: k for k, figure in enumerate(result.figures)}
    for title, figures in pages(result.figures):
        columns, rows = grid(len(figures))
        height, lines = _WINDOW[1] / rows - _TITLE, []
        for line in (figures[k : k + columns] for k in range(0, len(figures), columns)):
            views = [_record(file, figure, order[figure.name], _WINDOW[0] / len(line), height) for figure in line]
            lines.append(rrb.Horizontal(*views))
        tabs.append(rrb.Vertical(*lines, name=title))
    config = rrb.TextDocumentView(origin="/__properties/config", name="config")
    note = rrb.TextDocumentView(origin="/note", name="note")
    content = rrb.Vertical(rrb.Tabs(*tabs, config, active_tab=0), note, row_shares=[5.5, 1.0])
    hidden = rrb.TimePanel(state="hidden")  # nothing in a study changes over time
    file.stream.send_blueprint(rrb.Blueprint(content, hidden, auto_views=False, collapse_panels=True))


def _record(file: RecordingFile, figure: Figure, order: int, width: float, height: float) -> rrb.View:
    path, title = entity(figure), figure.name.rpartition("/")[2]
    file.stream.log(path, arrow(numbers(figure) | {"order": order}), static=True)
    if isinstance(figure, Sticks):
        file.send(_sticks(path, figure), static=True)
        return rrb.Spatial3DView(origin=path, name=title, eye_controls=eye(figure))
    if can_draw():
        from workbench.recording.study.drawing import picture  # here, as loading matplotlib takes a third of a second

        image = rr.EncodedImage(contents=picture(figure, width, height), media_type="image/png")
        file.stream.log(f"{path}/drawing", image, static=True)
    return rrb.Spatial2DView(origin=path, name=title, background=_PAPER)


def entity(figure: Figure) -> str:
    """Return the entity path of a figure."""
    return str(rr.new_entity_path(["figures", *figure.name.split("/")]))


def pages(figures: Sequence[Figure]) -> list[tuple[str, list[Figure]]]:
    """Return pages (title, figures) of at most eight figures, in order; figures "page/name" share a page."""
    titled = groupby(figures, lambda figure: figure.name.rpartition("/")[0] or "figures")
    grouped = [(title, list(group)) for title, group in titled]
    return [(title, group[k : k + _PER_PAGE]) for title, group in grouped for k in range(0, len(group), _PER_PAGE)]


def grid(n: int) -> tuple[int, int]:
    """Return the columns and rows for n figures of one page; the last row may have fewer."""
    columns = n if n <= 3 else -(-n // 2)
    return columns, -(-n // columns)


def _sticks(path: str, figure: Sticks) -> Entities:
    """Yield skeletons as line strips coloured by shade."""
    yield path, rr.ViewCoordinates.RIGHT_HAND_Z_UP
    children = np.flatnonzero(figure.parents >= 0)
    bones = figure.positions[:, np.stack([figure.parents[children], children], axis=1)]
    shades = np.rint(_DARKEST + figure.shades[:, None] * (_LIGHTEST - _DARKEST)).astype(np.uint8)
    strips, colors = bones.reshape(-1, 2, 3).astype(np.float32), np.repeat(shades, len(children), axis=0)
    yield f"{path}/skeletons", rr.LineStrips3D(strips, colors=colors, radii=rr.Radius.ui_points(1.2))


def eye(figure: Sticks) -> rrb.EyeControls3D:
    """Return a viewpoint that shows everything, perpendicular to the roots' path, or to x where they stay in place."""
    places = figure.positions.reshape(-1, 3)
    center, diagonal = 0.5 * (places.min(axis=0) + places.max(axis=0)), float(np.linalg.norm(np.ptp(places, axis=0)))
    roots = figure.positions[:, int(np.argmin(figure.parents)), :2]
    _, spread, directions = np.linalg.svd(roots - roots.mean(axis=0))
    along = directions[0] if spread[0] > _MIN_PATH_M else np.array([1.0, 0.0])
    across = np.array([along[1], -along[0], 0.0])
    position = center + 1.15 * diagonal * (across + np.array([0.0, 0.0, 0.2]))
    return rrb.EyeControls3D(position=position, look_target=center, eye_up=[0.0, 0.0, 1.0])
