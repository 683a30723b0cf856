"""Metrics that tables, plots and sweeps show first, with their titles."""

ERRORS = {"mpjpe_abs_mm": "mm", "mpjpe_px": "px"}
"""The errors that runs are ranked by, with their units: the first one that a run has."""

COVERAGE = "coverage_90"

SHORT_TITLES = {**{name: f"error, {unit}" for name, unit in ERRORS.items()}, COVERAGE: "coverage"}
"""Titles of columns for the errors and the coverage."""

TITLES = {
    "mpjpe_abs_mm": "absolute MPJPE (mm)",
    "mpjpe_mm": "MPJPE, root-aligned (mm)",
    "mpjpe_px": "2-D MPJPE (px)",
    "tracked": "tracked throughout (fraction of runs)",
    COVERAGE: "coverage of the 90 % credible interval (fraction)",
    "activity_accuracy": "activity accuracy (fraction)",
    "seconds": "inference time (s)",
    "likelihood_evaluations": "likelihood evaluations",
}
"""The metrics that a report shows first, in this order, with their titles and units."""
