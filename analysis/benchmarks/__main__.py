"""Benchmarks of the workbench in one table: each figure with its required value and its peer.

    python -m analysis.benchmarks [NAME…] [--json FILE] [--compare FILE] [--worse SHARE]
    python -m analysis.benchmarks --growth FOLDER

The second command draws time and memory against the number of particles and the length of a clip. Without a NAME the
first one measures everything. --compare fails if a figure is worse than that of FILE, such as
analysis/benchmarks/reference.json, by more than SHARE, or is missing there or here. Figures of a database of motions
use the recordings in the folder $WORKBENCH_DATA if it is set, otherwise generated ones. Times are minima over
alternating repeats; close other programs.
"""

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from analysis.benchmarks import batch, draws, likelihood, processes, scaling, tracking, video_fit
from analysis.benchmarks.figure import Figure, differences, read_figures, table, write_figures
from analysis.benchmarks.measuring import machine
from workbench.utils.errors import InputError

BENCHMARKS: Mapping[str, Callable[[], list[Figure]]] = {
    "kernel": likelihood.kernel_figures,
    "threads": likelihood.thread_figures,
    "step": tracking.speed_figures,
    "recording": tracking.recording_figures,
    "cues": tracking.cues_figures,
    "tree": draws.tree_figures,
    "exact": draws.exact_figures,
    "batch": batch.figures,
    "video": video_fit.figures,
    "memory": processes.memory_figures,
    "length": processes.length_figures,
    "start": processes.start_figures,
    "commands": processes.command_figures,
    "sweep": processes.sweep_figures,
}
"""Functions that measure figures."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Return the exit code: 0, 1 when a figure is worse than the one it is compared with, 2 for bad input."""
    parser = argparse.ArgumentParser(
        prog="python -m analysis.benchmarks", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(BENCHMARKS)}; none: all")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write figures here, and their table to a .md file")
    parser.add_argument("--compare", type=Path, metavar="FILE", help="figures written earlier")
    parser.add_argument("--worse", type=float, default=0.25, metavar="SHARE", help="tolerated loss (0.25)")
    parser.add_argument("--growth", type=Path, metavar="FOLDER", help="draw figures of growth here instead")
    options = parser.parse_args(arguments)
    try:
        if options.growth:
            scaling.draw(options.growth)
            return 0
        if unknown := [name for name in options.names if name not in BENCHMARKS]:
            raise InputError(f"{unknown[0]}: expected one of {', '.join(BENCHMARKS)}")
        reference = read_figures(options.compare) if options.compare else []
        print(f"{machine()}\n")
        figures: list[Figure] = []
        for name in options.names or BENCHMARKS:
            print(f"measuring: {name}", file=sys.stderr, flush=True)
            figures += BENCHMARKS[name]()
        print(table(figures))
        if options.json:
            write_figures(options.json, figures)
    except InputError as error:
        print(f"benchmarks: {error}", file=sys.stderr)
        return 2
    if not options.compare:
        return 0
    if options.names:
        measured = {figure.name for figure in figures}
        reference = [figure for figure in reference if figure.name in measured]
    worse = differences(figures, reference, options.worse)
    print("\n".join(["", *(worse or [f"no figure is worse than in {options.compare} by over {options.worse:.0%}"])]))
    return 1 if worse else 0


if __name__ == "__main__":
    sys.exit(main())
