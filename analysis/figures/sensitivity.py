"""Sensitivity of a tracker to each wrong assumption: a table over people and seeds.

    python -m analysis.figures.sensitivity --data DATA [-o FILE] [--people 35_02 …] [--seeds 3] [--particles 300]

Experiment walk_multi_cue with the tracker's own body, camera and initial pose (`dataset.perturb=false`), except for the
row's perturbation. FILE caches every run, so that an interrupted table can be resumed, see `cached_runs`.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

from analysis.figures.cached_runs import Numbers, Run, every_run, numbers_of, spread

EXACT = "dataset.perturb=false"
ROWS: Mapping[str, Sequence[str]] = {
    "nothing": (EXACT,),
    "all below, default": (),
    "bones 3 %, girths 10 %": (EXACT, "dataset.perturbations={lengths: 0.03, radii: 0.1}"),
    "profile of the limbs, neck, feet": (EXACT, "dataset.perturbations={profile: 1.0}"),
    "clothes 5 mm": (EXACT, "dataset.perturbations={clothes_m: 0.005}"),
    "camera 0.2 %, 0.1°": (EXACT, "dataset.perturbations={camera: 0.002, camera_deg: 0.1}"),
    "start 3 cm, 0.05 rad": (EXACT, "dataset.perturbations={start_m: 0.03, start_rad: 0.05}"),
    "camera 1 %, 1°": (EXACT, "dataset.perturbations={camera: 0.01, camera_deg: 1.0}"),
    "body scaled by 0.95": (EXACT, "body.scale=0.95"),
    "body scaled by 0.98": (EXACT, "body.scale=0.98"),
    "body scaled by 1.02": (EXACT, "body.scale=1.02"),
    "body scaled by 1.05": (EXACT, "body.scale=1.05"),
    "seen from 45° instead of 90°": (EXACT, "dataset.view_azimuth_deg=45"),
    "seen head-on": (EXACT, "dataset.view_azimuth_deg=180"),
}
PEOPLE = ("35_02", "38_02", "39_02")
"""Clips of three people who are not in the training data of walk_multi_cue's prior."""
MEASURED = ("mpjpe_abs_mm", "mpjpe_px", "tracked")


def table(numbers_by_run: Mapping[Run, Numbers]) -> str:
    """Return a Markdown table: means over people of their means over seeds, ± the standard deviation between people,
    and that between seeds."""
    lines = ["| perturbation | mpjpe_abs_mm | mpjpe_px | tracked |", "| --- | --- | --- | --- |"]
    for row in dict.fromkeys(run.row for run in numbers_by_run):
        runs = {run: numbers for run, numbers in numbers_by_run.items() if run.row == row}
        cells = [spread(runs, "mpjpe_abs_mm", ".0f"), spread(runs, "mpjpe_px", ".1f")]
        n_tracked = sum(numbers["tracked"] for numbers in runs.values())
        lines.append(f"| {row} | {' | '.join(cells)} | {n_tracked:.0f}/{len(runs)} |")
    return "\n".join(lines)


def main() -> int:
    """Run what is missing and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", required=True, help="folder with recorded motion")
    parser.add_argument("-o", "--out", type=Path, default=Path("build/sensitivity.jsonl"), metavar="FILE")
    parser.add_argument("--people", nargs="+", default=PEOPLE)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--particles", type=int, default=300)
    parser.add_argument("--frames", type=int, default=30)
    chosen = parser.parse_args()
    same = [f"paths.data={chosen.data}", f"inference.n_particles={chosen.particles}"]
    same += [f"dataset.n_frames={chosen.frames}"]
    rows = {row: ("walk_multi_cue", overrides) for row, overrides in ROWS.items()}
    runs = every_run(rows, chosen.people, chosen.seeds, same)
    print(table(numbers_of(runs, chosen.out, MEASURED)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
