"""`workbench report`: tables and plots of many recordings, grouped by the varied configuration keys."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from workbench.recording.read.crash_probe import open_sound_runs
from workbench.recording.study.figures import can_draw
from workbench.results.report.contents import contents
from workbench.results.report.groups import Grouping, group_runs
from workbench.results.report.page import Plot, render, terminal
from workbench.utils.atomic_write import write_files
from workbench.utils.errors import InputError


def report(
    recordings: Annotated[
        list[Path], typer.Argument(metavar="FOLDER", help="Folders of recordings, or single recordings.")
    ],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder for report.html, report.md, plots and CSV tables.")
    ] = None,
) -> None:
    """Report metrics over seeds and people, for each group of runs with equal configurations.

    Examples:
      workbench report recordings/sweeps/priors
      workbench report recordings/sweeps/priors recordings/runs/walk_straight -o report/
    """
    runs, unreadable = open_sound_runs(*recordings)
    if not runs and not unreadable:
        places = ", ".join(map(str, recordings))
        raise InputError(f"{places}: expected recordings (.rrd, .rrd.part), found none")
    grouping = group_runs(runs, unreadable)
    report_contents = contents(grouping)
    if output is not None:
        title = f"Report on {', '.join(place.resolve().name for place in recordings)}"
        plots = _plots(grouping)
        files: dict[str, str | bytes] = {f"{plot.name}.png": plot.png for plot in plots}
        files["report.csv"] = grouping.labelled(grouping.statistics, keys=True).to_csv(index=False)
        files["runs.csv"] = grouping.labelled(grouping.values, keys=True).to_csv(index=False)
        files |= {name: render(name, title, report_contents, plots) for name in ("report.md", "report.html")}
        write_files(output, files)
    print(terminal(report_contents))
    if output is not None:
        print(f"\nopen: {output / 'report.html'}")


def _plots(grouping: Grouping) -> list[Plot]:
    """Return the plots of the groups; [], with a message, without matplotlib."""
    if not can_draw():
        print("workbench report: plots need matplotlib: pip install -e '.[plots]' in the clone", file=sys.stderr)
        return []
    from workbench.results.report.plots import plots_of  # imported here, as the terminal's report does not need it

    return plots_of(grouping)
