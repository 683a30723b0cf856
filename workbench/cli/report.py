"""workbench-report: many recordings as tables and plots, grouped by what varied in their configurations."""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from workbench.recording.read.crash_probe import open_sound_runs
from workbench.results.report.contents import contents, group_csv, run_csv
from workbench.results.report.groups import Grouping, group_runs
from workbench.results.report.page import as_markdown, as_page, terminal
from workbench.utils.atomic_write import whole_file
from workbench.utils.errors import InputError


def main(argv: Sequence[str] | None = None) -> int:
    """Report on recordings. Returns 0 when there is something to report, 2 after an error, which is printed."""
    parser = argparse.ArgumentParser(prog="workbench-report", description=__doc__)
    parser.add_argument(
        "recordings", metavar="FOLDER", type=Path, nargs="+", help="folders with recordings, or single recordings"
    )
    parser.add_argument(
        "-o", "--output", metavar="OUT", type=Path, help="a folder for report.html, report.md, plots, and CSV tables"
    )
    arguments = parser.parse_args(argv)
    try:
        runs, unreadable = open_sound_runs(*arguments.recordings)
        if not runs and not unreadable:
            places = ", ".join(map(str, arguments.recordings))
            raise InputError(f"{places}: expected recordings (.rrd, .rrd.part), found none")
        grouping = group_runs(runs, unreadable)
        if arguments.output is not None:
            names = ", ".join(place.resolve().name for place in arguments.recordings)
            write(grouping, f"Report on {names}", arguments.output)
        print(terminal(contents(grouping)))
        if arguments.output is not None:
            print(f"\nlook at it: {arguments.output / 'report.html'}")
        sys.stdout.flush()
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    except BrokenPipeError:  # whoever reads, such as `head`, has seen enough; nothing is left to flush at the exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def write(grouping: Grouping, title: str, folder: Path) -> None:
    """Write report.html, report.md with its plots, report.csv and runs.csv; raises InputError where that fails."""
    from workbench.results.report.plots import pictures  # the terminal's report does without matplotlib

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: expected a folder to write to: {error.strerror}") from None
    found, plots = contents(grouping), pictures(grouping)
    files = {
        **{f"{picture.name}.png": picture.png for picture in plots},
        "report.csv": group_csv(grouping).encode(),
        "runs.csv": run_csv(grouping).encode(),
        "report.md": as_markdown(title, found, plots).encode(),
        "report.html": as_page(title, found, plots).encode(),
    }
    for name, content in files.items():
        with whole_file(folder / name) as part:
            part.write_bytes(content)


if __name__ == "__main__":
    sys.exit(main())
