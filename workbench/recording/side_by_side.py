"""Two recordings side by side in one, under a/ and b/."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from workbench.core.study import Sticks
from workbench.evaluation.metrics import HEADLINE, row_of
from workbench.recording.read.chunks import EVERYTHING, read_chunks
from workbench.recording.read.reader import Run
from workbench.recording.study.study_recorder import entity
from workbench.recording.write.file import written_file
from workbench.recording.write.layout import page
from workbench.recording.write.scene import ESTIMATE

_EYE_M = (2.1, -2.1, 0.6)
_MAX_FIGURES = 4
_SIDES = {"a": (190, 190, 190), "b": (255, 110, 160)}


def write_side_by_side(path: Path, a: Run, b: Run, names: tuple[str, str] | None = None) -> None:
    """Write both recordings, decoded before by `crash_probe`, to an .rrd with a layout that shows them side by side,
    under the names given."""
    names = names or (f"{a.path.parent.name}/{a.path.name}", f"{b.path.parent.name}/{b.path.name}")
    layout = page(_two(a, b, names), fps=None)
    with written_file(path, "workbench_side_by_side", f"{a.id}-side-by-side", layout) as stream:
        for side, run in (("a", a), ("b", b)):
            for chunk in read_chunks(run.path, EVERYTHING):
                below = chunk.entity_path.removeprefix("/").removeprefix("__")
                stream.send_chunks([chunk.with_entity_path(f"/{side}/{below}")])


def _two(a: Run, b: Run, names: tuple[str, str]) -> rrb.Container:
    columns = [_pictures(side, run, f"{side}: {name}") for side, run, name in zip("ab", (a, b), names, strict=True)]
    rows = [rrb.Horizontal(*pair) for pair in zip(*columns, strict=False)]
    recorded = {*a.metric_names, *b.metric_names}
    metrics = [name for name in HEADLINE if name in recorded] or sorted(recorded)
    return rrb.Vertical(*rows, *([] if a.is_study else [rrb.Horizontal(*map(_curve, metrics))]))


def _pictures(side: str, run: Run, title: str) -> Sequence[rrb.View]:
    """Return views of the images and the world of a run, or of a study's first figures."""
    if run.is_study:
        figures = [figure for figure in run.figures if not isinstance(figure, Sticks)][:_MAX_FIGURES]
        places = {figure.name: f"/{side}/{entity(figure).lstrip('/')}" for figure in figures}
        return [rrb.Spatial2DView(origin=place, name=f"{side}: {name}") for name, place in places.items()]
    paths = {chunk.entity_path for chunk in read_chunks(run.path, ["/world/**"])}
    cameras = sorted(path.removesuffix("/image") for path in paths if path.endswith("/image"))
    images = [rrb.Spatial2DView(origin=f"/{side}{camera}/image", name=title) for camera in cameras[:1]]
    people = ["$origin/**", *(f"- /{side}{camera}/**" for camera in cameras)]  # the image would hide them
    people += [f"- /{side}/{ESTIMATE}/body"] * (f"/{ESTIMATE}/surface" in paths)
    eye = None
    if len(run.joints.positions):  # from three metres away, following the person
        person = run.joints.positions[0].mean(axis=0)
        skeleton = f"/{side}/{ESTIMATE}/skeleton"
        up = [0.0, 0.0, 1.0]
        eye = rrb.EyeControls3D(position=person + _EYE_M, look_target=person, eye_up=up, tracking_entity=skeleton)
    return [*images, rrb.Spatial3DView(origin=f"/{side}/world", contents=people, name=title, eye_controls=eye)]


def _curve(metric: str) -> rrb.TimeSeriesView:
    drawn: dict[Any, Any] = {
        f"/{side}/metrics/{metric}": rr.SeriesLines(colors=[colour], widths=[2.0], names=[side]).visualizer()
        for side, colour in _SIDES.items()
    }
    return rrb.TimeSeriesView(origin="/", contents=list(drawn), name=row_of(metric).heading, overrides=drawn)
