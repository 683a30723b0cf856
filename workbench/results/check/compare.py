"""Compare recordings of one configuration: two number by number, many of other seeds as distributions."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from workbench.evaluation.intervals import mean_interval
from workbench.recording.read.reader import Run
from workbench.recording.study.figures import numbers
from workbench.results.check.agreement import Agreement, Tolerance, agreement
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.environment import differing

Timed: TypeAlias = tuple[IntArray, FloatArray]
"""Frames (F,) and a value for each."""
_CHANGED = Agreement.CHANGED


@dataclass(frozen=True)
class Finding:
    """What the comparison of one quantity came to.

    quantity: a metric's name, or frame numbers, poses, marginals, figure <name>, run. was, now: its value; None where
    it has none. allowed: what was asked for, in words. passed: whether that held. detail: where it differs first.
    agreement: its class; None where single numbers were not compared.
    """

    quantity: str
    was: float | None
    now: float | None
    allowed: str
    passed: bool
    detail: str = ""
    agreement: Agreement | None = None


@dataclass(frozen=True)
class Demand:
    """What a comparison asks of every number: at least `agreement`, where that is TOLERANCE by metric."""

    agreement: Agreement
    tolerances: Mapping[str, Tolerance]
    """By metric or "figure NAME"; "figures" and "default" are those of the others."""

    def of(self, name: str) -> Tolerance | None:
        """Return the tolerance of a metric; None where the demand is stricter."""
        if self.agreement < Agreement.TOLERANCE:
            return None
        return self.tolerances.get(name) or self.tolerances.get("default") or Tolerance()

    def words(self, name: str) -> str:
        """Say what is asked of a metric."""
        return str(self.of(name) or ("identical" if self.agreement is Agreement.IDENTICAL else "rounding"))


def same_environment(was: Run, now: Run) -> bool:
    """Return whether two runs were made in environments in which equal code gives equal bits."""
    return bool(was.environment) and not differing(was.environment, now.environment)


def demand_on(was: Run, now: Run, tolerances: Mapping[str, Tolerance], exact: bool = False) -> Demand:
    """Return what may be asked of two runs of one configuration.

    Parameters
    ----------
    was, now
        The runs. In one environment numbers must be equal to rounding; in another they must be within tolerances, as
        a particle filter takes another course once any bit differs.
    tolerances
        By metric, or those called "default", of figures within "figures".
    exact
        Ask for identical numbers whatever the environment.
    """
    if exact:
        return Demand(Agreement.IDENTICAL, {})
    return Demand(Agreement.ROUNDING if same_environment(was, now) else Agreement.TOLERANCE, tolerances)


def compare(was: Run, now: Run, demand: Demand) -> list[Finding]:
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
    place = "" if was.is_study else _first_pose(was, now)
    if not was.is_study and (since := _since(was, now)) is not None:
        was_curves, now_curves = (_from(run, since) for run in (was, now))
        names = sorted(was_curves.keys() | now_curves.keys())
        curves = [_curve(name, was_curves.get(name), now_curves.get(name), demand) for name in names]
        return [*curves, _frames(was, now, since), _poses(was, now, place, demand)]
    names = sorted({*was.result, *was.metrics, *now.result, *now.metrics})
    findings = [_metric(name, was, now, demand, place) for name in names]
    if was.is_study:
        return findings + list(_figures(was, now, demand))
    marginals = _marginals(was, now, demand) if demand.agreement < Agreement.TOLERANCE else ()
    return [*findings, _frames(was, now), _poses(was, now, place, demand), *marginals]


def _poses(was: Run, now: Run, place: str, demand: Demand) -> Finding:
    """Judge the expected poses; within tolerances they need only be finite, as the errors say how far they moved."""
    _, before, after = _common(was.poses, now.poses)
    class_ = agreement(before, after)
    if not bool(np.isfinite(now.poses[1]).all()):
        return Finding("poses", None, None, "finite", False, "not all numbers are finite", Agreement.CHANGED)
    if demand.agreement is Agreement.TOLERANCE:
        class_ = min(class_, Agreement.TOLERANCE)
        return Finding("poses", None, None, "finite", True, "", class_)
    passed = class_ <= demand.agreement
    return Finding("poses", None, None, demand.words("poses"), passed, "" if passed else place, class_)


def _since(was: Run, now: Run) -> int | None:
    """Return the frame from which both were run, where one of them continues another run from a frame on; else None."""
    begun = [run.provenance.get("parent_frame") for run in (was, now)]
    return None if begun[0] == begun[1] else max(int(frame) for frame in begun if frame is not None)


def _from(run: Run, since: int) -> dict[str, Timed]:
    """Return what is recorded of every frame, from a frame on."""
    curves = {name: run.metric(name) for name in run.metrics}
    return {name: (frames[frames >= since], values[frames >= since]) for name, (frames, values) in curves.items()}


def _curve(name: str, was: Timed | None, now: Timed | None, demand: Demand) -> Finding:
    """Judge a metric over frames."""
    before, after = (None if curve is None or not len(curve[1]) else float(curve[1].mean()) for curve in (was, now))
    text = demand.words(name)
    if was is None or now is None:
        passed = now is not None
        return Finding(name, before, after, text, passed, "new" if passed else "missing", None if passed else _CHANGED)
    class_ = _of_curves(was, now, demand.of(name))
    passed = class_ <= demand.agreement
    return Finding(name, before, after, text, passed, "" if passed else _first_odd(name, was, now, demand), class_)


def _incomplete(was: Run, now: Run) -> Finding | None:
    for name, run in (("what was recorded", was), ("the new run", now)):
        if run.status != "complete":
            detail = f"{name} is not complete (status: {run.status})"
            return Finding("run", None, None, "complete", False, detail, _CHANGED)
    if was.is_study != now.is_study:
        return Finding("run", None, None, "same kind", False, "one tracks a person, the other is a study", _CHANGED)
    return None


def _metric(name: str, was: Run, now: Run, demand: Demand, place: str) -> Finding:
    """Judge the run's number and, unless tolerances are asked for and there is one, those of every frame."""
    before, after = number_of(name, was), number_of(name, now)
    text, tolerance = demand.words(name), demand.of(name)
    if after is None:
        return Finding(name, before, None, text, False, "missing", _CHANGED)
    if before is None:
        return Finding(name, None, after, text, True, "new")
    if (name in was.result) != (name in now.result) or (name in was.metrics) != (name in now.metrics):
        detail = "missing as the run's number or over frames"
        return Finding(name, before, after, text, False, detail, _CHANGED)
    class_ = agreement(before, after, tolerance) if np.isfinite([before, after]).all() else _CHANGED
    over_frames = name in was.metrics and name in now.metrics
    if over_frames and demand.agreement < Agreement.TOLERANCE:
        class_ = max(class_, _of_curves(was.metric(name), now.metric(name), tolerance))
    passed = class_ <= demand.agreement
    first = _first_odd(name, was.metric(name), now.metric(name), demand) if over_frames and not passed else ""
    return Finding(name, before, after, text, passed, "" if passed else first or place, class_)


def number_of(name: str, run: Run) -> float | None:
    """Return the run's number of this name, or the mean over frames of what is recorded of frames alone, or None."""
    if name in run.result:
        return float(run.result[name])
    return float(run.metric(name)[1].mean()) if name in run.metrics else None


def _of_curves(was: Timed, now: Timed, tolerance: Tolerance | None) -> Agreement:
    frames, before, after = _common(was, now)
    return _CHANGED if len(frames) < len(was[0]) else agreement(before, after, tolerance)


def _first_odd(name: str, was: Timed, now: Timed, demand: Demand) -> str:
    """Say in which frame a metric first agrees less than is asked for; empty where it does in every frame."""
    frames, before, after = _common(was, now)
    if missing := sorted(set(was[0].tolist()) - set(frames.tolist())):
        return f"missing in frame {missing[0]}"
    scale = np.nanmax(np.abs(before), initial=0.0)
    for frame, old, new in zip(frames.tolist(), before, after, strict=True):
        if agreement(np.array([old, scale]), np.array([new, scale]), demand.of(name)) > demand.agreement:
            return f"first differs in frame {frame}: {old:.6g} by {new - old:+.3g}"
    return ""


def _common(was: Timed, now: Timed) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the frames (F,) that both have, and their values."""
    frames, first, second = np.intersect1d(was[0], now[0], return_indices=True)
    return frames, was[1][first], now[1][second]


def _frames(was: Run, now: Run, since: int = 0) -> Finding:
    before, after = ({frame for frame in run.poses[0].tolist() if frame >= since} for run in (was, now))
    odd = sorted(before ^ after)
    detail = f"frame {odd[0]} is {'missing' if odd[0] in before else 'new'}, {len(odd)} in all" if odd else ""
    class_ = _CHANGED if odd else Agreement.IDENTICAL
    return Finding("frame numbers", len(before), len(after), "identical", not odd, detail, class_)


def _first_pose(was: Run, now: Run) -> str:
    """Say where the expected poses differ first: the frame, the joint that moved most, and by how much."""
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


def _marginals(was: Run, now: Run, demand: Demand) -> Iterator[Finding]:
    before, after, text = was.marginals, now.marginals, demand.words("marginals")
    if before is not None and after is not None and before.names == after.names:
        class_ = max(agreement(getattr(before, key), getattr(after, key)) for key in ("low", "high", "log_mass"))
        passed = class_ <= demand.agreement
        yield Finding("marginals", None, None, text, passed, "" if passed else "they differ", class_)
    elif before is not None:
        yield Finding("marginals", None, None, text, False, "missing, or of other parameters", _CHANGED)


def _figures(was: Run, now: Run, demand: Demand) -> Iterator[Finding]:
    """Compare a study's figures number by number."""
    after = {figure.name: numbers(figure) for figure in now.figures}
    for figure in was.figures:
        name = f"figure {figure.name}"
        key = name if name in demand.tolerances else "figures"
        text, tolerance = demand.words(key), demand.of(key)
        if figure.name not in after:
            yield Finding(name, None, None, text, False, "missing", _CHANGED)
            continue
        old, new = numbers(figure), after[figure.name]
        classes = {
            key: _CHANGED if key not in old or key not in new else agreement(old[key], new[key], tolerance)
            for key in {**old, **new}
        }
        class_ = max(classes.values(), default=Agreement.IDENTICAL)
        passed = class_ <= demand.agreement
        detail = "" if passed else f"{next(key for key, each in classes.items() if each is class_)} differs"
        yield Finding(name, None, None, text, passed, detail, class_)


def compare_seeds(old: Sequence[Run], new: Sequence[Run], n_judged: int) -> list[Finding]:
    """Compare the mean of each of the runs' numbers over `new` with what its mean over `old` lets one expect.

    See `workbench.evaluation.intervals.mean_interval`; its level lets all of `n_judged` numbers pass 95 % of the time.
    A number that is missing from any of the runs, or is not finite, fails.
    """
    level = 1.0 - 0.05 / max(n_judged, 1)
    return [_finding(name, old, new, level) for name in sorted({name for run in old for name in run.result})]


def _finding(name: str, old: Sequence[Run], new: Sequence[Run], level: float) -> Finding:
    if lacking := sum(name not in run.result for run in (*old, *new)):
        return Finding(name, None, None, "", False, f"missing from {lacking} of {len(old) + len(new)} runs")
    before, after = (np.array([run.result[name] for run in runs], dtype=np.float64) for runs in (old, new))
    if not (np.isfinite(before).all() and np.isfinite(after).all()):
        return Finding(name, float(before.mean()), float(after.mean()), "", False, "not a finite number in every run")
    allowed = mean_interval(before, after, level)
    passed = bool(abs(after.mean() - before.mean()) <= allowed)
    detail = "" if passed else f"means of {len(old)} and {len(new)} seeds lie too far apart"
    return Finding(name, float(before.mean()), float(after.mean()), f"± {allowed:.3g}", passed, detail)
