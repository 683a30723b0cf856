"""Whether bands hold the truth of people left out, by part of the body: a table over people and seeds.

    python -m analysis.figures.left_out --data DATA [-o FILE] [--rows points] [--people 02_01 …] [--seeds 2]

Points, 2-D joints and images of the people of clips.report, on whom nothing was chosen and from whom nothing is
learned, shown as usual and exactly as they are told. FILE keeps every run, see `kept_runs`.
"""

import argparse
from collections.abc import Mapping
from pathlib import Path

from analysis.figures.kept_runs import Numbers, Run, every_run, numbers_of, people, spread
from workbench.evaluation.step_calibration import GROUPS

START = ("prior.base.start_position=0.03", "prior.base.start_rotation=0.05")
"""How far off the start is told, m and rad, where a filter begins with it."""
FROM_THE_START = ("dataset.first_frame=0",)
"""Some walks are short, and points come 14 times a second."""
TRACKED: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "points, one style": ("points_walk_steady", FROM_THE_START),
    "points, varying style": ("points_walk_variable", FROM_THE_START),
    "keypoints, least squares": ("walk_keypoints_synthetic", ()),
    "keypoints, particles": ("walk_keypoints_synthetic", ("prior=jitter", "inference=particle_filter", *START)),
    "images, particles": ("walk_best", ()),
}
"""Experiments and overrides by what is seen and how it is followed."""
SHOWN = {"": (), ", exact": ("dataset.exact=true",)}
ROWS = {
    f"{tracked}{shown}": (experiment, (*own, *exact))
    for tracked, (experiment, own) in TRACKED.items()
    for shown, exact in SHOWN.items()
}
COVERAGES = ("coverage_90", *(f"coverage_90_{group}" for group in GROUPS))
SCORES = {"nees_per_dim": ".1f", "crps_mm": ".1f", "crps_deg": ".1f", "mpjpe_abs_mm": ".0f", "mpjpe_px": ".1f"}
"""Beside coverage, with the form of their digits."""
MEASURED = (*COVERAGES, *SCORES, "coverage_50", "expected_calibration_error", "nll", "tracked")


def table(found: Mapping[Run, Numbers]) -> str:
    """Markdown: means over people of their means over seeds, ± the deviation between people, and that between seeds."""
    names = ["90 % band", *GROUPS, *SCORES]
    lines = [f"| who is left out | {' | '.join(names)} |", "|" + " --- |" * (len(names) + 1)]
    for row in dict.fromkeys(run.row for run in found):
        runs = {run: numbers for run, numbers in found.items() if run.row == row}
        cells = [spread(runs, name, ".2f") for name in COVERAGES] + [spread(runs, *score) for score in SCORES.items()]
        lines.append(f"| {row} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> int:
    """Run what is missing and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder with recorded motion")
    parser.add_argument("-o", "--out", type=Path, default=Path("build/left_out.jsonl"), metavar="FILE")
    parser.add_argument("--rows", default="", help="only those whose name begins so")
    parser.add_argument("--people", nargs="+", help="clips; by default those of clips.report")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--frames", type=int, default=30)
    chosen = parser.parse_args()
    same = [f"paths.data={chosen.data}", f"dataset.n_frames={chosen.frames}"]
    rows = {row: tracked for row, tracked in ROWS.items() if row.startswith(chosen.rows)}
    runs = every_run(rows, chosen.people or people("report", chosen.data), chosen.seeds, same)
    print(table(numbers_of(runs, chosen.out, MEASURED)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
