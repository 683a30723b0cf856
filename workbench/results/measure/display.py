"""Measures as a table for people: a row for each measure, with its estimates and intervals by side."""

import math

import pandas as pd

from workbench.evaluation.gait.joint_angles import CONVENTIONS
from workbench.results.formatting import table_of
from workbench.results.measure.measures import Measures

_DIGITS = {"m": 3, "m/s": 2, "s": 2, "%": 1, "steps/min": 1, "deg": 1, "deg/s": 0}
_SIDES = ("both", "left", "right", "difference")
_WORDS = ("range", "maximum", "peak_speed", "repetition_time")


def display(measures: Measures) -> pd.DataFrame:
    """Return the table of a walk by measure and side, or of another motion by joint angle."""
    return _by_angle(measures.table) if measures.kind == "motion" else _by_side(measures.table)


def headline(measures: Measures) -> str:
    """Return what was measured in a few words, with speed and cadence of a walk."""
    if measures.kind == "motion":
        return "ranges, speeds and repetitions of the joint angles"
    rows = measures.table.set_index("measure").loc[["speed", "cadence"]]
    numbers = (f"{estimate(row.estimate, row.low_90, row.high_90, row.unit)} {row.unit}" for row in rows.itertuples())
    return f"a {measures.kind} at {' and '.join(numbers)}"


def estimate(value: float, low: float, high: float, unit: str) -> str:
    """Return a number as text, with its 90 % interval where there is one; a dash for an unknown one."""
    if not math.isfinite(value):
        return "–"
    digits = _DIGITS[unit]
    interval = f" ({low:.{digits}f} to {high:.{digits}f})" if math.isfinite(low) else ""
    return f"{value:.{digits}f}{interval}"


def title(measure: str) -> str:
    """Return a measure's name in words."""
    word = next((each for each in _WORDS if measure.endswith(f"_{each}")), "")
    angle = measure.removesuffix(f"_{word}")
    return (
        f"{CONVENTIONS[angle].title}, {word.replace('_', ' ')}" if angle in CONVENTIONS else measure.replace("_", " ")
    )


def _by_side(table: pd.DataFrame) -> pd.DataFrame:
    rows = []
    for measure, group in table.groupby("measure", sort=False):
        texts = {row.side: estimate(row.estimate, row.low_90, row.high_90, row.unit) for row in group.itertuples()}
        rows.append((title(str(measure)), group["unit"].iloc[0], *(texts.get(side, "") for side in _SIDES)))
    return table_of(("measure", "unit", "both", "left", "right", "left − right"), rows)


def _by_angle(table: pd.DataFrame) -> pd.DataFrame:
    rows = []
    for (angle, side), group in table.groupby([table["measure"].map(_angle), "side"], sort=False):
        texts = {
            row.measure.removeprefix(f"{angle}_"): estimate(row.estimate, row.low_90, row.high_90, row.unit)
            for row in group.itertuples()
        }
        words = (texts["range"], texts["peak_speed"], str(group["n"].iloc[0]), texts.get("repetition_time", "–"))
        rows.append((CONVENTIONS[angle].title, side, *words))
    return table_of(("angle", "side", "range (deg)", "peak speed (deg/s)", "repetitions", "seconds each"), rows)


def _angle(measure: str) -> str:
    return next(name for name in CONVENTIONS if measure.startswith(f"{name}_"))
