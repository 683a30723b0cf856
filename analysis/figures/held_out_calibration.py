"""Coverage of credible intervals for held-out people, by part of the body: a table over people and seeds.

    python -m analysis.figures.held_out_calibration --data DATA [-o FILE] [--rows points] [--people 02_01 …] [--seeds 2]

Points, 2-D joints and images of the people of clips.test, who were used neither for the choice of parameters nor for
learning, with and without perturbed assumptions. FILE caches every run, see `cached_runs`.
"""

import argparse
from collections.abc import Mapping
from pathlib import Path

from analysis.figures.cached_runs import Numbers, Run, every_run, numbers_of, people, spread
from workbench.evaluation.step_calibration import GROUPS

START = ("prior.base.initial_position_std=0.03", "prior.base.initial_rotation_std=0.05")
"""Standard deviations of the given initial pose, m and rad, for a filter."""
FROM_THE_START = ("dataset.first_frame=0",)
"""Some walks are short, and points are at 14 Hz."""
TRACKED: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "points, one style": ("points_walk_steady", FROM_THE_START),
    "points, varying style": ("points_walk_variable", FROM_THE_START),
    "keypoints, least squares": ("walk_keypoints_synthetic", ()),
    "keypoints, particles": ("walk_keypoints_synthetic", ("prior=ar_offsets", "inference=particle_filter", *START)),
    "images, particles": ("walk_multi_cue", ()),
}
"""Experiments and overrides by observation and inference."""
PERTURBATION = {"": (), ", exact": ("dataset.perturb=false",)}
ROWS = {
    f"{tracked}{perturbation}": (experiment, (*overrides, *exact))
    for tracked, (experiment, overrides) in TRACKED.items()
    for perturbation, exact in PERTURBATION.items()
}
COVERAGES = ("coverage_90", *(f"coverage_90_{group}" for group in GROUPS))
SCORES = {"nees_per_dim": ".1f", "crps_mm": ".1f", "crps_deg": ".1f", "mpjpe_abs_mm": ".0f", "mpjpe_px": ".1f"}
"""Metrics besides coverage, with the format of their digits."""
MEASURED = (*COVERAGES, *SCORES, "coverage_50", "expected_calibration_error", "nll", "tracked")


def table(numbers_by_run: Mapping[Run, Numbers]) -> str:
    """Return a Markdown table: means over people of their means over seeds, ± the standard deviation between people,
    and that between seeds."""
    names = ["90 % interval", *GROUPS, *SCORES]
    lines = [f"| held-out data | {' | '.join(names)} |", "|" + " --- |" * (len(names) + 1)]
    for row in dict.fromkeys(run.row for run in numbers_by_run):
        runs = {run: numbers for run, numbers in numbers_by_run.items() if run.row == row}
        cells = [spread(runs, name, ".2f") for name in COVERAGES] + [spread(runs, *score) for score in SCORES.items()]
        lines.append(f"| {row} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> int:
    """Run what is missing and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder with recorded motion")
    parser.add_argument("-o", "--out", type=Path, default=Path("build/held_out_calibration.jsonl"), metavar="FILE")
    parser.add_argument("--rows", default="", help="only those whose name begins so")
    parser.add_argument("--people", nargs="+", help="clips; by default those of clips.test")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--frames", type=int, default=30)
    chosen = parser.parse_args()
    same = [f"paths.data={chosen.data}", f"dataset.n_frames={chosen.frames}"]
    rows = {row: tracked for row, tracked in ROWS.items() if row.startswith(chosen.rows)}
    runs = every_run(rows, chosen.people or people("test", chosen.data), chosen.seeds, same)
    print(table(numbers_of(runs, chosen.out, MEASURED)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
