"""Several recordings in one viewer: two in one, under a/ and under b/, or many as they are, with names."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from workbench.core.study import Sticks
from workbench.recording.read.chunks import EVERYTHING, read_chunks, recording_of
from workbench.recording.read.crash_probe import refuse_fatal
from workbench.recording.read.reader import Run
from workbench.recording.study.study_recorder import entity
from workbench.recording.write import styles
from workbench.recording.write.file import new_stream
from workbench.recording.write.layout import page
from workbench.recording.write.scene import ESTIMATE

CURVES = ("error_abs_mm", "error_rel_mm", "error_px", "coverage_90")
"""Of all metrics those that are compared."""
_EYE_M = (2.1, -2.1, 0.6)
_MOST_FIGURES = 4  # of studies, beside each other
_COLOURS = {"a": (190, 190, 190), "b": (255, 110, 160)}


def write_side_by_side(path: Path, a: Run, b: Run, names: tuple[str, str] | None = None) -> None:
    """Write both recordings to `path`, an .rrd, with a layout that shows them beside each other, under these names.

    Raises InputError for one that cannot be read whole.
    """
    refuse_fatal([a.path, b.path])
    names = names or (f"{a.path.parent.name}/{a.path.name}", f"{b.path.parent.name}/{b.path.name}")
    stream = new_stream("workbench-check", f"{a.id}-beside")
    stream.set_sinks(rr.FileSink(path), default_blueprint=_layout(a, b, names))
    for name, run in (("a", a), ("b", b)):
        chunks = read_chunks(run.path, EVERYTHING)
        below = [f"/{name}/{chunk.entity_path.removeprefix('/').removeprefix('__')}" for chunk in chunks]
        stream.send_chunks([chunk.with_entity_path(path) for chunk, path in zip(chunks, below, strict=True)])
    stream.flush()
    stream.disconnect()


def write_names(folder: Path, recordings: Sequence[Path], names: Sequence[str]) -> list[Path]:
    """Write an .rrd for each recording that holds nothing but its name; returns their paths.

    Opened together with the recording it becomes part of it, since both have one recording id. Raises InputError where
    one cannot be read.
    """
    written = [folder / f"name_{k:03d}.rrd" for k in range(len(recordings))]
    for path, recording, name in zip(written, recordings, names, strict=True):
        application, recording_id = recording_of(recording)
        stream = new_stream(application, recording_id, send_properties=False)
        stream.set_sinks(rr.FileSink(path))
        stream.send_recording_name(name)
        stream.flush()
        stream.disconnect()
    return written


def _layout(a: Run, b: Run, names: tuple[str, str]) -> rrb.Blueprint:
    columns = [_pictures(side, run, f"{side}: {name}") for side, run, name in zip("ab", (a, b), names, strict=True)]
    rows = [rrb.Horizontal(*pair) for pair in zip(*columns, strict=False)]
    known = {*a.metric_names, *b.metric_names}
    metrics = [name for name in CURVES if name in known] or sorted(known)
    curves = [] if a.is_study else [rrb.Horizontal(*map(_curve, metrics))]
    return page(rrb.Vertical(*rows, *curves), fps=None)


def _pictures(side: str, run: Run, title: str) -> Sequence[rrb.View]:
    """Show the images and the world of a run, the first figures of a study."""
    if run.is_study:
        return [
            rrb.Spatial2DView(origin=f"/{side}/{entity(figure).lstrip('/')}", name=f"{side}: {figure.name}")
            for figure in run.figures
            if not isinstance(figure, Sticks)
        ][:_MOST_FIGURES]
    paths = {chunk.entity_path for chunk in read_chunks(run.path, ["/world/**"])}
    cameras = sorted(path.removesuffix("/image") for path in paths if path.endswith("/image"))
    images = [rrb.Spatial2DView(origin=f"/{side}{camera}/image", name=title) for camera in cameras[:1]]
    people = ["$origin/**", *(f"- /{side}{camera}/**" for camera in cameras)]  # the image would hide them
    people += [f"- /{side}/{ESTIMATE}/body"] * (f"/{ESTIMATE}/surface" in paths)
    world = rrb.Spatial3DView(origin=f"/{side}/world", contents=people, name=title, eye_controls=_eye(side, run))
    return [*images, world]


def _eye(side: str, run: Run) -> rrb.EyeControls3D | None:
    """From three metres away; the eye follows the person."""
    if not len(run.joints.positions):
        return None
    person = run.joints.positions[0].mean(axis=0)
    return rrb.EyeControls3D(
        position=person + _EYE_M, look_target=person, eye_up=[0.0, 0.0, 1.0],
        tracking_entity=f"/{side}/{ESTIMATE}/skeleton",
    )  # fmt: skip


def _curve(metric: str) -> rrb.TimeSeriesView:
    paths = {name: f"/{name}/metrics/{metric}" for name in _COLOURS}
    drawn: dict[Any, Any] = {
        paths[name]: rr.SeriesLines(colors=[colour], widths=[2.0], names=[name]).visualizer()
        for name, colour in _COLOURS.items()
    }
    return rrb.TimeSeriesView(origin="/", contents=list(paths.values()), name=styles.title(metric), overrides=drawn)
