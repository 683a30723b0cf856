"""An experiment's results in its two readings, as its paper writes it and as ours, and their description."""

from collections.abc import Mapping
from dataclasses import dataclass

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

_WRONG = (
    "the assumed bone lengths are up to 3 %, girths 10 %, the camera 0.2 % and 0.1° and a given initial pose 3 cm and "
    "0.05 rad wrong, redrawn for every seed"
)
DEVIATIONS = {
    "A": f"Not A's in either row: a rendered person; {_WRONG}; all particles share the points drawn; ρ, which "
    "eq. 15 leaves out, is the training cycles' mean; σ, ε, p_occluded and the noise, of which A gives no numbers.",
    "B": f"Not B's in either row: a rendered person; {_WRONG}; all particles share the points drawn; σ, "
    "p_occluded and the noise, of which B gives no numbers, that of the root as large as a walker's way in a frame, "
    "since nothing else moves it.",
    "C": f"Not C's in either row: a rendered person; {_WRONG}; the database, CMU's and Bandai's without whom is "
    "tracked; place and heading enter it as increments in the body's own frame; σ, ε and the noise, of which C gives "
    "no numbers. Its β = 1 is that of fig. 4, C names none for tracking.",
    "D": f"Not D's in either row: simulated points of a person; {_WRONG}; how wide the fields are, of which D "
    "gives no number, and that a point belongs to the part of the smallest |log f/C|, not |f − C|; the global motion "
    "by distances, each frame's from where the two before lead. The database lacks the performer's whole data set.",
}
"""Differences of the literal rows from a paper, or its unspecified parts."""


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
