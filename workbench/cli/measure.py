"""`workbench measure`: steps, speed and joint angles of a recorded motion, with intervals."""

from pathlib import Path
from typing import Annotated

import typer

from workbench.recording.read.crash_probe import read_sound_run
from workbench.results.formatting import text
from workbench.results.measure.display import display
from workbench.results.measure.files import write_measures
from workbench.results.measure.measures import measures_of
from workbench.utils.text import printable


def measure(
    recording: Annotated[
        Path, typer.Argument(metavar="RUN.rrd", help="A recording of a person, its folder, or an incomplete one.")
    ],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="Folder of the files; by default the recording's."),
    ] = None,
) -> None:
    """Measure steps, speed and joint angles of a person who walks or runs, with 90 % intervals.

    Of another motion, the range, peak speed and repetitions of each joint.
    Writes measures.csv, angles.csv and the page measures.html.

    Examples:
      workbench measure run.rrd
      workbench measure run.rrd -o measures/
    """
    run = read_sound_run(recording)
    measures = measures_of(run)
    folder = run.folder if output is None else output
    paths = write_measures(folder, run.folder.resolve().name, measures)
    print(text(display(measures)))
    print()
    for note in measures.notes:
        print(printable(note))
    print(f"\nwritten: {', '.join(map(str, paths))}")
