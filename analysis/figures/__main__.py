"""Draw the papers' figures from recordings, as PNG and PDF.

    python -m analysis.figures [NAME…] [--quick] [--runs FOLDER] [--data DATA] [-o FOLDER]

Without a NAME all figures are made; a NAME may be a figure's or its beginning, such as a_fig4 or c. Each takes the
newest complete recording of its experiments in FOLDER, and one that is not there is run first, at the paper's size.
What a paper tracks is shown twice, as the paper writes it (paper=literal) and as ours, with numbers over ten seeds (two
with --quick), see `replicates`; `analysis.deviations` lists what is not the paper's in the literal rows.
"""

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.style import context

from analysis.command import chosen
from analysis.figures import (
    a_fig1_body,
    a_fig2_planar_patch,
    a_fig4_arm_marginals,
    c_dimension,
    c_fig3_arm,
    point_figures,
    sequence_figures,
    study_figures,
    synthesis_figures,
)
from analysis.figures.readings import PaperFigure, Reading
from analysis.figures.recordings import Source, recording
from analysis.figures.replicates import replicates
from workbench.recording.read.crash_probe import open_sound_runs
from workbench.recording.read.reader import Run
from workbench.recording.study.drawing import STYLE
from workbench.utils.errors import InputError

MODULES = (
    a_fig1_body, a_fig2_planar_patch, a_fig4_arm_marginals, c_dimension, c_fig3_arm, point_figures, sequence_figures,
    study_figures, synthesis_figures,
)  # fmt: skip


def paper_figures() -> dict[str, PaperFigure]:
    """Return all figures by name, in alphabetical order."""
    return dict(sorted(pair for module in MODULES for pair in module.FIGURES.items()))


def save(figure: PaperFigure, readings: Mapping[str, Reading], folder: Path, name: str) -> None:
    """Draw a figure of its experiments' readings and write NAME.png and NAME.pdf."""
    with context(STYLE):
        drawn = figure.draw(readings)
        drawn.savefig(folder / f"{name}.png")
        drawn.savefig(folder / f"{name}.pdf", metadata={"CreationDate": None})


def make(figures: Mapping[str, PaperFigure], source: Source, folder: Path) -> list[str]:
    """Make these figures; a sentence for each that could not be made."""
    recordings, problems = open_sound_runs(source.folder)
    for problem in problems:
        print(f"left out: {problem.reason}", file=sys.stderr)
    made: dict[tuple[str, tuple[str, ...]], Reading] = {}
    failed = []
    for name, figure in figures.items():
        print(name, flush=True)
        try:
            for experiment in figure.experiments:
                if (experiment, figure.readings) not in made:
                    made[experiment, figure.readings] = _reading(experiment, figure.readings, source, recordings)
            save(figure, {each: made[each, figure.readings] for each in figure.experiments}, folder, name)
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
    parser.add_argument("names", nargs="*", metavar="NAME", help="a figure or how its name begins; none: all")
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
        every = paper_figures()
        failed = make({name: every[name] for name in chosen(arguments.names, [*every])}, source, arguments.folder)
    except InputError as error:
        print(f"figures: {error}", file=sys.stderr)
        return 2
    for sentence in failed:
        print(f"not made: {sentence}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
