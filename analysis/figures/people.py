"""People over whom an experiment is run, and its results over them."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from omegaconf import DictConfig, OmegaConf

from workbench.datasets.rendering.concatenation import BLEND_S
from workbench.datasets.rendering.sequence import motion_names
from workbench.motion.formats.names import GENERATED
from workbench.motion.sources import find_motion
from workbench.utils.errors import InputError

LISTS: Mapping[tuple[str, ...], str] = {("walk",): "test", ("run",): "test_run", ("walk", "run"): "test_walk_run"}
"""List below `clips` in the configuration, by the activities of an experiment."""
FULL = "test_full"
"""The list for a motion file's own skeleton with every joint."""
METRICS = {"mpjpe_abs_mm": "mm", "mpjpe_mm": "mm", "mpjpe_px": "px", "knee_flexion_rmse_deg": "°", "coverage_90": ""}
"""Metrics of the table with their units, if a run has them."""

Clips = tuple[str, ...]
Run = Mapping[str, float]


def report_clips(config: DictConfig) -> list[Clips]:
    """Return the clips to report of an experiment, one or more in turn for each person, by the activities it shows.

    Raises InputError for a generated person, a walk on a circle, and activities without a list.
    """
    dataset: Any = config.dataset or {}
    names = motion_names(dataset.get("motion") or [])
    if dataset.get("path") == "circle" or any(name.startswith(GENERATED) for name in names):
        raise InputError(f"people: {', '.join(names)} of the dataset is generated, expected a recorded motion")
    activities = tuple(_motion(config, name).activity for name in names)
    if activities not in LISTS:
        raise InputError(f"people: {', '.join(names)} shows {', '.join(activities)}, of which no clips are to report")
    listed = config.clips[FULL if dataset.get("skeleton") == "full" else LISTS[activities]]
    return [tuple(motion_names(each)) for each in OmegaConf.to_container(listed)]  # type: ignore[union-attr]


def clip_overrides(config: DictConfig, clips: Clips) -> list[str]:
    """Return the overrides that show a person's clips instead, for fewer frames, or from an earlier one on, where a
    clip is shorter than the experiment's. Consecutive clips overlap."""
    dataset, n = config.dataset, len(clips)
    overlap = math.ceil(0.5 * BLEND_S * dataset.rate_hz) if n > 1 else 0
    there = [len(_motion(config, clip)) - overlap for clip in clips]
    n_frames = min(int(dataset.n_frames), n * min(there))
    first_frame = min(int(dataset.first_frame), there[0] - math.ceil(n_frames / n))
    motion = ",".join(f"'{clip}'" for clip in clips)
    return [
        f"dataset.motion={motion if n == 1 else f'[{motion}]'}",
        f"dataset.n_frames={n_frames}",
        f"dataset.first_frame={first_frame}",
    ]


def _motion(config: DictConfig, name: str) -> Any:
    dataset = config.dataset
    return find_motion(name, data=config.paths.data, rate_hz=float(dataset.rate_hz), seed=int(dataset.seed))


@dataclass(frozen=True)
class OverPeople:
    """Metrics of one experiment's runs: of each person, seed by seed."""

    runs: Mapping[Clips, Sequence[Run]]

    @property
    def tracked_counts(self) -> tuple[int, int]:
        """Return the number of runs that tracked the person to the end, and of all."""
        every = [run["tracked"] for runs in self.runs.values() for run in runs]
        return round(sum(every)), len(every)

    def spread(self, metric: str) -> tuple[float, float]:
        """Return the mean over people of their means over seeds, and their standard deviation; NaN for one person."""
        means = [float(np.mean([run[metric] for run in runs])) for runs in self.runs.values()]
        return float(np.mean(means)), float(np.std(means, ddof=1)) if len(means) > 1 else float("nan")

    def described(self, metric: str) -> str:
        """Return that mean and deviation in words; empty for a metric that the runs do not have."""
        if any(metric not in run for runs in self.runs.values() for run in runs):
            return ""
        mean, deviation = self.spread(metric)
        digits = 2 if METRICS[metric] == "" else 0 if abs(mean) >= 20.0 else 1
        unit = METRICS[metric] if METRICS[metric] == "°" else f" {METRICS[metric]}".rstrip()
        return f"{mean:.{digits}f} ± {deviation:.{digits}f}{unit}"


def table(results: Mapping[tuple[str, str], OverPeople]) -> Iterator[str]:
    """Yield the lines of a Markdown table: experiment and paper, number of people, tracked runs, means and
    deviations."""
    yield f"| experiment | | people | tracked | {' | '.join(METRICS)} |"
    yield f"| --- | --- | --- | --- |{' --- |' * len(METRICS)}"
    for (experiment, paper), each in results.items():
        n_tracked, n = each.tracked_counts
        cells = " | ".join(each.described(metric) for metric in METRICS)
        yield f"| {experiment} | {paper} | {len(each.runs)} | {n_tracked} of {n} | {cells} |"
