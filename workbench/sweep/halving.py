"""Successive halving (Jamieson & Talwalkar 2016): a sweep in rounds, each with more frames for fewer of it."""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from workbench.errors import InputError
from workbench.experiment.build import build
from workbench.limits import MOST_COUNT, MOST_DIGITS, MOST_ROUNDS, check_number, check_products, check_sizes
from workbench.sweep.job import read_summary
from workbench.sweep.plan import Plan, config_of, metric_of

KEPT = 3
"""One configuration in so many goes on to the next round."""
LEAST = 2
"""Frames of a round, which has no error else."""
KEY = "sweep.halving="
_SEED = "seed="


def frames_of(text: str) -> list[int]:
    """Read the frames of each round, `[10,50]`; raises InputError for anything but rising numbers of frames, for fewer
    than LEAST, for more rounds than MOST_ROUNDS and for more frames than a run has, before the first round begins."""
    words = re.fullmatch(rf"\[(\d{{1,{MOST_DIGITS}}}(?:,\d{{1,{MOST_DIGITS}}})*)\]", text.replace(" ", "").strip("'\""))
    frames = [int(word) for word in words[1].split(",")] if words else []
    if not frames or any(second <= first for first, second in zip([0, *frames], frames, strict=False)):
        raise InputError(f"sweep.halving: expected rising numbers of frames, such as [10,50], found {text}")
    check_number("sweep.halving", "rounds", len(frames), MOST_ROUNDS)
    check_number("sweep.halving", "frames", frames[-1], MOST_COUNT)
    if frames[0] < LEAST:
        raise InputError(f"sweep.halving: expected {LEAST} frames or more, of which the first is given, found {text}")
    return frames


def check_rounds(config: DictConfig, plan: Plan, frames: Sequence[int]) -> None:
    """Raise InputError, before the first round begins, where one has frames that no job of the sweep can have, and for
    a tuner, whose jobs are not known beforehand. config: of the sweep, as Hydra composes it."""
    if plan.varied is None:
        raise InputError("sweep.halving: expected a sweep whose jobs are known beforehand, not a tuner")
    for n_frames in frames:
        refused = ""
        for job, *_ in _configurations(plan).values():
            try:
                composed = config_of(config, plan, job, f"dataset.n_frames={n_frames}")
                own = OmegaConf.masked_copy(composed, [str(key) for key in composed if key not in ("hydra", "sweep")])
                settings: Any = OmegaConf.to_container(own, resolve=True)
                check_sizes(settings["dataset"], "dataset")
                check_products(settings)
                _ = build(own.dataset).known
                break
            except (InputError, HydraException, OmegaConfBaseException) as error:
                refused = refused or " ".join(str(error).split())
        else:
            raise InputError(f"sweep.halving: no job can have {n_frames} frames: {refused}")


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

    A configuration of which a job has no metric does not go on.
    """
    configurations = _configurations(plan)
    whole = [jobs for jobs in configurations.values() if all(job in metrics for job in jobs)]
    whole.sort(key=lambda jobs: sum(metrics[job] for job in jobs) / len(jobs))
    return [job for jobs in whole[: math.ceil(len(configurations) / KEPT)] for job in jobs]


def _configurations(plan: Plan) -> dict[tuple[str, ...], list[int]]:
    """Jobs by what those have in common that differ in `seed` alone."""
    found: dict[tuple[str, ...], list[int]] = {}
    for job in plan.jobs:
        overrides = () if plan.varied is None else plan.varied[job]
        found.setdefault(tuple(each for each in overrides if not each.startswith(_SEED)), []).append(job)
    return found


def round_of(arguments: Sequence[str], folder: str, k: int, n_frames: int, jobs: Sequence[int] | None) -> list[str]:
    """Return the arguments of round k of a sweep; jobs: that it has, None for all."""
    replaced = (KEY, "hydra.sweep.dir=", "dataset.n_frames=")
    own = [text for text in arguments if not text.startswith(replaced)]
    chosen = [] if jobs is None else [f"sweep.jobs=[{','.join(map(str, jobs))}]"]
    quoted = f"{folder}/round_{k}".replace("'", r"\'")
    return [*own, f"dataset.n_frames={n_frames}", f"hydra.sweep.dir='{quoted}'", *chosen]
