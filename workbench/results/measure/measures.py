"""Measures of a recorded motion as tables, curves and sentences."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from workbench.body.stature import SIDES, limb_lengths, usual_height
from workbench.evaluation.gait.angle_cycles import N_POINTS
from workbench.evaluation.gait.estimates import bands_of, estimate_of
from workbench.evaluation.gait.joint_angles import CONVENTIONS, GAIT_ANGLES, JointAngles, joint_angles
from workbench.evaluation.gait.repetitions import angle_measures
from workbench.evaluation.gait.stretches import rows_of_stretches
from workbench.evaluation.gait.walk import Walk, walk_of
from workbench.recording.read.reader import Run
from workbench.results.measure.notes import GaitNotes, notes_of
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

    @property
    def x_name(self) -> str:
        """Name of the curves' x axis and column."""
        return "time_s" if self.kind == "motion" else "percent"


def measures_of(run: Run) -> Measures:
    """Return the measures of a recording; raises InputError if it tracks no person."""
    motion = recorded_motion(run)
    angles = joint_angles(motion.skeleton.dof_names, motion.poses)
    shown = _shown(motion, angles)
    legs = motion.tracked & motion.seen["left_leg"] & motion.seen["right_leg"]
    walk = _walk(motion, angles, legs)
    if walk is not None:
        kind, table, curves = (
            "run" if walk.is_run else "walk",
            _gait_table(walk, angles, shown),
            _cycles(walk, angles, shown),
        )
    else:
        kind, table, curves = "motion", _motion_table(motion, angles, shown), _over_time(motion, angles, shown)
    facts = GaitNotes(walk, motion, legs, hidden=_hidden(angles, shown))
    return Measures(kind, table, curves, tuple(notes_of(run, facts)))


def _walk(motion: RecordedMotion, angles: JointAngles, valid: BoolArray) -> Walk | None:
    joints = motion.joints
    height_m = usual_height(limb_lengths(joints[0, :1]))
    stretches = rows_of_stretches(motion.times_s, valid)
    rotation = angles.names.index("torso_rotation")
    return walk_of(motion.skeleton.names, joints, angles.values, rotation, motion.times_s, stretches, height_m)


def _shown(motion: RecordedMotion, angles: JointAngles) -> list[int]:
    """Return the columns of the angles of parts of the body that are seen in enough frames, in the order of tables."""
    order = {name: k for k, name in enumerate(CONVENTIONS)}
    columns = sorted(range(len(angles.names)), key=lambda k: (order[angles.names[k]], angles.sides[k]))
    return [k for k in columns if motion.seen[_part(angles, k)].mean() >= _MIN_SEEN]


def _part(angles: JointAngles, column: int) -> str:
    limb = _LIMBS[angles.names[column].split("_")[0]]
    return limb if limb == "torso" else f"{angles.sides[column]}_{limb}"


def _hidden(angles: JointAngles, shown: list[int]) -> list[str]:
    hidden = {_part(angles, k).replace("_", " ") for k in set(range(len(angles.names))) - set(shown)}
    return sorted(hidden)


def _gait_table(walk: Walk, angles: JointAngles, shown: list[int]) -> pd.DataFrame:
    n_strides = {side: len(strides) for side, strides in zip(SIDES, walk.strides, strict=True)}
    rows: list[tuple[object, ...]] = []
    for name, sides in walk.parameters.items():
        base, _, unit = _measure_unit(name)
        if unit == "%":
            sides = {side: 100.0 * values for side, values in sides.items()}
        rows += _rows(base, unit, sides, n_strides)
    for name in GAIT_ANGLES:
        for word, field in (("range", "ranges"), ("maximum", "maxima")):
            sides = {}
            for k in (k for k in shown if angles.names[k] == name):
                of_sides = [side for side in SIDES if angles.sides[k] in (side, "both")]
                cycles = {side: walk.cycles[SIDES.index(side)] for side in of_sides}
                sides |= {side: np.degrees(getattr(each, field)[:, k]) for side, each in cycles.items() if each}
            if len(sides) == len(SIDES) and name.startswith("torso"):
                sides = {"both": 0.5 * (sides["left"] + sides["right"])}
            rows += _rows(f"{name}_{word}", "deg", sides, n_strides)
    return pd.DataFrame(rows, columns=list(_COLUMNS))


_UNITS = {"_m_s": "m/s", "_steps_min": "steps/min", "_fraction": "%", "_m": "m", "_s": "s"}


def _measure_unit(name: str) -> tuple[str, str, str]:
    """Return a parameter's name without its unit, the unit's suffix, and the unit."""
    suffix = next(each for each in _UNITS if name.endswith(each))
    return name.removesuffix(suffix), suffix, _UNITS[suffix]


def _rows(name: str, unit: str, sides: Mapping[str, FloatArray], counts: Mapping[str, int]) -> list[tuple[object, ...]]:
    """Return the rows of a measure (M,) by side, and of the difference of left and right."""
    if set(sides) == set(SIDES):
        sides = {**sides, "difference": sides["left"] - sides["right"]}
    rows = []
    for side, values in sides.items():
        each = estimate_of(values)
        n = counts.get(side, sum(counts.values()))
        rows.append((name, side, unit, each.value, each.low, each.high, n))
    return rows


def _cycles(walk: Walk, angles: JointAngles, shown: list[int]) -> tuple[Curve, ...]:
    percent = np.linspace(0.0, 100.0, N_POINTS)
    curves = []
    for k in shown:
        if angles.names[k] not in GAIT_ANGLES:
            continue
        for side, cycles in zip(SIDES, walk.cycles, strict=True):
            if cycles is not None and angles.sides[k] in (side, "both"):
                mean, low, high = bands_of(np.degrees(cycles.means[:, :, k]))
                strides = np.degrees(cycles.strides[:, :, k])
                curves.append(Curve(angles.names[k], side, percent, strides, mean, low, high))
    return tuple(curves)


def _motion_table(motion: RecordedMotion, angles: JointAngles, shown: list[int]) -> pd.DataFrame:
    values = np.unwrap(angles.values[..., shown], axis=1)
    stretches = rows_of_stretches(motion.times_s, motion.tracked, MAX_GAP_S)
    measured = angle_measures(motion.times_s, values, stretches)
    rows: list[tuple[object, ...]] = []
    for column, k in enumerate(shown):
        n = int(measured.repetitions[column])
        for word, unit, each in (
            ("range", "deg", np.degrees(measured.ranges_rad)),
            ("peak_speed", "deg/s", np.degrees(measured.peak_speeds_rad_s)),
            ("repetition_time", "s", measured.seconds),
        ):
            if word != "repetition_time" or n > 0:
                estimate = estimate_of(each[:, column])
                row = (estimate.value, estimate.low, estimate.high, n)
                rows.append((f"{angles.names[k]}_{word}", angles.sides[k], unit, *row))
    return pd.DataFrame(rows, columns=list(_COLUMNS))


def _over_time(motion: RecordedMotion, angles: JointAngles, shown: list[int]) -> tuple[Curve, ...]:
    tracked = motion.tracked
    times_s = motion.times_s[tracked] - motion.times_s[:1]
    curves = []
    for k in shown:
        degrees = np.degrees(np.unwrap(angles.values[:, tracked, k], axis=1))
        mean, low, high = bands_of(degrees)
        none = np.empty((0, len(times_s)))
        curves.append(Curve(angles.names[k], angles.sides[k], times_s, none, mean, low, high))
    return tuple(curves)
