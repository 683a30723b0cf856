"""What a tracker loses by each thing it is told wrong, one at a time: a table over people and seeds.

    python -m analysis.figures.sensitivity --data DATA [-o FILE] [--people 35_02 …] [--seeds 3] [--particles 300]

Experiment walk_best with the tracker's own body, camera and start (`dataset.exact=true`), but for what the row says.
FILE keeps a line of JSON for every run; what it holds is not run again, so that a table that was cut off goes on.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path

import numpy as np
from hydra import compose, initialize_config_module

from workbench.experiment.assembly import assemble
from workbench.experiment.schema import prepare_hydra
from workbench.experiment.summary import Summary
from workbench.experiment.tracking import track

EXACT = "dataset.exact=true"
ROWS: Mapping[str, Sequence[str]] = {
    "nothing": (EXACT,),
    "all below, as usual": (),
    "bones 3 %, girths 10 %": (EXACT, "dataset.departures={lengths: 0.03, radii: 0.1}"),
    "profile of the limbs, neck, feet": (EXACT, "dataset.departures={profile: 1.0}"),
    "clothes 5 mm": (EXACT, "dataset.departures={clothes_m: 0.005}"),
    "camera 0.2 %, 0.1°": (EXACT, "dataset.departures={camera: 0.002, camera_deg: 0.1}"),
    "start 3 cm, 0.05 rad": (EXACT, "dataset.departures={start_m: 0.03, start_rad: 0.05}"),
    "camera 1 %, 1°": (EXACT, "dataset.departures={camera: 0.01, camera_deg: 1.0}"),
    "body told 0.95 of it": (EXACT, "body.scale=0.95"),
    "body told 0.98 of it": (EXACT, "body.scale=0.98"),
    "body told 1.02 of it": (EXACT, "body.scale=1.02"),
    "body told 1.05 of it": (EXACT, "body.scale=1.05"),
    "seen from 45° instead of 90°": (EXACT, "dataset.view_deg=45"),
    "seen head-on": (EXACT, "dataset.view_deg=180"),
}
PEOPLE = ("35_02", "38_02", "39_02")
"""Clips of three people whom the prior of walk_best is not learned from."""
MEASURED = ("error_abs_mm", "error_px", "held")

Key = tuple[str, str, int]


def measured(overrides: Sequence[str], seed: int) -> dict[str, float]:
    """Track as walk_best does, with overrides, and measure; nothing is recorded."""
    with initialize_config_module("workbench.conf", version_base="1.3"):
        config = compose("config", overrides=["experiment=walk_best", f"seed={seed}", *overrides])
    parts = assemble(config, lambda stage: nullcontext())
    summary = Summary(experiment="walk_best", seed=seed, recording=Path())
    for step, errors in track(parts, seed):
        summary.add(step, errors)
    return {name: summary.metrics[name] for name in MEASURED}


def table(found: Mapping[Key, Mapping[str, float]]) -> str:
    """Markdown: means over people of their means over seeds, ± the deviation between people and that between seeds."""
    lines = ["| told wrong | error_abs_mm | error_px | held |", "| --- | --- | --- | --- |"]
    for row in ROWS:
        runs = {key: run for key, run in found.items() if key[0] == row}
        people = {clip: [run for key, run in runs.items() if key[1] == clip] for _, clip, _ in runs}
        if people:
            cells = [_spread(people, "error_abs_mm", ".0f"), _spread(people, "error_px", ".1f")]
            lines.append(
                f"| {row} | {' | '.join(cells)} | {sum(run['held'] for run in runs.values()):.0f}/{len(runs)} |"
            )
    return "\n".join(lines)


def _spread(people: Mapping[str, Sequence[Mapping[str, float]]], name: str, form: str) -> str:
    means = [float(np.mean([run[name] for run in runs])) for runs in people.values()]
    within = [float(np.std([run[name] for run in runs], ddof=1)) for runs in people.values() if len(runs) > 1]
    between = f" ± {np.std(means, ddof=1):{form}}" if len(means) > 1 else ""
    return f"{np.mean(means):{form}}{between}" + (f", {np.mean(within):{form}}" if within else "")


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
    chosen.out.parent.mkdir(parents=True, exist_ok=True)
    lines = chosen.out.read_text().splitlines() if chosen.out.exists() else []
    kept = [json.loads(line) for line in lines]
    found: dict[Key, dict[str, float]] = {
        (run["row"], run["clip"], run["seed"]): run for run in kept if run["overrides"][: len(same)] == same
    }
    prepare_hydra()
    wanted = [(row, clip, seed) for seed in range(chosen.seeds) for clip in chosen.people for row in ROWS]
    for row, clip, seed in wanted:
        if (row, clip, seed) not in found:
            overrides = [*same, f"dataset.motion='{clip}'", *ROWS[row]]
            run = measured(overrides, seed)
            found[row, clip, seed] = run
            with chosen.out.open("a") as out:
                said = {"row": row, "clip": clip, "seed": seed, "overrides": overrides, **run}
                out.write(json.dumps(said) + "\n")
    print(table({key: found[key] for key in wanted}))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
