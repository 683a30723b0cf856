"""Draw the papers' figures from recordings, as PNG and PDF.

    python -m analysis.figures [NAME…] [--quick] [--runs FOLDER] [--data DATA] [-o FOLDER]

Without a NAME all figures are made; a NAME may be a script's or its beginning, such as a_fig4 or c. Each takes the
newest complete recording of its experiments in FOLDER, and one that is not there is run first, at the paper's size.
What a paper tracks is shown twice, as the paper writes it (paper=literal) and as ours, with numbers over ten seeds (two
with --quick), see `replicates`; `analysis.deviations` lists what is not the paper's in the literal rows.
"""

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType

from matplotlib.style import context

from analysis.command import chosen
from analysis.figures.readings import Reading
from analysis.figures.recordings import Source, recording
from analysis.figures.replicates import replicates
from workbench.recording.read.crash_probe import open_sound_runs
from workbench.recording.read.reader import Run
from workbench.recording.study.drawing import STYLE
from workbench.utils.errors import InputError


def scripts(names: Sequence[str] = ()) -> dict[str, ModuleType]:
    """Return the scripts whose names begin with one of these, or all; raises InputError for one that fits none."""
    every = sorted(path.stem for path in Path(__file__).parent.glob("[abcd]_*.py"))
    return {script: import_module(f"analysis.figures.{script}") for script in chosen(names, every)}


def save(script: ModuleType, readings: Mapping[str, Reading], folder: Path, name: str) -> None:
    """Draw a figure of its experiments' readings and write NAME.png and NAME.pdf."""
    with context(STYLE):
        figure = script.draw(readings)
        figure.savefig(folder / f"{name}.png")
        figure.savefig(folder / f"{name}.pdf", metadata={"CreationDate": None})


def make(chosen: Mapping[str, ModuleType], source: Source, folder: Path) -> list[str]:
    """Make these figures; a sentence for each that could not be made."""
    recordings, problems = open_sound_runs(source.folder)
    for problem in problems:
        print(f"left out: {problem.reason}", file=sys.stderr)
    made: dict[tuple[str, tuple[str, ...]], Reading] = {}
    failed = []
    for name, script in chosen.items():
        print(name, flush=True)
        try:
            for experiment in script.EXPERIMENTS:
                if (experiment, script.READINGS) not in made:
                    made[experiment, script.READINGS] = _reading(experiment, script.READINGS, source, recordings)
            save(script, {name: made[name, script.READINGS] for name in script.EXPERIMENTS}, folder, name)
        except InputError as error:
            failed.append(f"{name}: {error}")
    return failed


def _reading(experiment: str, papers: Sequence[str], source: Source, recordings: Sequence[Run]) -> Reading:
    """Return an experiment's recordings and, where both readings are shown, its numbers over seeds."""
    runs = {paper: recording(experiment, source, recordings, paper) for paper in papers}
    numbers = {paper: replicates(experiment, paper, source) for paper in papers} if len(papers) > 1 else {}
    return Reading(runs, numbers)


def main() -> int:
    """Return exit code 0 when all figures were made, 1 when some could not be, 2 for bad input."""
    parser = argparse.ArgumentParser(
        prog="python -m analysis.figures", description="The papers' figures from recordings."
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="a figure's script or how its name begins; none: all")
    parser.add_argument("--quick", action="store_true", help="what is missing is run at a small size")
    parser.add_argument(
        "--runs", type=Path, default=Path("recordings/runs"), help="where recordings are (recordings/runs)"
    )
    parser.add_argument("--data", default=os.environ.get("WORKBENCH_DATA"), help="recorded motion ($WORKBENCH_DATA)")
    parser.add_argument(
        "-o", dest="folder", type=Path, default=Path("build/figures"), help="for the files (build/figures)"
    )
    arguments = parser.parse_args()
    try:
        arguments.runs.mkdir(parents=True, exist_ok=True)
        arguments.folder.mkdir(parents=True, exist_ok=True)
        source = Source(arguments.runs, arguments.data, arguments.quick)
        failed = make(scripts(arguments.names), source, arguments.folder)
    except InputError as error:
        print(f"figures: {error}", file=sys.stderr)
        return 2
    for sentence in failed:
        print(f"not made: {sentence}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
