"""Compare recordings of one configuration: two bit for bit or by tolerances, many of other seeds as distributions."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from workbench.arrays import FloatArray, IntArray
from workbench.evaluation.intervals import mean_interval
from workbench.recording.read.reader import Run
from workbench.recording.study.figures import numbers

Timed: TypeAlias = tuple[IntArray, FloatArray]
"""Frames (F,) and a value for each."""
EXACT = ("python", "workbench", "numpy", "scipy", "numba", "opencv-python-headless")
"""What must be of the same version, beside the platform, for equal runs to give equal bits."""


@dataclass(frozen=True)
class Tolerance:
    """How far a number may move: by `absolute`, in its unit, or `relative` times what it was."""

    absolute: float = 0.0
    relative: float = 0.0

    def allows(self, was: FloatArray | float, now: FloatArray | float) -> bool:
        """Tell whether every number is finite and moved no further."""
        was, now = np.asarray(was, dtype=np.float64), np.asarray(now, dtype=np.float64)
        if was.shape != now.shape or not (np.isfinite(was).all() and np.isfinite(now).all()):
            return False
        return bool((np.abs(now - was) <= np.maximum(self.absolute, self.relative * np.abs(was))).all())

    def __str__(self) -> str:
        parts = [f"{self.absolute:g}"] if self.absolute > 0.0 else []
        parts += [f"{100.0 * self.relative:g} %"] if self.relative > 0.0 else []
        return "± " + (" or ".join(parts) or "0")


@dataclass(frozen=True)
class Finding:
    """What the comparison of one quantity came to.

    quantity: a metric's name, or frame numbers, poses, marginals, figure <name>, run. was, now: its value; None where
    it has none. tolerance: exact, or what it may move by. detail: where it differs first.
    """

    quantity: str
    was: float | None
    now: float | None
    tolerance: str
    passed: bool
    detail: str = ""


def exactly_comparable(was: Run, now: Run) -> bool:
    """Tell whether the two were made on one platform by the same versions, so that equal runs give equal bits."""
    same = all(was.provenance.get(name) == now.provenance.get(name) for name in EXACT)
    return same and was.platform is not None and was.platform == now.platform


def compare(was: Run, now: Run, tolerances: Mapping[str, Tolerance]) -> list[Finding]:
    """Tell what became of every number of `was` in `now`.

    Where `exactly_comparable`, all that is recorded in full precision must be equal bit for bit: results, metrics of
    every frame, expected poses, and the pictures of the marginals, in which every weight and every particle counts.
    Elsewhere results must lie within `tolerances`, by metric, or those called "default", figures within "figures".
    In both: a number that is not finite, a metric or frame that is missing, and a run that is not complete is a
    failure. A metric that is new is none. Where one of them goes on from a frame of another run, as the other does not,
    all is compared from that frame on: what is recorded of every frame, but no number of a whole run.
    """
    if (broken := _incomplete(was, now)) is not None:
        return [broken]
    exact = exactly_comparable(was, now)
    place = "" if was.is_study else _first_pose(was, now)

    def allowed(name: str) -> Tolerance | None:
        return None if exact else tolerances.get(name) or tolerances.get("default") or Tolerance()

    if not was.is_study and (since := _since(was, now)) is not None:
        was_curves, now_curves = (_from(run, since) for run in (was, now))
        names = sorted(was_curves.keys() | now_curves.keys())
        found = [_curve(name, was_curves.get(name), now_curves.get(name), allowed(name)) for name in names]
        return [*found, _frames(was, now, since), _poses(now, place, exact)]
    names = sorted({*was.result, *was.metrics, *now.result, *now.metrics})
    found = [_metric(name, was, now, allowed(name), place) for name in names]
    if was.is_study:
        return found + list(_figures(was, now, allowed("figures")))
    return [*found, _frames(was, now), _poses(now, place, exact), *(_marginals(was, now) if exact else ())]


def _poses(now: Run, place: str, exact: bool) -> Finding:
    finite = bool(np.isfinite(now.poses[1]).all())
    detail = (place if exact else "") if finite else "not all numbers are finite"
    return Finding("poses", None, None, "exact" if exact and finite else "finite", not detail, detail)


def _since(was: Run, now: Run) -> int | None:
    """Find the frame from which both were run, where one of them goes on from a frame of another run; else None."""
    begun = [run.provenance.get("parent_frame") for run in (was, now)]
    return None if begun[0] == begun[1] else max(int(frame) for frame in begun if frame is not None)


def _from(run: Run, since: int) -> dict[str, Timed]:
    """What is recorded of every frame, from a frame on."""
    curves = {name: run.metric(name) for name in run.metrics}
    return {name: (frames[frames >= since], values[frames >= since]) for name, (frames, values) in curves.items()}


def _curve(name: str, was: Timed | None, now: Timed | None, tolerance: Tolerance | None) -> Finding:
    """Judge a metric over frames; tolerance: None for exact."""
    before, after = (None if curve is None or not len(curve[1]) else float(curve[1].mean()) for curve in (was, now))
    text = "exact" if tolerance is None else str(tolerance)
    if was is None or now is None:
        return Finding(name, before, after, text, now is not None, "missing" if now is None else "new")
    at = _first_odd(was, now, tolerance or Tolerance())
    return Finding(name, before, after, text, not at, at)


def _incomplete(was: Run, now: Run) -> Finding | None:
    for name, run in (("what was recorded", was), ("the new run", now)):
        if run.status != "complete":
            return Finding("run", None, None, "complete", False, f"{name} is not complete (status: {run.status})")
    if was.is_study != now.is_study:
        return Finding("run", None, None, "same kind", False, "one tracks a person, the other is a study")
    return None


def _metric(name: str, was: Run, now: Run, tolerance: Tolerance | None, place: str) -> Finding:
    """Judge the run's number and, where exact (tolerance None) or there is none, those of every frame."""
    before, after = _number(name, was), _number(name, now)
    text = "exact" if tolerance is None else str(tolerance)
    if after is None:
        return Finding(name, before, None, text, False, "missing")
    if before is None:
        return Finding(name, None, after, text, True, "new")
    if (name in was.result) != (name in now.result) or (name in was.metrics) != (name in now.metrics):
        return Finding(name, before, after, text, False, "missing as the run's number or over frames")
    at = _first_frame(name, was, now, tolerance or Tolerance())
    passed = (tolerance or Tolerance()).allows(before, after) and (tolerance is not None or not at)
    detail = (at or place) if tolerance is None else "; ".join(filter(None, (at, place)))  # exact: poses have a row
    return Finding(name, before, after, text, passed, "" if passed else detail)


def _number(name: str, run: Run) -> float | None:
    if name in run.result:
        return float(run.result[name])
    return float(run.metric(name)[1].mean()) if name in run.metrics else None


def _first_frame(name: str, was: Run, now: Run, tolerance: Tolerance) -> str:
    """Find the first frame in which a metric moved too far; empty where none did, or it is not recorded over frames."""
    if name not in was.metrics or name not in now.metrics:
        return ""
    return _first_odd(was.metric(name), now.metric(name), tolerance)


def _first_odd(was: Timed, now: Timed, tolerance: Tolerance) -> str:
    frames, before, after = _common(was, now)
    if missing := sorted(set(was[0].tolist()) - set(frames.tolist())):
        return f"missing in frame {missing[0]}"
    for frame, old, new in zip(frames.tolist(), before, after, strict=True):
        if not tolerance.allows(old, new):
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
    return Finding("frame numbers", len(before), len(after), "exact", not odd, detail)


def _first_pose(was: Run, now: Run) -> str:
    """Find where the expected poses differ first: the frame, the joint that moved most, and by how much."""
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


def _marginals(was: Run, now: Run) -> Iterator[Finding]:
    before, after = was.marginals, now.marginals
    if before is not None and after is not None and before.names == after.names:
        equal = all(np.array_equal(getattr(before, key), getattr(after, key)) for key in ("low", "high", "log_mass"))
        yield Finding("marginals", None, None, "exact", equal, "" if equal else "they differ")
    elif before is not None:
        yield Finding("marginals", None, None, "exact", False, "missing, or of other parameters")


def _figures(was: Run, now: Run, tolerance: Tolerance | None) -> Iterator[Finding]:
    """Compare a study's figures number by number."""
    text = "exact" if tolerance is None else str(tolerance)
    after = {figure.name: numbers(figure) for figure in now.figures}
    for figure in was.figures:
        if figure.name not in after:
            yield Finding(f"figure {figure.name}", None, None, text, False, "missing")
            continue
        old, new = numbers(figure), after[figure.name]
        odd = [key for key in {**old, **new} if not _alike(old.get(key), new.get(key), tolerance or Tolerance())]
        yield Finding(f"figure {figure.name}", None, None, text, not odd, f"{odd[0]} differs" if odd else "")


def _alike(old: object, new: object, tolerance: Tolerance) -> bool:
    if old is None or new is None:
        return False
    first, second = np.asarray(old), np.asarray(new)
    if first.dtype.kind == "f" and first.shape == second.shape:
        gaps = np.isnan(first)  # in curves, which must stay where they are
        return bool(np.array_equal(gaps, np.isnan(second))) and tolerance.allows(first[~gaps], second[~gaps])
    return bool(np.array_equal(first, second))


def compare_seeds(old: Sequence[Run], new: Sequence[Run], n_judged: int) -> list[Finding]:
    """Tell whether the mean of each of the runs' numbers over `new` lies where the mean over `old` lets one expect it.

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
