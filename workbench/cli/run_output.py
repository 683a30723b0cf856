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

from workbench.evaluation.metrics import TERMINAL, row_of
from workbench.utils.run_files import SUMMARY

if TYPE_CHECKING:
    from workbench.experiment.summary import Summary


def summary_lines(summary: "Summary") -> Iterator[str]:
    """Yield the lines of the summary: the verdict, the main metrics (of a study, all) and the files."""
    if summary.verdict is not None:
        yield f"verdict: {summary.verdict.message}"
    metrics, omitted = summary.metrics, summary.uninformative_metrics
    if summary.study is not None:
        width = max(map(len, metrics), default=0)
        yield from (f"  {name:<{width}} {value:10.4g}" for name, value in metrics.items())
    else:
        printed = [name for name in TERMINAL if name in metrics and name not in omitted]
        width = max(map(len, printed), default=0)
        for name in printed:
            row = row_of(name)
            factor, unit = (100.0, "%") if row.unit == "fraction" else (1.0, row.unit)
            yield f"  {name:<{width}} {factor * metrics[name]:8.1f} {unit:<9} {row.title}"
        rest = len(metrics) - len(printed)
        yield f"  {rest} more metrics: {_shortest(summary.recording.with_name(SUMMARY))}"
    yield f"  {_times(summary.cost, summary.timing.get('detection', 0.0))}"
    yield "The page docs/recording.md explains the verdict, the metrics and the recording."
    yield f"view it: {_command()} view {quote(_shortest(summary.recording))}"


def print_warnings() -> None:
    """Print Python's warnings without the file and line that raised them."""
    logging.captureWarnings(True)
    warnings.formatwarning = lambda message, category, filename, lineno, line=None: str(message)


def _times(cost: Mapping[str, float], detection_s: float) -> str:
    seconds = cost.get("seconds", 0.0)
    text = f"took {seconds:.1f} s"
    if detection_s > 0.0:
        text = f"took {detection_s + seconds:.1f} s: detection {detection_s:.1f} s, fit {seconds:.1f} s"
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
