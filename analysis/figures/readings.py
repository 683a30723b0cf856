"""What an experiment came to in its two readings, as its paper writes it and as ours, and how that is told."""

from collections.abc import Mapping
from dataclasses import dataclass

from analysis.figures.replicates import Replicates
from workbench.recording.read.reader import Run

BOTH, OURS = ("literal", "ours"), ("ours",)
"""Which readings a figure shows; studies and what is beyond the papers have ours alone."""

ROW = {"literal": "As the paper writes it", "ours": "Ours"}

ERRORS = {
    "images": {"mpjpe_px": "px", "mpjpe_abs_mm": "mm"},
    "points": {"mpjpe_abs_mm": "mm", "hip_flexion_rmse_deg": "° hips", "knee_flexion_rmse_deg": "° knees"},
}
"""Told of a reading by what is seen, and their units."""

_TOLD = (
    "bones are told up to 3 %, girths 10 %, the camera 0.2 % and 0.1° and a start that is given 3 cm and 0.05 rad "
    "wrong, anew for every seed"
)
DEVIATIONS = {
    "A": f"Not A's in either row: a rendered person, of whom {_TOLD}; all particles share the points drawn; ρ, which "
    "eq. 15 leaves out, is the training cycles' mean; σ, ε, p_occluded and the noise, of which A gives no numbers.",
    "B": f"Not B's in either row: a rendered person, of whom {_TOLD}; all particles share the points drawn; σ, "
    "p_occluded and the noise, of which B gives no numbers, that of the root as large as a walker's way in a frame, "
    "since nothing else moves it.",
    "C": f"Not C's in either row: a rendered person, of whom {_TOLD}; the database, CMU's and Bandai's without whom is "
    "tracked; place and heading enter it as increments in the body's own frame; σ, ε and the noise, of which C gives "
    "no numbers. Its β = 1 is that of fig. 4, C names none for tracking.",
    "D": f"Not D's in either row: simulated points of a person, of whom {_TOLD}; how wide the fields are, of which D "
    "gives no number, and that a point belongs to the part of the smallest |log f/C|, not |f − C|; the global motion "
    "by distances, each frame's from where the two before lead. The database lacks the performer's whole data set.",
}
"""What is left in the literal rows that a paper does not write, or writes otherwise."""


@dataclass(frozen=True, eq=False)
class Reading:
    """Recordings of one seed and numbers of several, by reading; no numbers where only ours is shown."""

    runs: Mapping[str, Run]
    numbers: Mapping[str, Replicates]

    @property
    def ours(self) -> Run:
        """The recording of our reading."""
        return self.runs["ours"]

    def row(self, reading: str, label: str = "") -> str:
        """Name a row: the reading, how many seeds of it hold, and their mean errors with 95 % intervals."""
        name = f"{label}, {ROW[reading].lower()}" if label else ROW[reading]
        return f"{name}: {told}" if (told := self.told(reading)) else name

    def told(self, reading: str) -> str:
        """Say how many seeds of a reading hold the person, and their mean errors with 95 % intervals."""
        if reading not in self.numbers:
            return ""
        numbers = self.numbers[reading]
        of = "images" if "mpjpe_px" in numbers.runs[0] else "points"
        known = [(metric, unit) for metric, unit in ERRORS[of].items() if metric in numbers.runs[0]]
        if not known:  # nobody is tracked
            return ""
        held, n = numbers.held
        return f"{held} of {n} seeds hold; {', '.join(numbers.told(metric, unit) for metric, unit in known)}"
