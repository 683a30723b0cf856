"""Two recordings of one configuration compared number by number."""

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
    """Return whether two runs were made in environments in which equal code gives equal bits."""
    return bool(was.environment) and not differing(was.environment, now.environment)


def demand_on(was: Run, now: Run, tolerances: Mapping[str, Tolerance], exact: bool = False) -> Demand:
    """Return what may be demanded of two runs of one configuration.

    In one environment numbers must be equal to rounding; in another they must be within tolerances, as a particle
    filter takes another course once any bit differs. exact: demand identical numbers whatever the environment.
    """
    if exact:
        return Demand(Agreement.IDENTICAL, {})
    return Demand(Agreement.ROUNDING if same_environment(was, now) else Agreement.TOLERANCE, tolerances)


def compare(was: Run, now: Run, demand: Demand) -> list[MetricChange]:
    """Compare every number of two runs.

    Up to rounding, everything that is recorded in full precision is compared: results, metrics of every frame,
    expected poses, and the histograms of the marginals, in which every particle's weight counts. Within tolerances,
    results and figures alone.
    A number that is not finite, a metric or frame that is missing, and a run that is not complete fail in any case; a
    metric that is new does not. Where one of the runs continues another from a frame on, everything is compared from
    that frame on: what is recorded of every frame, but no number of a whole run.
    """
    if (broken := _incomplete(was, now)) is not None:
        return [broken]
    since = None if was.is_study else _since(was, now)
    place = "" if was.is_study else _first_pose(was, now)
    strict = demand.agreement < Agreement.TOLERANCE
    before, after = _quantities(was, since, strict), _quantities(now, since, strict)
    names = sorted(before.keys() | after.keys())
    judged = [_judge(name, before.get(name), after.get(name), demand, place) for name in names]
    return judged if was.is_study else [*judged, _frames(was, now, since or 0), _poses(was, now, place, demand)]


def number_of(name: str, run: Run) -> float | None:
    """Return the run's number of this name, or the mean over frames of what is recorded of frames alone, or None."""
    quantity = _quantities(run, None).get(name)
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


def _quantities(run: Run, since: int | None, strict: bool = False) -> dict[str, _Quantity]:
    """Return what is compared by name; since: the first frame that counts, where no number of the whole run does."""
    results = {name: float(value) for name, value in run.result.items()} if since is None else {}
    curves = {name: run.metric(name) for name in run.metrics}
    if since is not None:
        late = {name: frames >= since for name, (frames, _) in curves.items()}
        curves = {name: (curves[name][0][kept], curves[name][1][kept]) for name, kept in late.items() if kept.any()}
    found = {name: _Quantity(results.get(name), curves.get(name)) for name in results.keys() | curves.keys()}
    if run.is_study:
        return found | {f"figure {figure.name}": _Quantity(parts=numbers(figure)) for figure in run.figures}
    if strict and since is None and (marginals := run.marginals) is not None:
        keys = ("names", "low", "high", "log_mass")
        found["marginals"] = _Quantity(parts={key: getattr(marginals, key) for key in keys})
    return found


def _judge(name: str, was: _Quantity | None, now: _Quantity | None, demand: Demand, place: str) -> MetricChange:
    """Judge a quantity: the run's number, its parts, and unless tolerances are demanded the values of every frame."""
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
        detail = _first_odd(was.curve, now.curve, demand, tolerance) if class_ > demand.agreement else ""
    return _change(name, was.number, now.number, demand, class_, detail or place)


def _change(
    name: str, was: float | None, now: float | None, demand: Demand, class_: Agreement, detail: str
) -> MetricChange:
    """Return a change of this class; detail: of one that fails."""
    passed = class_ <= demand.agreement
    return MetricChange(name, was, now, demand.words(name), passed, "" if passed else detail, class_)


def _failed(name: str, allowed: str, detail: str) -> MetricChange:
    return MetricChange(name, None, None, allowed, False, detail, Agreement.CHANGED)


def _incomplete(was: Run, now: Run) -> MetricChange | None:
    for name, run in (("what was recorded", was), ("the new run", now)):
        if run.status != "complete":
            return _failed("run", "complete", f"{name} is not complete (status: {run.status})")
    if was.is_study != now.is_study:
        return _failed("run", "same kind", "one tracks a person, the other is a study")
    return None


def _since(was: Run, now: Run) -> int | None:
    """Return the frame from which both were run, where one of them continues another run from a frame on; else None."""
    begun = [run.provenance.get("parent_frame") for run in (was, now)]
    return None if begun[0] == begun[1] else max(int(frame) for frame in begun if frame is not None)


def _first_odd(was: _Timed, now: _Timed, demand: Demand, tolerance: Tolerance | None) -> str:
    """Return in which frame a metric first agrees less than demanded; empty where it does in every frame."""
    frames, before, after = _common(was, now)
    if missing := sorted(set(was[0].tolist()) - set(frames.tolist())):
        return f"missing in frame {missing[0]}"
    scale = np.nanmax(np.abs(before), initial=0.0)
    for frame, old, new in zip(frames.tolist(), before, after, strict=True):
        if agreement(np.array([old, scale]), np.array([new, scale]), tolerance) > demand.agreement:
            return f"first differs in frame {frame}: {old:.6g} by {new - old:+.3g}"
    return ""


def _common(was: _Timed, now: _Timed) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the frames (F,) that both have, and their values."""
    frames, first, second = np.intersect1d(was[0], now[0], return_indices=True)
    return frames, was[1][first], now[1][second]


def _frames(was: Run, now: Run, since: int) -> MetricChange:
    before, after = ({frame for frame in run.poses[0].tolist() if frame >= since} for run in (was, now))
    odd = sorted(before ^ after)
    detail = f"frame {odd[0]} is {'missing' if odd[0] in before else 'new'}, {len(odd)} in all" if odd else ""
    class_ = Agreement.CHANGED if odd else Agreement.IDENTICAL
    return MetricChange("frame numbers", len(before), len(after), "identical", not odd, detail, class_)


def _poses(was: Run, now: Run, place: str, demand: Demand) -> MetricChange:
    """Judge the expected poses; within tolerances they need only be finite, as the errors show how far they moved."""
    if not bool(np.isfinite(now.poses[1]).all()):
        return _failed("poses", "finite", "not all numbers are finite")
    _, before, after = _common(was.poses, now.poses)
    class_ = agreement(before, after)
    if demand.agreement is Agreement.TOLERANCE:
        return MetricChange("poses", None, None, "finite", True, "", min(class_, Agreement.TOLERANCE))
    return _change("poses", None, None, demand, class_, place)


def _first_pose(was: Run, now: Run) -> str:
    """Return where the expected poses differ first: the frame, the joint that moved most, and by how much."""
    frames, before, after = _common(was.poses, now.poses)
    if before.shape != after.shape:
        return f"poses of {before.shape[1]} and of {after.shape[1]} numbers"
    differ = np.flatnonzero((before.view(np.int64) != after.view(np.int64)).any(axis=1))
    if len(differ) == 0:
        return ""
    row, frame = differ[0], int(frames[differ[0]])
    old, new = (run.joints.positions[run.joints.frames == frame] for run in (was, now))
    away = np.linalg.norm(new - old, axis=-1).ravel() if old.shape == new.shape else np.empty(0)
    if away.max(initial=0.0) > 0.0:
        moved = f"{was.joints.names[int(np.argmax(away))]} by {1e3 * away.max():.3g} mm"
    else:  # float32, as joints are recorded, sees no difference
        far = np.nan_to_num(np.abs(after[row] - before[row]), nan=np.inf)
        moved = f"{was.properties['body']['pose'][int(np.argmax(far))]} by {far.max():.3g} (m or rad)"
    return f"poses first differ in frame {frame}: {moved}"
