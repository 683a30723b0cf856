"""Choose a constant that a paper does not give on people and scenes whose results are not reported.

    python -m analysis.literal_constants walk_straight likelihood.sigma 20 35 50 80 120 --data DATA

The experiment runs as published with the tracker's own body, camera and initial pose (`dataset.perturb=false`), once
for every value, clip and seed. The clips are `clips.validation`, or generated scenes, such as `--clips builtin --seeds
100 101`. With `--set paper=ours dataset.perturb=true` the constant is that of ours. FOLDER caches every run, see
`cached_runs`.
"""

import argparse
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from analysis.figures.cached_runs import Numbers, Run, numbers_of, people

MEASURED = (
    "mpjpe_abs_mm", "mpjpe_mm", "mpjpe_px", "hip_flexion_rmse_deg", "knee_flexion_rmse_deg", "tracked",
)  # fmt: skip
SAME = ("paper=literal", "dataset.perturb=false")


def curve(numbers_by_run: Mapping[Run, Numbers]) -> str:
    """Return a Markdown table: by row, the means of MEASURED over clips and seeds, and of the last their sum."""
    lines = [f"| | {' | '.join(MEASURED)} |", "| --- " * (len(MEASURED) + 1) + "|"]
    for row in dict.fromkeys(run.row for run in numbers_by_run):
        runs = [numbers for run, numbers in numbers_by_run.items() if run.row == row]
        means = [f"{np.mean([numbers[name] for numbers in runs]):.1f}" for name in MEASURED[:-1]]
        n_tracked = sum(numbers[MEASURED[-1]] for numbers in runs)
        lines.append(f"| {row} | {' | '.join(means)} | {n_tracked:.0f} of {len(runs)} |")
    return "\n".join(lines)


def main() -> int:
    """Run what is missing and print the curve."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("experiment")
    parser.add_argument("key")
    parser.add_argument("values", nargs="+")
    parser.add_argument("--data", required=True, type=Path, help="folder with recorded motion")
    parser.add_argument("--clips", nargs="+", help="motions (clips.validation)")
    parser.add_argument("--seeds", nargs="+", type=int, default=[100])
    parser.add_argument("--set", nargs="+", default=[], metavar="KEY=VALUE", help="further overrides")
    parser.add_argument("--runs", type=Path, default=Path("recordings/runs"), metavar="FOLDER", help="for the cache")
    chosen = parser.parse_args()
    same = (f"paths.data={chosen.data}", *SAME, *chosen.set)
    runs = [
        Run(setting, chosen.experiment, clip, seed, (*same, setting))
        for seed in chosen.seeds
        for clip in chosen.clips or people("validation", chosen.data)
        for setting in (f"{chosen.key}={value}" for value in chosen.values)
    ]
    print(curve(numbers_of(runs, chosen.runs, MEASURED)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
