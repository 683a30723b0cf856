"""Measures of a recorded motion as tables, curves and sentences."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from workbench.body.stature import SIDES, limb_lengths, usual_height
from workbench.evaluation.gait.angle_cycles import N_POINTS, AngleCycles
from workbench.evaluation.gait.estimates import bands_of
from workbench.evaluation.gait.joint_angles import GAIT_ANGLES, JointAngles, joint_angles
from workbench.evaluation.gait.repetitions import angle_measures
from workbench.evaluation.gait.stretches import rows_of_stretches
from workbench.evaluation.gait.walk import Walk, walk_of
from workbench.recording.read.reader import Run
from workbench.results.measure.notes import notes_of
from workbench.results.measure.recorded_motion import RecordedMotion, recorded_motion
from workbench.utils.arrays import BoolArray, FloatArray

MAX_GAP_S = 0.5
"""Longest interval over which a joint angle is interpolated, as in exports."""
_MIN_SEEN = 0.5
"""Part of the frames in which a part of the body is seen from which on its angles are measured."""
_LIMBS = {"torso": "torso", "hip": "leg", "knee": "leg", "ankle": "leg", "shoulder": "arm", "elbow": "arm"}
"""Part of the body that determines the angles of a joint."""
_COLUMNS = ("measure", "side", "unit", "estimate", "low_90", "high_90", "n")


@dataclass(frozen=True, eq=False)
class Curve:
    """An angle over the gait cycle or over time, degrees.

    name: a key of CONVENTIONS. side: left, right or both. x: (n,), percent of the cycle or seconds. strides: (k, n), of
    single strides, k = 0 over time. mean, low, high: (n,), with its 90 % interval, NaN without one.
    """

    name: str
    side: str
    x: FloatArray
    strides: FloatArray
    mean: FloatArray
    low: FloatArray
    high: FloatArray


@dataclass(frozen=True, eq=False)
class Measures:
    """Measures of a motion. kind: walk, run or motion. table: columns _COLUMNS. curves: of angles. notes: sentences."""

    kind: str
    table: pd.DataFrame
    curves: tuple[Curve, ...]
    notes: tuple[str, ...]


def measures_of(run: Run) -> Measures:
    """Return the measures of a recording; raises InputError if it tracks no person."""
    motion = recorded_motion(run)
    angles = joint_angles(motion.skeleton.dof_names, motion.poses)
    limbs = [_LIMBS[name.split("_")[0]] for name in angles.names]
    parts = [limb if limb == "torso" else f"{side}_{limb}" for limb, side in zip(limbs, angles.sides, strict=True)]
    seen = [k for k, part in enumerate(parts) if motion.seen[part].mean() >= _MIN_SEEN]
    in_gait = angles.chosen([k for k in seen if angles.names[k] in GAIT_ANGLES])
    legs = motion.tracked & motion.seen["left_leg"] & motion.seen["right_leg"]
    walk = _walk(motion, in_gait, legs)
    if walk is not None:
        kind, table, curves = "run" if walk.is_run else "walk", _gait_table(walk, in_gait), _cycles(walk, in_gait)
    else:
        shown = angles.chosen(seen)
        kind, table, curves = "motion", _motion_table(motion, shown), _over_time(motion, shown)
    hidden = sorted({part.replace("_", " ") for part in parts} - {parts[k].replace("_", " ") for k in seen})
    return Measures(kind, table, curves, tuple(notes_of(run, walk, motion, legs, hidden)))


def _walk(motion: RecordedMotion, angles: JointAngles, valid: BoolArray) -> Walk | None:
    joints = motion.joints
    height_m = usual_height(limb_lengths(joints[0, :1]))
    stretches = rows_of_stretches(motion.times_s, valid)
    rotation = angles.names.index("torso_rotation") if "torso_rotation" in angles.names else None
    return walk_of(motion.skeleton.names, joints, angles.values, rotation, motion.times_s, stretches, height_m)


def _gait_table(walk: Walk, angles: JointAngles) -> pd.DataFrame:
    n_strides = {side: len(strides) for side, strides in zip(SIDES, walk.strides, strict=True)}
    rows: list[tuple[object, ...]] = []
    for name, sides in walk.parameters.items():
        suffix = next(each for each in _UNITS if name.endswith(each))
        base, unit = name.removesuffix(suffix), _UNITS[suffix]
        scale = 100.0 if unit == "%" else 1.0
        rows += _rows(base, unit, {side: scale * values for side, values in sides.items()}, n_strides)
    for name in dict.fromkeys(angles.names):
        for word, field in (("range", "ranges"), ("maximum", "maxima")):
            sides = {
                side: np.degrees(getattr(cycles, field)[:, k])
                for k, side, cycles in _columns(walk, angles)
                if angles.names[k] == name
            }
            if name.startswith("torso") and len(sides) == len(SIDES):
                sides = {"both": 0.5 * (sides["left"] + sides["right"])}
            rows += _rows(f"{name}_{word}", "deg", sides, n_strides)
    return pd.DataFrame(rows, columns=list(_COLUMNS))


def _columns(walk: Walk, angles: JointAngles) -> Iterator[tuple[int, str, AngleCycles]]:
    """Yield the column of each angle with the foot whose strides are its cycles, and these."""
    for k, of_side in enumerate(angles.sides):
        for side, cycles in zip(SIDES, walk.cycles, strict=True):
            if cycles is not None and of_side in (side, "both"):
                yield k, side, cycles


_UNITS = {"_m_s": "m/s", "_steps_min": "steps/min", "_fraction": "%", "_m": "m", "_s": "s"}
_SIGNED = ("step_width", "double_support")
"""Measures that may be negative, besides largest angles and differences."""


def _rows(name: str, unit: str, sides: Mapping[str, FloatArray], counts: Mapping[str, int]) -> list[tuple[object, ...]]:
    """Return the rows of a measure (M,) by side, and of the difference of left and right."""
    if set(sides) == set(SIDES):
        sides = {**sides, "difference": sides["left"] - sides["right"]}
    rows: list[tuple[object, ...]] = []
    for side, values in sides.items():
        signed = name in _SIGNED or name.endswith("_maximum") or side == "difference"
        rows.append((name, side, unit, *_bounded(values, signed), counts.get(side, sum(counts.values()))))
    return rows


def _bounded(values: FloatArray, signed: bool) -> tuple[float, float, float]:
    """Return the estimate of values (M,) and its interval, which has no negative values unless it is signed."""
    value, low, high = (float(each[0]) for each in bands_of(values[:, None]))
    return value, low if signed else float(np.maximum(low, 0.0)), high


def _cycles(walk: Walk, angles: JointAngles) -> tuple[Curve, ...]:
    percent = np.linspace(0.0, 100.0, N_POINTS)
    curves = []
    for k, side, cycles in _columns(walk, angles):
        mean, low, high = bands_of(np.degrees(cycles.means[:, :, k]))
        curves.append(Curve(angles.names[k], side, percent, np.degrees(cycles.strides[:, :, k]), mean, low, high))
    return tuple(curves)


def _motion_table(motion: RecordedMotion, angles: JointAngles) -> pd.DataFrame:
    stretches = rows_of_stretches(motion.times_s, motion.tracked, MAX_GAP_S)
    measured = angle_measures(motion.times_s, np.unwrap(angles.values, axis=1), stretches)
    rows: list[tuple[object, ...]] = []
    for k, (name, side) in enumerate(zip(angles.names, angles.sides, strict=True)):
        n = int(measured.repetitions[k])
        for word, unit, values in (
            ("range", "deg", np.degrees(measured.ranges_rad)),
            ("peak_speed", "deg/s", np.degrees(measured.peak_speeds_rad_s)),
            ("repetition_time", "s", measured.seconds),
        ):
            rows.append((f"{name}_{word}", side, unit, *_bounded(values[:, k], signed=False), n))
    return pd.DataFrame(rows, columns=list(_COLUMNS))


def _over_time(motion: RecordedMotion, angles: JointAngles) -> tuple[Curve, ...]:
    times_s = motion.times_s[motion.tracked] - motion.times_s[0]
    none = np.empty((0, len(times_s)))
    curves = []
    for k, (name, side) in enumerate(zip(angles.names, angles.sides, strict=True)):
        mean, low, high = bands_of(np.degrees(np.unwrap(angles.values[:, motion.tracked, k], axis=1)))
        curves.append(Curve(name, side, times_s, none, mean, low, high))
    return tuple(curves)
