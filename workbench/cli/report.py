"""`workbench report`: tables and plots of many recordings, grouped by the varied configuration keys."""

from pathlib import Path
from typing import Annotated

import typer

from workbench.recording.read.crash_probe import open_sound_runs
from workbench.results.report.contents import contents
from workbench.results.report.groups import group_runs
from workbench.results.report.page import render, terminal
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
        from workbench.results.report.plots import plots_of  # imported here, as the terminal's report does not need it

        title = f"Report on {', '.join(place.resolve().name for place in recordings)}"
        plots = plots_of(grouping)
        files: dict[str, str | bytes] = {f"{plot.name}.png": plot.png for plot in plots}
        files["report.csv"] = grouping.labelled(grouping.statistics, keys=True).to_csv(index=False)
        files["runs.csv"] = grouping.labelled(grouping.values, keys=True).to_csv(index=False)
        files |= {name: render(name, title, report_contents, plots) for name in ("report.md", "report.html")}
        write_files(output, files)
    print(terminal(report_contents))
    if output is not None:
        print(f"\nopen: {output / 'report.html'}")
