"""Calibration of likelihood weights by proper scores on validation people: a table for each parameter.

    python -m analysis.figures.weights --data DATA [-o FILE] [--only images] [--people 35_02 …] [--seeds 1]

Errors of neighbouring pixels, limbs and frames are correlated, so that a plain product of their probabilities is
overconfident. The proper scores of the poses of the people of clips.validation, who are not in the training data,
determine the weight: the lowest log score is marked. FILE caches every run, see `cached_runs`.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.figures.cached_runs import Numbers, Run, every_run, numbers_of, people, spread


@dataclass(frozen=True)
class Choice:
    """A parameter to choose. override: of the experiment, with {0} for the value. values: candidates. others:
    overrides."""

    experiment: str
    override: str
    values: Sequence[float]
    others: tuple[str, ...] = ()


FILTERED = ("prior=ar_offsets", "inference=particle_filter")
CHOICES: Mapping[str, Choice] = {
    "images, weight of each cue": Choice(
        "walk_multi_cue", "likelihood.weights={{appearance: {0}, edges: {0}, silhouette: {0}}}", (0.5, 0.25, 0.12, 0.06)
    ),
    "image motion, effective_pixels": Choice("coverage", "likelihood.effective_pixels={0}", (1.0, 0.3, 0.1, 0.03)),
    "keypoints, likelihood_power": Choice(
        "walk_keypoints_synthetic", "likelihood.likelihood_power={0}", (1.0, 0.3, 0.1), FILTERED
    ),
    "points, common_bias_std_m": Choice(
        "points_walk_steady", "likelihood.common_bias_std_m={0}", (0.0, 0.006, 0.012, 0.024)
    ),
}
SCORES = {
    "nll": ".2f",
    "crps_mm": ".1f",
    "crps_deg": ".2f",
    "coverage_90": ".2f",
    "nees_per_dim": ".1f",
    "mpjpe_abs_mm": ".0f",
}


def rows_of(choice: Choice) -> dict[str, tuple[str, tuple[str, ...]]]:
    """Return experiment and overrides for every value, by the value."""
    return {f"{x:g}": (choice.experiment, (*choice.others, choice.override.format(x))) for x in choice.values}


def table(title: str, numbers_by_run: Mapping[Run, Numbers]) -> str:
    """Return a Markdown table: means over people of their means over seeds, ± the standard deviation between people,
    and that between seeds; the value of lowest mean log score in bold."""
    lines = [f"| {title} | {' | '.join(SCORES)} |", "|" + " --- |" * (len(SCORES) + 1)]
    of_row = {
        row: {run: numbers for run, numbers in numbers_by_run.items() if run.row == row}
        for row in dict.fromkeys(run.row for run in numbers_by_run)
    }
    mean = {row: np.mean([numbers["nll"] for numbers in runs.values()]) for row, runs in of_row.items()}
    for row, runs in of_row.items():
        cells = [spread(runs, *score) for score in SCORES.items()]
        lines.append(f"| {f'**{row}**' if row == min(mean, key=mean.__getitem__) else row} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> int:
    """Run what is missing and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder with recorded motion")
    parser.add_argument("-o", "--out", type=Path, default=Path("build/weights.jsonl"), metavar="FILE")
    parser.add_argument("--only", default="", help="numbers whose name begins so")
    parser.add_argument("--people", nargs="+", help="clips; by default those of clips.validation")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--frames", type=int, default=25)
    chosen = parser.parse_args()
    same = [f"paths.data={chosen.data}", f"dataset.n_frames={chosen.frames}"]
    clips = chosen.people or people("validation", chosen.data)
    for title, choice in CHOICES.items():
        if title.startswith(chosen.only):
            runs = every_run(rows_of(choice), clips, chosen.seeds, same)
            print(table(title, numbers_of(runs, chosen.out, tuple(SCORES))) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
