"""Summary of a run in the terminal: verdict, main metrics, and location of the files."""

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
    "mpjpe_abs_mm": ("absolute MPJPE", "mm", 1.0),
    "pa_mpjpe_mm": ("PA-MPJPE", "mm", 1.0),
    "mpjpe_px": ("2-D MPJPE", "px", 1.0),
    "coverage_90": ("coverage of the 90 % credible intervals", "%", 100.0),
    "coverage_90_joints": ("coverage of the 90 % credible intervals, joints", "%", 100.0),
    "knee_flexion_rmse_deg": ("RMSE of the knee flexion", "degrees", 1.0),
    "lost_fraction": ("lost frames", "%", 100.0),
    "ess_mean": ("effective sample size", "particles", 1.0),
    "inlier_fraction": ("inliers, observations near the body", "%", 100.0),
    "log_evidence": ("log evidence", "nats", 1.0),
}
"""Printed metrics by name: description, unit, and factor to that unit."""


def summary_lines(summary: "Summary") -> Iterator[str]:
    """Yield the lines of the summary; for a study, all its metrics."""
    if summary.verdict is not None:
        yield f"verdict: {summary.verdict.message}"
    metrics = summary.metrics
    if summary.study is not None:
        width = max(map(len, metrics), default=0)
        yield from (f"{name:<{width}} {value:10.4g}" for name, value in metrics.items())
    else:
        printed = {
            name: metrics[name] for name in NUMBERS if name in metrics and name not in summary.uninformative_metrics
        }
        names = {name: f"{NUMBERS[name][0]} ({name})" for name in printed}
        width = max(map(len, names.values()), default=0)
        for name, value in printed.items():
            _, unit, factor = NUMBERS[name]
            yield f"  {names[name]:<{width}} {factor * value:8.4g} {unit}"
        rest = len(metrics) - len(printed)
        yield f"  {rest} more metrics: {_shortest(summary.recording.with_name(SUMMARY))}"
    yield f"  {_times(summary.cost)}"
    yield f"look at it: {_command()} view {quote(_shortest(summary.recording))}"


def print_warnings() -> None:
    """Print Python's warnings without the file and line that raised them."""
    logging.captureWarnings(True)
    warnings.formatwarning = lambda message, category, filename, lineno, line=None: str(message)


def _times(cost: Mapping[str, float]) -> str:
    text = f"took {cost.get('seconds', 0.0):.1f} s"
    if "ms_per_frame" in cost:
        text += f", {cost['ms_per_frame']:.0f} ms per frame"
    if "compile_s" in cost:
        text += f"; compiling kernels, once on this machine, {cost['compile_s']:.1f} s"
    return text


def _command() -> str:
    """Return the command `workbench`, with its path if the shell would find another one."""
    installed, on_path = Path(sys.executable).with_name("workbench"), shutil.which("workbench")
    if not installed.is_file() or (on_path is not None and Path(on_path).resolve() == installed.resolve()):
        return "workbench"
    return quote(_shortest(installed))


def _shortest(path: Path) -> str:
    """Return a path relative to the working directory if it is below it, else absolute."""
    relative = os.path.relpath(path)
    return os.path.abspath(path) if relative.startswith("..") else relative
