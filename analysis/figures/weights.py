"""How much a likelihood should weigh: held-out scores on the people parameters are chosen by, a table for each number.

    python -m analysis.figures.weights --data DATA [-o FILE] [--only images] [--people 35_02 …] [--seeds 1]

What neighbouring pixels, limbs and frames are off by they share, so that a plain product of their probabilities is far
too sure. Of the people of clips.choose, nobody of whom is learned from, the proper scores of the poses tell how much
they count: the least log score is marked. FILE keeps every run, see `kept_runs`.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.figures.kept_runs import Numbers, Run, every_run, numbers_of, people, spread


@dataclass(frozen=True)
class Choice:
    """A number to choose. override: of the experiment, with {0} in its place. values: to try. others: overrides."""

    experiment: str
    override: str
    values: Sequence[float]
    others: tuple[str, ...] = ()


FILTERED = ("prior=jitter", "inference=particle_filter")
CHOICES: Mapping[str, Choice] = {
    "images, weight of each cue": Choice(
        "walk_best", "likelihood.weights={{appearance: {0}, edges: {0}, silhouette: {0}}}", (0.5, 0.25, 0.12, 0.06)
    ),
    "image motion, k": Choice("coverage", "likelihood.k={0}", (1.0, 0.3, 0.1, 0.03)),
    "keypoints, temper": Choice("walk_keypoints_synthetic", "likelihood.temper={0}", (1.0, 0.3, 0.1), FILTERED),
    "points, shared_m": Choice("points_walk_steady", "likelihood.shared_m={0}", (0.0, 0.006, 0.012, 0.024)),
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
    """Experiment and overrides for every value, by the value."""
    return {f"{x:g}": (choice.experiment, (*choice.others, choice.override.format(x))) for x in choice.values}


def table(title: str, found: Mapping[Run, Numbers]) -> str:
    """Markdown: means over people of their means over seeds, ± the deviation between people, and that between seeds;
    the value with the least mean log score in bold."""
    lines = [f"| {title} | {' | '.join(SCORES)} |", "|" + " --- |" * (len(SCORES) + 1)]
    of_row = {row: {run: numbers for run, numbers in found.items() if run.row == row} for row in _rows(found)}
    mean = {row: np.mean([numbers["nll"] for numbers in runs.values()]) for row, runs in of_row.items()}
    for row, runs in of_row.items():
        cells = [spread(runs, *score) for score in SCORES.items()]
        lines.append(f"| {f'**{row}**' if row == min(mean, key=mean.__getitem__) else row} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _rows(found: Mapping[Run, Numbers]) -> list[str]:
    return list(dict.fromkeys(run.row for run in found))


def main() -> int:
    """Run what is missing and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder with recorded motion")
    parser.add_argument("-o", "--out", type=Path, default=Path("build/weights.jsonl"), metavar="FILE")
    parser.add_argument("--only", default="", help="numbers whose name begins so")
    parser.add_argument("--people", nargs="+", help="clips; by default those of clips.choose")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--frames", type=int, default=25)
    chosen = parser.parse_args()
    same = [f"paths.data={chosen.data}", f"dataset.n_frames={chosen.frames}"]
    clips = chosen.people or people("choose", chosen.data)
    for title, choice in CHOICES.items():
        if title.startswith(chosen.only):
            runs = every_run(rows_of(choice), clips, chosen.seeds, same)
            print(table(title, numbers_of(runs, chosen.out, tuple(SCORES))) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
