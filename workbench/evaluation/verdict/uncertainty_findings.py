"""Findings on a run's stated uncertainty, on its observations near the body, and on the convergence of its fit."""

from collections.abc import Iterator

import numpy as np

from workbench.evaluation.errors.track_loss import UNCERTAIN_MM
from workbench.evaluation.verdict.run_measurements import RunMeasurements
from workbench.evaluation.verdict.track_outcome import depth_drift, has_values
from workbench.utils.finding import DOUBTFUL, NOT_USABLE, Finding

_MIN_INLIERS, _HARDLY_ANY_INLIERS = 0.5, 0.25
"""Fractions of the observations that must lie near the body; with fewer, most show the person elsewhere."""
_MIN_COVERAGE, _HARDLY_ANY_COVERAGE = 0.6, 0.4
"""Coverage of 90 % intervals of a normal distribution whose stated standard deviation is a half and a third of the
error's: P(|z| < 1.645 / 2) = 0.59 and P(|z| < 1.645 / 3) = 0.42. That people, bodies and detectors define joints
differently explains less than the first."""
_MAX_DECREASE = 0.01
"""Relative decrease of a fit's cost in its last ten steps. At the minimum, an observation contributes about a half to
the cost, and a displacement by a tenth of the standard deviation 0.005, a hundredth of this."""


def uncertainty_findings(measured: RunMeasurements) -> Iterator[Finding]:
    """Yield the findings on uncertainty, inliers and convergence."""
    yield from _uncertainty(measured)
    inliers = measured.inlier_fraction[measured.observed_frames]
    if has_values(inliers) and (near := float(np.nanmean(inliers))) < _MIN_INLIERS:
        level = DOUBTFUL if near >= _HARDLY_ANY_INLIERS else NOT_USABLE
        text = f"only {near:.0%} of the observations lie near the body"
        yield Finding("observations far from the body", text, level)
    if measured.cost_decrease > _MAX_DECREASE:
        used = f"the cost still decreased by {measured.cost_decrease:.1%} in the last steps of the fit"
        yield Finding("not converged", f"{used}, increase inference.max_iterations")


def _uncertainty(measured: RunMeasurements) -> Iterator[Finding]:
    """Compare the stated uncertainty with the errors, and with UNCERTAIN_MM."""
    errors = {name: values[1:] for name, values in measured.errors.items()}
    coverages = [errors[name] for name in ("coverage_90", "coverage_90_joints") if name in errors]
    covered = min((float(np.nanmean(each)) for each in coverages if has_values(each)), default=1.0)
    if covered < _MIN_COVERAGE:
        text = f"the 90 % credible intervals cover {covered:.0%} of the true values"
        yield Finding("overconfident", text, DOUBTFUL if covered >= _HARDLY_ANY_COVERAGE else NOT_USABLE)
    drift, exceeds = depth_drift(measured)
    if exceeds.any():
        yield Finding("depth drift", drift)
    shown = measured.observed_frames
    uncertain = [groups for groups, valid in zip(measured.uncertain_groups, shown, strict=True) if groups and valid]
    if len(uncertain) > 0.5 * shown.sum():
        groups = ", ".join(sorted({group for each in uncertain for group in each}))
        text = f"the expected error of {groups} exceeds {UNCERTAIN_MM:g} mm in {len(uncertain)} frames"
        yield Finding("large expected error", text)
    depth_m = measured.depth_std_m[shown]
    known = all(camera.uncertainty is None for camera in measured.observed.cameras)  # otherwise the outcome states it
    if known and has_values(depth_m) and (std := float(np.nanmedian(depth_m))) > 1e-3 * UNCERTAIN_MM:
        yield Finding("uncertain depth", f"the person's depth is known to ± {std:.2f} m only")
