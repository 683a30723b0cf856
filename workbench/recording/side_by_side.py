"""Two recordings in one, for the viewer: what they recorded lies under a/ and under b/."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import Chunk

from workbench.recording.chunks import read_chunks
from workbench.recording.reader import Run
from workbench.recording.study import entity
from workbench.studies.study import Sticks

_MOST_FIGURES = 4  # of studies, beside each other
_COLOURS = {"a": (190, 190, 190), "b": (255, 110, 160)}


def write_side_by_side(path: Path, a: Run, b: Run) -> None:
    """Write both recordings to `path`, an .rrd, with a layout that shows them beside each other."""
    stream = rr.RecordingStream("workbench-check", recording_id=f"{a.properties['run']['id']}-beside")
    stream.set_log_time_enabled(False)
    stream.set_sinks(rr.FileSink(path), default_blueprint=_layout(a, b))
    for name, run in (("a", a), ("b", b)):
        stream.send_chunks([_below(name, chunk) for chunk in read_chunks(run.path, ["/**", "/__properties/**"])])
    stream.flush()
    stream.disconnect()


def _below(name: str, chunk: Chunk) -> Chunk:
    return chunk.with_entity_path(f"/{name}/{chunk.entity_path.removeprefix('/').removeprefix('__')}")


def _layout(a: Run, b: Run) -> rrb.Blueprint:
    columns = [_pictures(name, run) for name, run in (("a", a), ("b", b))]
    rows = [rrb.Horizontal(*pair) for pair in zip(*columns, strict=False)]
    errors = [name for name in a.metric_names if name.startswith("error") and not name.endswith("_map")]
    curves = [] if a.is_study else [rrb.Horizontal(*(_curve(name) for name in errors or a.metric_names))]
    return rrb.Blueprint(
        rrb.Vertical(*rows, *curves),
        rrb.TimePanel(timeline="frame", state="collapsed"),
        auto_views=False,
        collapse_panels=True,
    )


def _pictures(name: str, run: Run) -> Sequence[rrb.View]:
    """The images and the world of a run; the first figures of a study."""
    if run.is_study:
        return [
            rrb.Spatial2DView(origin=f"/{name}/{entity(figure).lstrip('/')}", name=f"{name}: {figure.name}")
            for figure in run.figures
            if not isinstance(figure, Sticks)
        ][:_MOST_FIGURES]
    title = f"{name}: {run.path.parent.name}/{run.path.name}"
    paths = {chunk.entity_path for chunk in read_chunks(run.path, ["/world/**"])}
    cameras = sorted(path.removesuffix("/image") for path in paths if path.endswith("/image"))
    images = [rrb.Spatial2DView(origin=f"/{name}{camera}/image", name=title) for camera in cameras[:1]]
    people = ["$origin/**", *(f"- /{name}{camera}/**" for camera in cameras)]  # the image would hide them
    return [*images, rrb.Spatial3DView(origin=f"/{name}/world", contents=people, name=title)]


def _curve(metric: str) -> rrb.TimeSeriesView:
    paths = {name: f"/{name}/metrics/{metric}" for name in _COLOURS}
    looks: dict[Any, Any] = {
        paths[name]: rr.SeriesLines(colors=[colour], names=[name]).visualizer() for name, colour in _COLOURS.items()
    }
    return rrb.TimeSeriesView(origin="/", contents=list(paths.values()), name=metric, overrides=looks)
