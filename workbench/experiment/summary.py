"""Summary of a run: its scalar results, written as `summary.json` in its folder."""

import json
import logging
import os
import platform
from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from itertools import count
from pathlib import Path
from time import perf_counter
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench import __version__
from workbench.evaluation.errors.track_loss import track_metrics
from workbench.evaluation.metrics import row_of
from workbench.recording.format import FORMAT
from workbench.utils.atomic_write import replace_text
from workbench.utils.run_files import EARLIER, RECORDING, SUMMARY
from workbench.utils.signals import deferred

if TYPE_CHECKING:  # slow imports that a rejected configuration does not need
    from workbench.core.step import Step
    from workbench.evaluation.verdict.run_verdict import Verdict

log = logging.getLogger(__name__)

_RESERVED_BYTES = 32_768
"""Size of summary.json during a run, bytes: reserves space for the final one on a full disk."""
_OMITTED_IF_FULL = ("settings", "provenance", "versions")

_PACKAGES = ("numpy", "scipy", "numba", "opencv-python-headless", "h5py", "hydra-core", "rerun-sdk")


@cache
def versions() -> Mapping[str, str]:
    """Return the versions of Python and of the packages a result depends on."""
    packages = {name: version(name) for name in _PACKAGES}
    return MappingProxyType({"python": platform.python_version(), "workbench": __version__, **packages})


@dataclass
class Summary:
    """Results of a run, accumulated step by step.

    The frames with ground truth after the first, which is the initial condition, are aggregated. log_evidence covers
    all frames.

    assumptions: the side information used, see `requirements.assumptions`. input_counts: what the dataset counted in
    what it read, see `SequenceInfo`. settings: the resolved configuration. provenance: see there. run_metrics: metrics
    of the run as a whole, see `Meter.run_metrics`. stopped: why and in which frame it ended early; the status is then
    "stopped". omitted_metrics: metrics that would mean nothing, with the reason. verdict: known when all steps are in.
    uninformative_metrics: metrics that are the same in all runs of such parts. compile_s: time to compile kernels,
    which is in no other time.
    """

    experiment: str
    seed: int
    recording: Path
    started: str = field(default_factory=lambda: datetime.now(UTC).strftime("%Y%m%dT%H%M%S.%fZ"))
    began_s: float = field(default_factory=perf_counter)
    status: str = "running"
    error: str | None = None
    identity: str | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    assumptions: list[str] = field(default_factory=list)
    input_counts: Mapping[str, int] = field(default_factory=dict)
    timing: dict[str, float] = field(default_factory=dict)
    frames: int = 0
    steps_s: float = 0.0
    evaluations: float = 0.0
    log_evidence: float = float("nan")
    per_frame: dict[str, "array[float]"] = field(default_factory=dict)
    run_metrics: Mapping[str, float] = field(default_factory=dict)
    omitted_metrics: dict[str, str] = field(default_factory=dict)
    stopped: str | None = None
    verdict: "Verdict | None" = None
    uninformative_metrics: frozenset[str] = frozenset()
    compile_s: float = 0.0
    study: Mapping[str, float] | None = None

    def end(self, error: BaseException | None) -> None:
        """Set the final status; error: the exception that ended the run, or None."""
        if self.recording.is_file():
            self.status = "complete" if self.stopped is None else "stopped"
            return
        interrupted = error is None or isinstance(error, KeyboardInterrupt | SystemExit)  # SystemExit: submitit
        self.status = "interrupted" if interrupted else "failed"
        self.error = None if error is None else f"{type(error).__name__}: {error}"

    def add(self, step: "Step", errors: Mapping[str, float]) -> None:
        """Add one step and its errors."""
        for stage, seconds in step.timing_s.items():
            self.timing[stage] = self.timing.get(stage, 0.0) + seconds
            self.steps_s += seconds
        self.frames += 1
        self.evaluations += step.evaluations
        self.log_evidence = step.log_evidence
        if self.frames > 1:
            for name, value in {**errors, **step.diagnostics, "ess": step.ess}.items():
                self.per_frame.setdefault(name, array("d")).append(value)

    @property
    def metrics(self) -> dict[str, float]:
        """Metrics of the run: those of the frames, see `Metric.aggregates`, comparable log evidence, and `run_metrics`;
        or those of a study."""
        if self.study is not None:
            return dict(self.study)
        numbers: dict[str, float] = {}
        for name, values in self.per_frame.items():
            numbers |= row_of(name).of_run(values)
        numbers |= track_metrics(self.per_frame)
        if "log_evidence" not in self.omitted_metrics:
            numbers["log_evidence"] = self.log_evidence
        return {**numbers, **self.run_metrics, "n_frames": float(self.frames)}

    @property
    def cost(self) -> dict[str, float]:
        """Computing cost of the run, separate from the metrics, as wall times differ between equal runs.

        seconds: time of the inference or study, without one-time costs such as learning a prior or compiling kernels.
        ms_per_frame: the same per frame. compile_s: compilation time. likelihood_evaluations: number of evaluated
        poses; for least squares the residual evaluations of all frames, without initialization. jacobian_cost_ratio:
        cost of F with its Jacobian over the cost of F, if measured (paper D, section 4.1).
        """
        if self.study is not None:
            return {"seconds": self.timing["study"]}
        cost: dict[str, float] = {}
        if self.steps_s > 0.0:
            cost = {"seconds": self.steps_s, "ms_per_frame": 1e3 * self.steps_s / self.frames}
        if self.compile_s > 0.0:
            cost["compile_s"] = self.compile_s
        if self.evaluations > 0.0:
            cost["likelihood_evaluations"] = self.evaluations
        if self.timing.get("residual", 0.0) > 0.0:
            cost["jacobian_cost_ratio"] = self.timing["residual_jacobian"] / self.timing["residual"]
        return cost

    def write(self, path: Path) -> None:
        """Write summary.json, which a sweep may read at any time; numbers that are not finite become null."""
        path.parent.mkdir(parents=True, exist_ok=True)
        numbers = {**self.metrics, **self.cost}
        content = {
            "format": FORMAT,
            "status": self.status,
            **({} if self.verdict is None else {"verdict": self.verdict.as_dict}),
            "experiment": self.experiment,
            "seed": self.seed,
            "assumptions": self.assumptions,
            "input_counts": dict(self.input_counts),
            "metrics": {name: value if np.isfinite(value) else None for name, value in numbers.items()},
            "omitted_metrics": self.omitted_metrics,
            "timing": {name: round(value, 4) for name, value in self.timing.items()},
            "versions": dict(versions()),
            "identity": self.identity,
            "provenance": self.provenance,
            "settings": self.settings,
            "host": platform.node(),
            "started": self.started,
            "wall_s": round(perf_counter() - self.began_s, 3),
            "error": self.error,
            **({} if self.stopped is None else {"stopped": self.stopped}),
        }
        short = {name: value for name, value in content.items() if name not in _OMITTED_IF_FULL}
        text, shorter = (json.dumps(fields, indent=2) + "\n" for fields in (content, short))
        replace_text(path, text.ljust(_RESERVED_BYTES if self.status == "running" else 0), shorter)


def earlier_runs(folder: Path) -> list[Path]:
    """Return the folders of earlier complete runs in a folder, oldest first."""
    numbers = sorted((path.name for path in (folder / EARLIER).glob("*") if path.name.isdecimal()), key=int)
    return [run for name in numbers if ((run := folder / EARLIER / name) / RECORDING).is_file()]


def set_aside(folder: Path) -> None:
    """Move a complete run to EARLIER, the summary first: without its recording it would be wrong."""
    if not (folder / RECORDING).is_file():
        return
    aside = next(place for k in count(1) if not (place := folder / EARLIER / str(k)).exists())
    aside.mkdir(parents=True)
    with deferred():
        for name in (SUMMARY, RECORDING):
            if (folder / name).is_file():
                os.replace(folder / name, aside / name)
    log.warning("%s: the complete run in it was moved to %s", folder, aside)
