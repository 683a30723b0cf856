"""Findings on a run's inputs: its cameras, keypoints and points."""

from collections.abc import Iterator

import numpy as np

from workbench.cameras.calibration_findings import check_calibration, lens_findings, unit_of
from workbench.cameras.observed_joints import MIN_WEIGHT, some_frames
from workbench.cameras.triangulation import triangulate
from workbench.evaluation.verdict.knee_bends import bends
from workbench.evaluation.verdict.run_measurements import RunMeasurements
from workbench.evaluation.verdict.time_findings import missing_frames
from workbench.utils.crossings import WINDOW_FRAMES
from workbench.utils.finding import DOUBTFUL, NOT_USABLE, Finding, level_of

_MIN_OBSERVED_JOINTS = 0.5
"""Fraction of the 14 joints without the pelvis that must be observed in some frame."""
_MIN_CONFIDENT = 0.5
"""Fraction of the detected joints that must have MIN_WEIGHT: the checks ignore the others, and would see few."""
_MIN_BENT_LEGS = 10
_EXTENT_RATIO = 1.5
"""Extent of a person's points along another axis over that along z, from which on the person lies: arms and stride are
at most as long as the upright body."""
_EXTENTS_M = (0.4, 2.5)
"""Extent of the middle 90 % of a person's points: a trunk, and a tall adult with a raised arm."""


def input_findings(measured: RunMeasurements, height_m: float | None) -> Iterator[Finding]:
    """Yield the findings on cameras, keypoints and points; height_m: the person's, if known."""
    if measured.has_keypoints:
        findings = check_calibration(measured.observed, height_m).findings
        yield from findings
        if level_of(findings) != NOT_USABLE:
            yield from _keypoints(measured)
        yield from missing_frames(measured)
    else:
        yield from (finding for camera in measured.observed.cameras for finding in lens_findings(camera))
    yield from _points(measured)


def _keypoints(measured: RunMeasurements) -> Iterator[Finding]:
    """Yield joints and cameras without keypoints, and exchanged sides."""
    observed = measured.observed
    joints_seen = np.asarray(np.isfinite(observed.pixels()[..., 0]).any(axis=(0, 1)))[1:]
    if joints_seen.sum() < _MIN_OBSERVED_JOINTS * len(joints_seen):
        seen = f"only {joints_seen.sum()} of {len(joints_seen)} joints are observed in any frame"
        yield Finding("too few observations", f"{seen}, the others follow the prior")
    detected, confident = (np.isfinite(observed.pixels(weight)[..., 0]).sum() for weight in (0.0, MIN_WEIGHT))
    if confident < _MIN_CONFIDENT * detected:
        share = f"only {confident / detected:.0%} of the detected joints have a confidence of {MIN_WEIGHT:g} or more"
        yield Finding("too few observations", f"{share}, and others are not compared with the estimate")
    in_image, has_person = measured.in_image.sum(axis=0), (measured.in_image & observed.shows_person).sum(axis=0)
    for v, name in enumerate(measured.cameras):
        if len(measured.cameras) > 1 and in_image[v] >= WINDOW_FRAMES and has_person[v] < 0.5 * in_image[v]:
            text = f"{name} has keypoints in {has_person[v]} of the {in_image[v]} frames that show the person"
            yield Finding("inconsistent cameras", text)
    if len(measured.cameras) > 1:
        pixels = observed.pixels(MIN_WEIGHT)[:, some_frames(len(measured.frames))]
        bent = bends(triangulate(observed.cameras, pixels))
        if len(bent) >= _MIN_BENT_LEGS and (backwards := float((bent < 0.0).mean())) > 0.5:
            text = f"knees bend backwards in {backwards:.0%} of {len(bent)} bent legs: left and right are exchanged"
            yield Finding("left–right swap", text, NOT_USABLE)


def _points(measured: RunMeasurements) -> Iterator[Finding]:
    """Compare the extents of the points with those of an upright person."""
    if not measured.has_points:
        return
    extent = np.nanmedian(measured.point_extent_m, axis=0)
    longest = int(np.argmax(extent))
    low, high = _EXTENTS_M
    if not low < extent[longest] < high:
        unit = unit_of(extent[longest] / 1.7)
        hint = f": the points are in {unit}, expected metres" if unit else f", expected {low:g} to {high:g} m"
        text = f"the points extend over {extent[longest]:.2f} m{hint}"
        yield Finding("unit of length" if unit else "height mismatch", text, NOT_USABLE if unit else DOUBTFUL)
    elif extent[longest] > _EXTENT_RATIO * extent[2]:
        axis = "xyz"[longest]
        text = f"the points extend over {extent[longest]:.2f} m along {axis} and {extent[2]:.2f} m along z"
        yield Finding("vertical", f"{text}: the axis that points up is {axis}, expected z, or the person lies")
