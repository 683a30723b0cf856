"""The metrics that tables, cards, plots and sweeps show first."""

ERRORS = {"error_abs_mm": "mm", "error_px": "px"}
"""The errors that runs are ranked by, with their units: the first that a run has; less is better."""

COVERAGE = "coverage_90"

SHORT_TITLES = {**{name: f"error, {unit}" for name, unit in ERRORS.items()}, COVERAGE: "coverage"}
"""Titles of columns for the errors and the coverage."""

TITLES = {
    "error_abs_mm": "mean joint error (mm)",
    "error_rel_mm": "mean joint error, pelvis on pelvis (mm)",
    "error_px": "mean error in the image (px)",
    "held": "held throughout (fraction of runs)",
    COVERAGE: "coverage of the 90 % band (fraction)",
    "activity_accuracy": "activity told right (fraction)",
    "seconds": "time taken (s)",
    "likelihood_evaluations": "likelihood evaluations",
}
"""The metrics that a report shows first, in this order, with their titles and units."""
