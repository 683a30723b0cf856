"""Several recordings in one viewer: two side by side, under a/ and b/, or many with names and overlaid curves."""

from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from typing import Any
from uuid import uuid4

import rerun as rr
import rerun.blueprint as rrb

from workbench.core.study import Sticks
from workbench.evaluation.metrics import HEADLINE, SHORT_TITLES, row_of
from workbench.recording.read.chunks import EVERYTHING, read_chunks, recording_of
from workbench.recording.read.crash_probe import refuse_crashing
from workbench.recording.read.reader import Run
from workbench.recording.study.study_recorder import entity
from workbench.recording.write.file import written_file
from workbench.recording.write.layout import page
from workbench.recording.write.scene import ESTIMATE

OVERLAID = "all runs: errors and outcomes"
_EYE_M = (2.1, -2.1, 0.6)
_MAX_FIGURES = 4
_SIDES = {"a": (190, 190, 190), "b": (255, 110, 160)}
_OKABE_ITO = {
    "orange": (230, 159, 0), "light blue": (86, 180, 233), "green": (0, 158, 115), "yellow": (240, 228, 66),
    "vermilion": (213, 94, 0), "pink": (204, 121, 167), "blue": (0, 114, 178), "grey": (150, 150, 150),
}  # fmt: skip


def write_side_by_side(path: Path, a: Run, b: Run, names: tuple[str, str] | None = None) -> None:
    """Write both recordings to an .rrd with a layout that shows them side by side, under the names given.

    Raises InputError for a recording that cannot be read completely.
    """
    refuse_crashing([a.path, b.path])
    names = names or (f"{a.path.parent.name}/{a.path.name}", f"{b.path.parent.name}/{b.path.name}")
    layout = page(_two(a, b, names), fps=None)
    with written_file(path, "workbench_side_by_side", f"{a.id}-side-by-side", layout) as stream:
        for side, run in (("a", a), ("b", b)):
            for chunk in read_chunks(run.path, EVERYTHING):
                below = chunk.entity_path.removeprefix("/").removeprefix("__")
                stream.send_chunks([chunk.with_entity_path(f"/{side}/{below}")])


def write_names(folder: Path, recordings: Sequence[Path], names: Sequence[str]) -> list[Path]:
    """Write an .rrd with the name of each recording, and return their paths.

    Opened together with the recording it becomes part of it, since both have one recording id. Raises InputError for a
    recording that cannot be read.
    """
    paths = [folder / f"name_{k:03d}.rrd" for k in range(len(recordings))]
    for path, recording, name in zip(paths, recordings, names, strict=True):
        with written_file(path, *recording_of(recording), send_properties=False) as stream:
            stream.send_recording_name(name)
    return paths


def write_overlaid(path: Path, runs: Sequence[Run], names: Sequence[str], groups: Sequence[str]) -> None:
    """Write an .rrd with the headline metrics of every run over its frames, and a table of their outcomes.

    Every group of runs has a colour, which the table names, since a legend of all runs would cover the curves. Studies
    have no curves.

    Parameters
    ----------
    runs, names : the runs and their names.
    groups : differences of each run's configuration from the others', without the seed.
    """
    metrics = [name for name in HEADLINE if any(name in run.metrics for run in runs)]
    legend = rrb.PlotLegend(visible=False)
    views = [rrb.TimeSeriesView(origin=f"/{name}", name=row_of(name).heading, plot_legend=legend) for name in metrics]
    rows = [rrb.Horizontal(*views[k : k + 2]) for k in range(0, len(views), 2)]
    content = rrb.Vertical(*rows, rrb.TextDocumentView(origin="/outcomes", name="outcomes"))
    colour_of = dict(zip(dict.fromkeys(groups), cycle(_OKABE_ITO), strict=False))
    words = [colour_of[group] for group in groups]
    with written_file(path, "workbench_overlaid", str(uuid4()), page(content, fps=None)) as stream:
        stream.send_recording_name(OVERLAID)
        for k, (run, name, word) in enumerate(zip(runs, names, words, strict=True)):
            for metric in (each for each in metrics if each in run.metrics):
                (frames, values), place = run.metric(metric), f"{metric}/runs/{k}"
                stream.log(place, rr.SeriesLines(colors=[_OKABE_ITO[word]], widths=[1.5], names=[name]), static=True)
                scalars = rr.Scalars.columns(scalars=values)
                stream.send_columns(place, [rr.TimeColumn("frame", sequence=frames)], scalars)
        table = rr.TextDocument(_outcomes(runs, names, words), media_type="text/markdown")
        stream.log("outcomes", table, static=True)


def _outcomes(runs: Sequence[Run], names: Sequence[str], words: Sequence[str]) -> str:
    """Return a Markdown table of the runs' verdicts, errors and coverage."""
    titles = {key: title for key, title in SHORT_TITLES.items() if any(key in run.result for run in runs)}
    rows = [["run", "colour", "verdict", *titles.values()], ["---"] * (3 + len(titles))]
    for run, name, word in zip(runs, names, words, strict=True):
        verdict = run.properties.get("verdict", {}).get("message", run.status)
        numbers = [f"{run.result[key]:.3g}" if key in run.result else "–" for key in titles]
        rows.append([name, word, str(verdict), *numbers])
    return "\n".join(f"| {' | '.join(each.replace('|', '/') for each in row)} |" for row in rows)


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
