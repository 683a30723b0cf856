"""The curves of many runs over each other, and what became of each, in a recording of their own."""

from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from uuid import uuid4

import rerun as rr
import rerun.blueprint as rrb

from workbench.evaluation.headline import SHORT_TITLES
from workbench.recording.read.reader import Run
from workbench.recording.side_by_side import CURVES
from workbench.recording.write import styles
from workbench.recording.write.file import new_stream
from workbench.recording.write.layout import page

NAME = "all runs: errors and how each came out"
_RUNS, _TABLE = "runs", "outcomes"
_COLOURS = {
    "orange": (230, 159, 0), "light blue": (86, 180, 233), "green": (0, 158, 115), "yellow": (240, 228, 66),
    "vermilion": (213, 94, 0), "pink": (204, 121, 167), "blue": (0, 114, 178), "grey": (150, 150, 150),
}  # fmt: skip
"""After Okabe & Ito, by the words of the table: a legend with a line for each run would cover the curves."""


def write_overlaid(path: Path, runs: Sequence[Run], names: Sequence[str], groups: Sequence[str]) -> None:
    """Write an .rrd with the errors and the coverage of every run by its frames, one colour for each of `groups`, which
    names what differs beside seeds, and a table of the verdicts and numbers; runs that are studies have no curves."""
    stream = new_stream("workbench-runs", str(uuid4()))
    metrics = [name for name in CURVES if any(name in run.metrics for run in runs)]
    legend = rrb.PlotLegend(visible=False)
    curves = [rrb.TimeSeriesView(origin=f"/{name}", name=styles.title(name), plot_legend=legend) for name in metrics]
    table = rrb.TextDocumentView(origin=f"/{_TABLE}", name="how each came out")
    rows = [rrb.Horizontal(*curves[k : k + 2]) for k in range(0, len(curves), 2)]
    stream.set_sinks(rr.FileSink(path), default_blueprint=page(rrb.Vertical(*rows, table), fps=None))
    stream.send_recording_name(NAME)
    words = dict(zip(dict.fromkeys(groups), cycle(_COLOURS), strict=False))
    for k, (run, name, group) in enumerate(zip(runs, names, groups, strict=True)):
        for metric in (each for each in metrics if each in run.metrics):
            frames, values = run.metric(metric)
            place = f"{metric}/{_RUNS}/{k}"
            stream.log(place, rr.SeriesLines(colors=[_COLOURS[words[group]]], widths=[1.5], names=[name]), static=True)
            stream.send_columns(place, [rr.TimeColumn("frame", sequence=frames)], rr.Scalars.columns(scalars=values))
    stream.log(
        _TABLE,
        rr.TextDocument(_table(runs, names, [words[group] for group in groups]), media_type="text/markdown"),
        static=True,
    )
    stream.flush()
    stream.disconnect()


def _table(runs: Sequence[Run], names: Sequence[str], words: Sequence[str]) -> str:
    """Put what became of every run into a table, in Markdown."""
    shown = {key: title for key, title in SHORT_TITLES.items() if any(key in run.result for run in runs)}
    rows = [["run", "colour", "verdict", *shown.values()], ["---"] * (3 + len(shown))]
    for run, name, word in zip(runs, names, words, strict=True):
        verdict = run.properties.get("verdict", {}).get("sentence", run.status)
        numbers = [f"{run.result[key]:.3g}" if key in run.result else "–" for key in shown]
        rows.append([name, word, str(verdict), *numbers])
    return "\n".join(f"| {' | '.join(each.replace('|', '/') for each in row)} |" for row in rows)
