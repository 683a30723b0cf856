"""Two recordings of one configuration compared number by number."""

from collections.abc import Iterator, Mapping

import numpy as np

from workbench.recording.read.reader import Run
from workbench.recording.study.figures import numbers
from workbench.results.check.agreement import Agreement, Demand, MetricChange, Tolerance, agreement
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.environment import differing

_Timed = tuple[IntArray, FloatArray]  # frames (F,) and a value for each
_Quantity = tuple[float | None, _Timed | None]  # the run's number and the values over frames


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
    before, after = _quantities(was, since), _quantities(now, since)
    names = sorted(before.keys() | after.keys())
    none = (None, None)
    changes = [_metric(name, before.get(name, none), after.get(name, none), demand, place) for name in names]
    if was.is_study:
        return [*changes, *_figures(was, now, demand)]
    with_marginals = since is None and demand.agreement < Agreement.TOLERANCE
    marginals = _marginals(was, now, demand) if with_marginals else ()
    return [*changes, _frames(was, now, since or 0), _poses(was, now, place, demand), *marginals]


def number_of(name: str, run: Run) -> float | None:
    """Return the run's number of this name, or the mean over frames of what is recorded of frames alone, or None."""
    return _number(_quantities(run, None).get(name, (None, None)))


def _number(quantity: _Quantity) -> float | None:
    value, curve = quantity
    return value if value is not None or curve is None else float(curve[1].mean())


def _quantities(run: Run, since: int | None) -> dict[str, _Quantity]:
    """Return the run's metrics by name; since: the first frame that counts, where the run's own numbers do not."""
    results = {name: float(value) for name, value in run.result.items()} if since is None else {}
    curves = {name: run.metric(name) for name in run.metrics}
    if since is not None:
        late = {name: frames >= since for name, (frames, _) in curves.items()}
        curves = {name: (curves[name][0][kept], curves[name][1][kept]) for name, kept in late.items() if kept.any()}
    return {name: (results.get(name), curves.get(name)) for name in results.keys() | curves.keys()}


def _metric(name: str, was: _Quantity, now: _Quantity, demand: Demand, place: str) -> MetricChange:
    """Judge the run's number and, unless tolerances are demanded, those of every frame."""
    before, after, tolerance = _number(was), _number(now), demand.of(name)
    detail = ""
    if now == (None, None):
        detail, class_ = "missing", Agreement.CHANGED
    elif was == (None, None):
        return MetricChange(name, None, after, demand.words(name), True, "new")
    elif [each is None for each in was] != [each is None for each in now]:
        detail, class_ = "missing as the run's number or over frames", Agreement.CHANGED
    elif before is not None and after is not None and np.isfinite([before, after]).all():
        class_ = agreement(before, after, tolerance)
    else:
        class_ = Agreement.CHANGED
    (_, first), (_, second) = was, now
    if first is not None and second is not None:
        if demand.agreement < Agreement.TOLERANCE:
            frames, old, new = _common(first, second)
            class_ = max(class_, Agreement.CHANGED if len(frames) < len(first[0]) else agreement(old, new, tolerance))
        if class_ > demand.agreement:
            detail = detail or _first_odd(first, second, demand, tolerance)
    return _change(name, before, after, demand, class_, detail or place)


def _change(
    name: str, was: float | None, now: float | None, demand: Demand, class_: Agreement, detail: str, key: str = ""
) -> MetricChange:
    """Return a change of this class; detail: of one that fails; key: under which its tolerance is, if not its name."""
    passed = class_ <= demand.agreement
    return MetricChange(name, was, now, demand.words(key or name), passed, "" if passed else detail, class_)


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


def _marginals(was: Run, now: Run, demand: Demand) -> Iterator[MetricChange]:
    before, after = was.marginals, now.marginals
    if before is not None and after is not None and before.names == after.names:
        class_ = max(agreement(getattr(before, key), getattr(after, key)) for key in ("low", "high", "log_mass"))
        yield _change("marginals", None, None, demand, class_, "they differ")
    elif before is not None:
        yield _failed("marginals", demand.words("marginals"), "missing, or of other parameters")


def _figures(was: Run, now: Run, demand: Demand) -> Iterator[MetricChange]:
    """Compare a study's figures number by number."""
    after = {figure.name: numbers(figure) for figure in now.figures}
    for figure in was.figures:
        name = f"figure {figure.name}"
        key = name if name in demand.tolerances else "figures"
        if figure.name not in after:
            yield _failed(name, demand.words(key), "missing")
            continue
        old, new, tolerance = numbers(figure), after[figure.name], demand.of(key)
        classes = {part: agreement(old.get(part), new.get(part), tolerance) for part in {**old, **new}}
        class_ = max(classes.values(), default=Agreement.IDENTICAL)
        odd = next((part for part, each in classes.items() if each is class_), "")
        yield _change(name, None, None, demand, class_, f"{odd} differs", key)
