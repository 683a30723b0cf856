"""Comparison of two recordings of one configuration, number by number."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from workbench.recording.read.reader import Run
from workbench.recording.study.figures import numbers
from workbench.results.check.agreement import Agreement, Demand, MetricChange, Tolerance, agreement
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.environment import differing

_Timed = tuple[IntArray, FloatArray]  # frames (F,) and a value for each


def same_environment(was: Run, now: Run) -> bool:
    """Return whether two runs' environments are equal, in which equal code gives identical numbers."""
    return bool(was.environment) and not differing(was.environment, now.environment)


def demand_on(was: Run, now: Run, tolerances: Mapping[str, Tolerance], exact: bool = False) -> Demand:
    """Return the demand on two runs of one configuration.

    In one environment numbers must be equal to rounding. In another one they must be within tolerances, since a
    particle filter diverges once any bit differs. exact: demand identical numbers in any environment.
    """
    if exact:
        return Demand(Agreement.IDENTICAL, {})
    return Demand(Agreement.ROUNDING if same_environment(was, now) else Agreement.TOLERANCE, tolerances)


def compare(was: Run, now: Run, demand: Demand) -> list[MetricChange]:
    """Compare every number of two runs.

    Up to rounding all quantities in full precision are compared: results, metrics of every frame, expected poses, and
    the histograms of the marginals, which depend on every particle's weight. Within tolerances only results and figures
    are compared. A number that is not finite, a missing metric or frame, and an incomplete run fail in any case; a new
    metric does not.
    """
    if (broken := _incomplete(was, now)) is not None:
        return [broken]
    place = "" if was.is_study else _first_pose(was, now)
    strict = demand.agreement < Agreement.TOLERANCE
    before, after = _quantities(was, strict), _quantities(now, strict)
    names = sorted(before.keys() | after.keys())
    changes = [_changed(name, before.get(name), after.get(name), demand, place) for name in names]
    return changes if was.is_study else [*changes, _frames(was, now), _poses(was, now, place, demand)]


def number_of(name: str, run: Run) -> float | None:
    """Return the run's number of this name, or the mean of a metric recorded only over frames, or None."""
    quantity = _quantities(run).get(name)
    return None if quantity is None else quantity.number


@dataclass(frozen=True, eq=False)
class _Quantity:
    """A metric's value of the run and over frames, or the parts of a figure or of marginals by name."""

    value: float | None = None
    curve: _Timed | None = None
    parts: Mapping[str, Any] = field(default_factory=dict)

    @property
    def number(self) -> float | None:
        return self.value if self.value is not None or self.curve is None else float(self.curve[1].mean())


def _quantities(run: Run, strict: bool = False) -> dict[str, _Quantity]:
    """Return the compared quantities by name; strict: with the marginals."""
    results = {name: float(value) for name, value in run.result.items()}
    curves = {name: run.metric(name) for name in run.metrics}
    quantities = {name: _Quantity(results.get(name), curves.get(name)) for name in results.keys() | curves.keys()}
    if run.is_study:
        return quantities | {f"figure {figure.name}": _Quantity(parts=numbers(figure)) for figure in run.figures}
    if strict and (marginals := run.marginals) is not None:
        keys = ("names", "low", "high", "log_mass")
        quantities["marginals"] = _Quantity(parts={key: getattr(marginals, key) for key in keys})
    return quantities


def _changed(name: str, was: _Quantity | None, now: _Quantity | None, demand: Demand, place: str) -> MetricChange:
    """Return the change of a quantity: its number, its parts, and except within tolerances every frame's value."""
    tolerance, detail, class_ = demand.of(name), "", Agreement.IDENTICAL
    if was is None or now is None:
        number = None if now is None else now.number
        if was is None:
            return MetricChange(name, None, number, demand.words(name), True, "new")
        return MetricChange(name, was.number, None, demand.words(name), False, "missing", Agreement.CHANGED)
    if (was.value is None, was.curve is None) != (now.value is None, now.curve is None):
        detail, class_ = "missing as the run's number or over frames", Agreement.CHANGED
    elif was.number is not None and now.number is not None:
        finite = bool(np.isfinite([was.number, now.number]).all())
        class_ = agreement(was.number, now.number, tolerance) if finite else Agreement.CHANGED
    for part in {**was.parts, **now.parts}:
        if (other := agreement(was.parts.get(part), now.parts.get(part), tolerance)) > class_:
            detail, class_ = f"{part} differs", other
    if was.curve is not None and now.curve is not None and not detail:
        if demand.agreement < Agreement.TOLERANCE:
            frames, old, new = _common(was.curve, now.curve)
            whole = len(frames) == len(was.curve[0])
            class_ = max(class_, agreement(old, new, tolerance) if whole else Agreement.CHANGED)
        detail = _first_difference(was.curve, now.curve, demand, tolerance) if class_ > demand.agreement else ""
    return _change(name, was.number, now.number, demand, class_, detail or place)


def _change(
    name: str, was: float | None, now: float | None, demand: Demand, class_: Agreement, detail: str
) -> MetricChange:
    """Return a change of this class; detail: used where it fails."""
    passed = class_ <= demand.agreement
    return MetricChange(name, was, now, demand.words(name), passed, "" if passed else detail, class_)


def _failed(name: str, allowed: str, detail: str) -> MetricChange:
    return MetricChange(name, None, None, allowed, False, detail, Agreement.CHANGED)


def _incomplete(was: Run, now: Run) -> MetricChange | None:
    for name, run in (("the old run", was), ("the new run", now)):
        if run.status != "complete":
            return _failed("run", "complete", f"{name} is not complete (status: {run.status})")
    if was.is_study != now.is_study:
        return _failed("run", "same kind", "one tracks a person, the other is a study")
    return None


def _first_difference(was: _Timed, now: _Timed, demand: Demand, tolerance: Tolerance | None) -> str:
    """Return the first frame in which a metric agrees less than demanded, in words; "" without one."""
    frames, before, after = _common(was, now)
    if missing := sorted(set(was[0].tolist()) - set(frames.tolist())):
        return f"missing in frame {missing[0]}"
    scale = np.nanmax(np.abs(before), initial=0.0)
    for frame, old, new in zip(frames.tolist(), before, after, strict=True):
        if agreement(np.array([old, scale]), np.array([new, scale]), tolerance) > demand.agreement:
            return f"first differs in frame {frame}: {old:.6g} by {new - old:+.3g}"
    return ""


def _common(was: _Timed, now: _Timed) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the common frames (F,), and both values."""
    frames, first, second = np.intersect1d(was[0], now[0], return_indices=True)
    return frames, was[1][first], now[1][second]


def _frames(was: Run, now: Run) -> MetricChange:
    before, after = (set(run.poses[0].tolist()) for run in (was, now))
    different = sorted(before ^ after)
    kind = "missing" if different and different[0] in before else "new"
    detail = f"frame {different[0]} is {kind}, {len(different)} in all" if different else ""
    class_ = Agreement.CHANGED if different else Agreement.IDENTICAL
    return MetricChange("frame numbers", len(before), len(after), "identical", not different, detail, class_)


def _poses(was: Run, now: Run, place: str, demand: Demand) -> MetricChange:
    """Return the change of the expected poses; within tolerances they must only be finite, since errors measure it."""
    if not bool(np.isfinite(now.poses[1]).all()):
        return _failed("poses", "finite", "not all numbers are finite")
    _, before, after = _common(was.poses, now.poses)
    class_ = agreement(before, after)
    if demand.agreement is Agreement.TOLERANCE:
        return MetricChange("poses", None, None, "finite", True, "", min(class_, Agreement.TOLERANCE))
    return _change("poses", None, None, demand, class_, place)


def _first_pose(was: Run, now: Run) -> str:
    """Return the first difference of the expected poses in words: the frame, the joint that moved most, how far."""
    frames, before, after = _common(was.poses, now.poses)
    if before.shape != after.shape:
        return f"poses of {before.shape[1]} and of {after.shape[1]} numbers"
    differ = np.flatnonzero((before.view(np.int64) != after.view(np.int64)).any(axis=1))
    if len(differ) == 0:
        return ""
    row, frame = differ[0], int(frames[differ[0]])
    old, new = (run.joints.positions[run.joints.frames == frame] for run in (was, now))
    distances = np.linalg.norm(new - old, axis=-1).ravel() if old.shape == new.shape else np.empty(0)
    if distances.max(initial=0.0) > 0.0:
        moved = f"{was.joints.names[int(np.argmax(distances))]} by {1e3 * distances.max():.3g} mm"
    else:  # equal in float32, the precision of recorded joints
        change = np.nan_to_num(np.abs(after[row] - before[row]), nan=np.inf)
        moved = f"{was.properties['body']['pose'][int(np.argmax(change))]} by {change.max():.3g} (m or rad)"
    return f"poses first differ in frame {frame}: {moved}"
