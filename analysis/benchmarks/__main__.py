"""Benchmarks of the workbench in one table: each figure with its required value and its peer.

    python -m analysis.benchmarks [NAME…] [--json FILE] [--compare FILE] [--worse SHARE]

Without a NAME everything is measured; figures measured together come together. --compare fails when a figure is worse
than that of FILE, such as analysis/benchmarks/reference.json, by more than SHARE, or was not measured. Figures of a
database of motions use the recordings in the folder $WORKBENCH_DATA where it is set, else generated ones. Times are
minima over repeats that take turns; close other programs.
"""

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from analysis.benchmarks import batch, draws, likelihood, processes, tracking, video_fit
from analysis.benchmarks.figure import Figure, differences, read_figures, table, write_figures
from analysis.benchmarks.measuring import machine
from workbench.utils.errors import InputError

BENCHMARKS: Mapping[str, Callable[[], list[Figure]]] = {
    "kernel_vs_numpy": likelihood.kernel_figures,
    "kernel_vs_lookups": likelihood.kernel_figures,
    "step_fps": tracking.speed_figures,
    "two_threads": likelihood.thread_figures,
    "tree_draw_us": draws.tree_figures,
    "exact_draw_us": draws.exact_figures,
    "tree_vs_ckdtree": draws.tree_figures,
    "batch_ms_per_frame": batch.figures,
    "batch_vs_scipy": batch.figures,
    "video_fit_100_1": video_fit.figures,
    "video_fit_400_1": video_fit.figures,
    "video_fit_3000_1": video_fit.figures,
    "video_fit_100_4": video_fit.figures,
    "video_fit_400_4": video_fit.figures,
    "video_fit_3000_4": video_fit.figures,
    "video_fit_vs_functions": video_fit.figures,
    "video_fit_memory_gb": video_fit.figures,
    "recording_share": tracking.recording_figures,
    "several_cues_ms": tracking.cues_figures,
    "memory_1e5_gb": processes.memory_figures,
    "memory_5000_frames_mb": processes.length_figures,
    "start_compile_s": processes.start_figures,
    "start_cached_s": processes.start_figures,
    "two_workers": processes.sweep_figures,
}
"""What measures each figure."""


def chosen(names: Sequence[str]) -> list[Callable[[], list[Figure]]]:
    """Return what measures the figures of these names, or all; raises InputError for an unknown name."""
    if unknown := [name for name in names if name not in BENCHMARKS]:
        raise InputError(f"{unknown[0]}: expected a figure's name, of {', '.join(BENCHMARKS)}")
    return list(dict.fromkeys(BENCHMARKS[name] for name in names or BENCHMARKS))


def measure(functions: Sequence[Callable[[], list[Figure]]]) -> list[Figure]:
    """Return all their figures."""
    figures: list[Figure] = []
    for function in functions:
        print(f"measuring: {function.__module__.rpartition('.')[2]}, {function.__name__}", file=sys.stderr, flush=True)
        figures += function()
    return figures


def main(arguments: Sequence[str] | None = None) -> int:
    """Return the exit code: 0, 1 when a figure is worse than the one it is compared with, 2 for bad input."""
    parser = argparse.ArgumentParser(
        prog="python -m analysis.benchmarks", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="figures to measure; none: all")
    parser.add_argument(
        "--json", type=Path, metavar="FILE", help="write the figures here, and their table to a .md file"
    )
    parser.add_argument("--compare", type=Path, metavar="FILE", help="figures written earlier")
    parser.add_argument("--worse", type=float, default=0.25, metavar="SHARE", help="how much worse is too much (0.25)")
    options = parser.parse_args(arguments)
    try:
        functions = chosen(options.names)
        reference = read_figures(options.compare) if options.compare else []
        print(f"{machine()}\n")
        figures = measure(functions)
        print(table(figures))
        if options.json:
            write_figures(options.json, figures)
    except InputError as error:
        print(f"benchmarks: {error}", file=sys.stderr)
        return 2
    if not options.compare:
        return 0
    asked = {*options.names, *(figure.name for figure in figures)}
    worse = differences(
        figures, [figure for figure in reference if not options.names or figure.name in asked], options.worse
    )
    print("\n".join(["", *(worse or [f"no figure is worse than in {options.compare} by over {options.worse:.0%}"])]))
    return 1 if worse else 0


if __name__ == "__main__":
    sys.exit(main())
