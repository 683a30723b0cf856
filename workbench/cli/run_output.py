"""What the terminal says of a run: the verdict, the few numbers that matter, and where the rest is."""

import logging
import os
import shutil
import sys
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from workbench.utils.run_files import SUMMARY

if TYPE_CHECKING:
    from workbench.experiment.summary import Summary

NUMBERS: Mapping[str, tuple[str, str, float]] = {
    "error_abs_mm": ("MPJPE", "mm", 1.0),
    "error_procrustes_mm": ("PA-MPJPE", "mm", 1.0),
    "error_px": ("error in the image", "px", 1.0),
    "coverage_90": ("truth inside the 5–95 % bands, of 90 %", "%", 100.0),
    "coverage_90_joints": ("joints inside the 5–95 % bands, of 90 %", "%", 100.0),
    "knee_deg": ("error of the knees", "degrees", 1.0),
    "lost_share": ("frames lost", "%", 100.0),
    "ess_mean": ("effective sample size", "particles", 1.0),
    "inliers": ("observations near the body", "%", 100.0),
    "log_evidence": ("log evidence", "nats", 1.0),
}
"""What is printed, by its name in the file: what it is, its unit, and times what."""


def lines(summary: "Summary") -> Iterator[str]:
    """Yield what is told of a run, line by line; all numbers of a study."""
    if summary.verdict is not None:
        yield f"verdict: {summary.verdict.sentence}"
    metrics = summary.metrics
    if summary.study is not None:
        width = max(map(len, metrics), default=0)
        yield from (f"{name:<{width}} {value:10.4g}" for name, value in metrics.items())
    else:
        shown = {name: metrics[name] for name in NUMBERS if name in metrics and name not in summary.constant}
        names = {name: f"{NUMBERS[name][0]} ({name})" for name in shown}
        width = max(map(len, names.values()), default=0)
        for name, value in shown.items():
            _, unit, factor = NUMBERS[name]
            yield f"  {names[name]:<{width}} {factor * value:8.4g} {unit}"
        rest = len(metrics) - len(shown)
        yield f"  {rest} more numbers: {shown_path(summary.recording.with_name(SUMMARY))}"
    yield f"  {_times(summary.cost)}"
    yield f"look at it: {command('workbench-view')} {quoted(shown_path(summary.recording))}"


def tell_warnings() -> None:
    """Let Python's warnings be told as a sentence each, without the file and the line that raised them."""
    logging.captureWarnings(True)
    warnings.formatwarning = lambda message, category, filename, lineno, line=None: str(message)


def _times(cost: Mapping[str, float]) -> str:
    seconds = f"{cost.get('seconds', 0.0):.1f} s"
    per_frame = f", {cost['ms_per_frame']:.0f} ms a frame" if "ms_per_frame" in cost else ""
    compiled = (
        f"; compiling kernels, once on this machine, {cost['compiling_s']:.1f} s" if "compiling_s" in cost else ""
    )
    return f"took {seconds}{per_frame}{compiled}"


def command(name: str) -> str:
    """Return how to call one of our commands from this shell: by its name where that is found and is of this Python's
    environment, else by its path."""
    beside = Path(sys.executable).parent / name
    found = shutil.which(name)
    if found is not None and Path(found).resolve() == beside.resolve():
        return name
    return quoted(shown_path(beside)) if beside.is_file() else name


def shown_path(path: Path) -> str:
    """Return a path as it is shortest from here: relative below the working directory, else absolute."""
    relative = os.path.relpath(path)
    return os.path.abspath(path) if relative.startswith("..") else relative


def quoted(text: str) -> str:
    """Return a text as a shell takes it for one word."""
    return quote(text)
