"""An experiment's results in its two readings, as its paper writes it and as ours, and their description."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from matplotlib.figure import Figure

from analysis.figures.replicates import Replicates
from workbench.recording.read.reader import Run

BOTH, OURS = ("literal", "ours"), ("ours",)
"""Readings that a figure shows; studies and extensions have ours alone."""

ROW = {"literal": "As the paper writes it", "ours": "Ours"}

ERRORS = {
    "images": {"mpjpe_px": "px", "mpjpe_abs_mm": "mm"},
    "points": {"mpjpe_abs_mm": "mm", "hip_flexion_rmse_deg": "° hips", "knee_flexion_rmse_deg": "° knees"},
}
"""Metrics of a reading by observation, and their units."""

DIFFERENCES = "The page Deviations from the papers lists the remaining differences from the paper."
"""Last sentence of the caption of a figure of both readings."""


@dataclass(frozen=True, eq=False)
class Reading:
    """Recordings of one seed and results of several, by reading; no results if only ours is shown."""

    runs: Mapping[str, Run]
    numbers: Mapping[str, Replicates]

    @property
    def ours(self) -> Run:
        """Return the recording of our reading."""
        return self.runs["ours"]

    def row(self, reading: str, label: str = "") -> str:
        """Return a row's title: the reading, its number of tracked seeds, and the mean errors with 95 % intervals."""
        name = f"{label}, {ROW[reading].lower()}" if label else ROW[reading]
        return f"{name}: {description}" if (description := self.described(reading)) else name

    def described(self, reading: str) -> str:
        """Return a reading's number of tracked seeds, and the mean errors with 95 % intervals, in words."""
        if reading not in self.numbers:
            return ""
        numbers = self.numbers[reading]
        of = "images" if "mpjpe_px" in numbers.runs[0] else "points"
        available = [(metric, unit) for metric, unit in ERRORS[of].items() if metric in numbers.runs[0]]
        if not available:  # no person is tracked
            return ""
        n_tracked, n = numbers.tracked_counts
        errors = ", ".join(numbers.described(metric, unit) for metric, unit in available)
        return f"{n_tracked} of {n} seeds tracked; {errors}"


class PaperFigure(NamedTuple):
    """A published figure: the experiments and readings that it shows, and the drawing of their recordings."""

    experiments: tuple[str, ...]
    readings: tuple[str, ...]
    draw: Callable[[Mapping[str, Reading]], Figure]
