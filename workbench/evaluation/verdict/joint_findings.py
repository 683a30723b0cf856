"""Findings on stretches in which detections or landmarks contradict the estimate of some joints."""

from collections.abc import Iterator

import numpy as np

from workbench.body.skeleton import JOINT_NAMES
from workbench.body.stature import SIDES
from workbench.evaluation.verdict.joint_states import (
    JointStates,
    annotation_distances,
    contradicted_facing,
    contradicted_knees,
    lasting,
    relative_distances,
    stretches,
)
from workbench.evaluation.verdict.landmark_agreement import facing_deg, knee_differences_deg
from workbench.evaluation.verdict.run_measurements import RunMeasurements
from workbench.utils.arrays import BoolArray
from workbench.utils.finding import DOUBTFUL, NOT_USABLE, Finding

_MAX_CONTRADICTED = 1.0 / 3.0
"""Fraction of a clip from which on an estimate that landmarks contradict is not usable: most of a motion that repeats,
such as a walk there and back, is not in the rest."""


def joint_findings(measured: RunMeasurements, joints: JointStates) -> Iterator[Finding]:
    """Yield stretches in which the landmarks contradict torso or knees, or joints are far from their detections, and
    joints that are lost by their annotations.

    None with true positions, by which the outcome is decided.
    """
    if measured.has_truth:
        return
    yield from _facing(measured)
    yield from _knees(measured)
    yield from _far_joints(measured, joints)


def _facing(measured: RunMeasurements) -> Iterator[Finding]:
    angles, contradicted = facing_deg(measured), contradicted_facing(measured)
    if contradicted.any():
        text = f"the torso faces {np.nanmedian(angles[contradicted]):.0f}° away from the detector's landmarks"
        level = _level(contradicted, np.isfinite(angles))
        yield Finding("direction of the torso", f"{text} {_where(measured, contradicted)}", level)


def _knees(measured: RunMeasurements) -> Iterator[Finding]:
    """Compare the knees with the landmarks'; the one that differs longer is reported."""
    angles, contradicted = knee_differences_deg(measured), contradicted_knees(measured)
    if not contradicted.any():
        return
    side = int(contradicted.sum(axis=0).argmax())
    difference = float(np.nanmedian(angles[contradicted[:, side], side]))
    less = "less" if difference > 0.0 else "more"
    text = f"the {SIDES[side]} knee is bent by {abs(difference):.0f}° {less} than by the detector's landmarks"
    level = _level(np.any(contradicted, axis=1), np.any(np.isfinite(angles), axis=1))
    yield Finding("bent knees", f"{text} {_where(measured, contradicted[:, side])}", level)


def _far_joints(measured: RunMeasurements, joints: JointStates) -> Iterator[Finding]:
    """Compare joints with their detections and annotations where the body is not lost with them; the joint that is far
    for the longest time is reported."""
    seen, annotated = joints.seen & ~joints.body_lost[:, None], np.isfinite(annotation_distances(measured))
    far: BoolArray = np.zeros(seen.shape, bool)
    for j in range(far.shape[1]):
        away = seen[:, j] & (joints.far | joints.lost)[:, j]
        far[:, j] = lasting(away, measured.times_s) | (joints.lost & seen & annotated)[:, j]
    if not far.any():
        return
    worst, others = int(far.sum(axis=0).argmax()), int(far.any(axis=0).sum()) - 1
    name, frames = JOINT_NAMES[worst].replace("_", " "), far[:, worst]
    source = "annotations" if annotated[frames, worst].all() else "detections"
    each = annotation_distances(measured) if source == "annotations" else relative_distances(measured)
    more = f", and {others} more joint{'s' if others > 1 else ''}" if others else ""
    text = f"the {name} is {np.nanmedian(each[frames, worst]):.0%} of the person's height from its {source}"
    yield Finding("joints far from detections", f"{text} {_where(measured, frames)}{more}")


def _level(contradicted: BoolArray, compared: BoolArray) -> str:
    share = contradicted.sum() / max(int(compared.sum()), 1)
    return NOT_USABLE if share > _MAX_CONTRADICTED else DOUBTFUL


def _where(measured: RunMeasurements, chosen: BoolArray) -> str:
    """Describe the longest stretch of chosen frames (F,), and the fraction of all that are chosen."""
    first, last = max(stretches(chosen, measured.times_s), key=lambda ends: ends[1] - ends[0])
    frames = f"frames {measured.frames[first]} to {measured.frames[last]}" if last > first else ""
    return f"in {frames or f'frame {measured.frames[first]}'} ({chosen.mean():.0%} of the frames)"
