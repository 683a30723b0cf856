"""Successive halving (Jamieson & Talwalkar 2016): a sweep in rounds, each with more frames for fewer of it."""

import math
import re
from collections.abc import Mapping, Sequence

from workbench.errors import InputError
from workbench.limits import MOST_COUNT, MOST_DIGITS, MOST_ROUNDS, check_number
from workbench.sweep.job import read_summary
from workbench.sweep.plan import Plan, metric_of

KEPT = 3
"""One configuration in so many goes on to the next round."""
KEY = "sweep.halving="
_SEED = "seed="


def frames_of(text: str) -> list[int]:
    """Read the frames of each round, `[10,50]`; raises InputError for anything but rising numbers of frames, for more
    rounds than MOST_ROUNDS and for more frames than a run has, before the first round begins."""
    words = re.fullmatch(rf"\[(\d{{1,{MOST_DIGITS}}}(?:,\d{{1,{MOST_DIGITS}}})*)\]", text.replace(" ", "").strip("'\""))
    frames = [int(word) for word in words[1].split(",")] if words else []
    if not frames or any(second <= first for first, second in zip([0, *frames], frames, strict=False)):
        raise InputError(f"sweep.halving: expected rising numbers of frames, such as [10,50], found {text}")
    check_number("sweep.halving", "rounds", len(frames), MOST_ROUNDS)
    check_number("sweep.halving", "frames", frames[-1], MOST_COUNT)
    return frames


def metrics_of(plan: Plan) -> dict[int, float]:
    """Read the metric of every job of a round that is complete and has one."""
    found: dict[int, float] = {}
    for job in plan.jobs:
        summary = read_summary(plan.folder / str(job)) or {}
        metric = metric_of(summary["metrics"], plan.metric) if summary.get("status") == "complete" else None
        if metric is not None:
            found[job] = metric
    return found


def best_third(plan: Plan, metrics: Mapping[int, float]) -> list[int]:
    """Return the jobs that go on, those with the least mean metric over their seeds first.

    A configuration is what jobs have in common that differ in `seed` alone; one of which a job has no metric does not
    go on.
    """
    configurations: dict[tuple[str, ...], list[int]] = {}
    for job in plan.jobs:
        overrides = () if plan.varied is None else plan.varied[job]
        configurations.setdefault(tuple(each for each in overrides if not each.startswith(_SEED)), []).append(job)
    whole = [jobs for jobs in configurations.values() if all(job in metrics for job in jobs)]
    whole.sort(key=lambda jobs: sum(metrics[job] for job in jobs) / len(jobs))
    return [job for jobs in whole[: math.ceil(len(configurations) / KEPT)] for job in jobs]


def round_of(arguments: Sequence[str], folder: str, k: int, n_frames: int, jobs: Sequence[int] | None) -> list[str]:
    """Return the arguments of round k of a sweep; jobs: that it has, None for all."""
    replaced = (KEY, "hydra.sweep.dir=", "dataset.n_frames=")
    own = [text for text in arguments if not text.startswith(replaced)]
    chosen = [] if jobs is None else [f"sweep.jobs=[{','.join(map(str, jobs))}]"]
    quoted = f"{folder}/round_{k}".replace("'", r"\'")
    return [*own, f"dataset.n_frames={n_frames}", f"hydra.sweep.dir='{quoted}'", *chosen]
