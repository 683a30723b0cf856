"""The outcome of a run in a word and a sentence: held, lost, or why its numbers are not to be trusted.

Where there is a ground truth, it decides: an estimate is held while it lies on the person. In any case the inputs are
compared with what the frames show, and what does not fit together comes first. Thresholds are the width of a forearm,
or the differences between people and detectors that are given with each number; none was fitted to failed runs.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.body.shape import from_height
from workbench.evaluation.evidence import RunMeasurements
from workbench.evaluation.multiview_consistency import bends, limb_lengths
from workbench.utils.arrays import BoolArray, FloatArray

WINDOW = 5
"""Frames over which an error is averaged, so that a single one neither loses nor finds anybody; as in `held`."""
FOREARM = 0.044
"""A forearm's width over a person's height, the mean of the two ends of `from_height`: the yardstick of `held`."""
HELD_MM = 150.0
"""Points are held where joints are off by less than this in the last frames: half a head, see the README."""
_LENGTH_OFF = 0.10
"""Tolerance of a height against that of the limbs measured: twice the 5 % by which a length over the height differs
between people and detectors' joints from anatomists' (`limb_lengths.PROPORTION_SIGMA`)."""
_LIMB_OFF = 0.20
"""The same of a single limb over the others: three deviations, and what a detector's joint is off."""
_MOST_JUMP = 5.0
"""Times what the keypoints move in the frames about. Of accelerations that legs and arms are capable of, even a kick at
30 Hz stays below twice."""
_JUMP_FRAMES = 10
_LEAST_GAP_S = 0.25
"""A gap worth reporting, in keypoints that are otherwise there in every frame: half a step of a walk."""
_FEW_JOINTS = 0.5
"""Fraction of the 14 joints without the pelvis that must be seen in some frame."""
_MOST_FAR = 0.5
"""Observations that may lie far from the body: with more, most say that the person is elsewhere."""
_LEAST_BENDS = 10
_RATE_OFF = 0.02


@dataclass(frozen=True)
class Event:
    """frame: the place in the sequence of the first frame from which on the person was lost, or was held again."""

    kind: str
    frame: int


def lost_and_found(errors: Sequence[float], thresholds: Sequence[float], window: int = WINDOW) -> list[Event]:
    """Return the events "lost" and "found", which alternate, of errors and their thresholds (F,), in one unit.

    Lost: the mean error over `window` frames reaches the mean threshold; the event is the first of these frames that
    does, after the last event. Found: it is below again. Errors that are not known (NaN) say nothing. A run that begins
    lost loses in 0.
    """
    apart = np.asarray(errors, dtype=np.float64) - np.asarray(thresholds, dtype=np.float64)
    places = np.flatnonzero(np.isfinite(apart))
    events: list[Event] = []
    last = -1
    for end in range(max(1, min(window, len(places))), len(places) + 1):
        among = places[max(0, end - window) : end]
        lost = bool(apart[among].mean() >= 0.0)
        crossed = among[((apart[among] >= 0.0) == lost) & (among > last)]
        if lost is (len(events) % 2 == 0) and len(crossed):
            last = int(crossed[0])
            events.append(Event("lost" if lost else "found", last))
    return events


def lost_share(errors: Sequence[float], thresholds: Sequence[float], window: int = WINDOW) -> float:
    """Return the part of the frames that lie between a loss and the next find, or the end."""
    marks = [event.frame for event in lost_and_found(errors, thresholds, window)]
    ends = [*marks, len(errors)] if len(marks) % 2 else marks
    return float(np.diff(np.array(ends).reshape(-1, 2), axis=1).sum()) / max(len(errors), 1)


@dataclass(frozen=True)
class RunInputs:
    """What a run was given. height_m: the person's. max_iterations: of a fit. rate_hz, source_rate_hz: of the frames,
    and what their source's file says. seen: whether the dataset shows the person at all."""

    height_m: float | None = None
    max_iterations: float | None = None
    rate_hz: float | None = None
    source_rate_hz: float | None = None
    seen: bool = True


@dataclass(frozen=True)
class Finding:
    """kind: "held", "lost", "no truth", "not seen", or what does not fit together: "cameras disagree", "height",
    "limb lengths", "left and right", "rate", "frames missing", "too few observations", "far from what is seen", "not
    converged". sentence: what was found, with its numbers."""

    kind: str
    sentence: str


@dataclass(frozen=True)
class Verdict:
    """findings: what does not fit together, the worst first. outcome: what became of the person. states: by frame of
    the run (F,), "held", "lost", "not known" where that frame has no errors, or "" where none has."""

    findings: tuple[Finding, ...]
    outcome: Finding
    states: tuple[str, ...]

    @property
    def kind(self) -> str:
        """The worst finding's kind, or else the outcome's."""
        return self.findings[0].kind if self.findings else self.outcome.kind

    @property
    def sentence(self) -> str:
        """The worst finding, then the outcome, then what else was found."""
        ordered = (*self.findings[:1], self.outcome, *self.findings[1:])
        return "; ".join(f"{each.kind}: {each.sentence}" for each in ordered)

    @property
    def as_dict(self) -> dict[str, Any]:
        """As JSON takes it, without the states."""
        found = [{"kind": each.kind, "sentence": each.sentence} for each in (*self.findings, self.outcome)]
        return {"kind": self.kind, "sentence": self.sentence, "found": found}


def verdict(measured: RunMeasurements, inputs: RunInputs) -> Verdict:
    """Return the verdict on a run from its measurements and inputs."""
    outcome, states = _outcome(measured, inputs)
    return Verdict(tuple(_findings(measured, inputs)), outcome, states)


def _outcome(measured: RunMeasurements, inputs: RunInputs) -> tuple[Finding, tuple[str, ...]]:
    """Return whether the person was tracked, by the ground truth or else by the keypoints, and the states (F,)."""
    errors, n = measured.errors, len(measured.frames)
    numbers, marked = _numbers(measured), _by_marks(measured)
    if {"error_px", "forearm_px"} <= errors.keys():
        return _held(measured, errors["error_px"], errors["forearm_px"], numbers)
    if "error_abs_mm" in errors:
        return _held(measured, errors["error_abs_mm"], np.full(n, HELD_MM), numbers)
    if measured.has_keypoints:
        off, width = _worst_view(measured.off_px), FOREARM * _worst_view(measured.height_px)
        found, states = _held(measured, off, width, "")
        by = "; ".join(filter(None, (_by_camera(measured), marked)))
        if found.kind == "lost":
            return Finding("lost", f"{found.sentence}; {by}"), states
        return Finding("no truth", by), states
    states = ("",) * n
    if marked:
        return Finding("no truth", marked), states
    if not inputs.seen:
        return Finding("not seen", "no frame shows anybody: this is what the prior makes up"), states
    if measured.has_points:
        near = f": {np.nanmean(measured.inliers):.0%} of them lie near the body" if _any(measured.inliers) else ""
        return Finding("no truth", f"only the points themselves to measure by{near}"), states
    return Finding("no truth", "nothing to measure by: whether the person was held only the images show"), states


def _held(
    measured: RunMeasurements, errors: FloatArray, widths: FloatArray, numbers: str
) -> tuple[Finding, tuple[str, ...]]:
    """Classify frames as held or lost by errors and thresholds (F,) of one unit, except the first, which is given."""
    frames, n = measured.frames[1:], max(len(errors) - 1, 0)
    with_comma = f", {numbers}" if numbers else ""
    if not _any(errors[1:]):
        return Finding("no truth", f"one frame, which is given{with_comma}"), ("",) * len(errors)
    events = lost_and_found(errors[1:].tolist(), widths[1:].tolist())
    states, state, marks = [], "held", {event.frame: event.kind for event in events}
    for k in range(n):
        state = {"lost": "lost", "found": "held"}.get(marks.get(k, ""), state)
        states.append(state if np.isfinite(errors[k + 1]) else "not known")
    all_states = ("held", *states)
    if not events:
        return Finding("held", f"in all {n} frames after the first{with_comma}"), all_states
    first = f"from frame {frames[events[0].frame]}"
    if events[-1].kind == "found":
        first += f", held again from frame {frames[events[-1].frame]}"
    share = states.count("lost") / max(n, 1)
    return Finding("lost", f"{first}, {share:.0%} of the frames{with_comma}"), all_states


def _numbers(measured: RunMeasurements) -> str:
    """The few numbers that matter, with units."""
    forms = {"error_abs_mm": "MPJPE {:.0f} mm", "error_procrustes_mm": "PA-MPJPE {:.0f} mm", "error_px": "{:.1f} px"}
    known = {name: measured.errors[name][1:] for name in forms if name in measured.errors}
    return ", ".join(forms[name].format(float(np.nanmean(each))) for name, each in known.items() if _any(each))


def _by_marks(measured: RunMeasurements) -> str:
    """Describe the distance from annotated joints after the first frame, from whose a run may start; "" for none."""
    px, heights = measured.errors.get("error_px", np.full(1, np.nan))[1:], measured.mark_height_px[1:]
    if not _any(px):
        return ""
    tall = np.isfinite(px) & np.isfinite(heights) & (heights > 0.0)
    share = f", {np.mean(px[tall] / heights[tall]):.1%} of the person's height" if tall.any() else ""
    return f"{np.nanmean(px):.1f} px from the joints marked in {int(np.isfinite(px).sum())} frames{share}"


def _by_camera(measured: RunMeasurements) -> str:
    """Describe the distances from the keypoints by camera, and over the person's height."""
    off, heights = measured.off_px, measured.height_px
    named = [f"{name} {np.nanmean(off[:, v]):.1f}" for v, name in enumerate(measured.cameras) if _any(off[:, v])]
    relative = float(np.nanmedian(off / np.where(heights > 0.0, heights, np.nan)))
    apart = f" ({', '.join(named)})" if len(named) > 1 else ""
    n = int(np.isfinite(off).any(axis=1).sum())
    return (
        f"joints {np.nanmean(off):.1f} px from the keypoints{apart}, {relative:.1%} of the person's height, in {n} of "
        f"{len(off)} frames"
    )


def _findings(measured: RunMeasurements, inputs: RunInputs) -> Iterator[Finding]:
    """Yield what does not fit together, the worst first."""
    yield from _cameras(measured)
    n_seen, n_joints = int(measured.marked[1:].sum()), len(measured.marked) - 1
    if measured.has_keypoints and n_seen < _FEW_JOINTS * n_joints:
        made_up = f"only {n_seen} of {n_joints} joints are seen in any frame, the others are made up"
        yield Finding("too few observations", made_up)
    bent = bends(measured.joints)
    if len(bent) >= _LEAST_BENDS and (share := float((bent < 0.0).mean())) > 0.5:
        legs = f"{share:.0%} of {len(bent)} bent legs"
        yield Finding("left and right", f"exchanged, or knees bend the wrong way, in {legs}")
    yield from _height(measured, inputs.height_m)
    yield from _limbs(measured)
    rate_hz, own_hz = inputs.rate_hz, inputs.source_rate_hz
    if rate_hz and own_hz and abs(np.log(rate_hz / own_hz)) > _RATE_OFF:
        yield Finding("rate", f"{rate_hz:g} frames a second told, {own_hz:g} by the file: times and speeds are off")
    if measured.has_keypoints:
        yield from _missing(measured)
    if _any(measured.inliers) and (near := float(np.nanmean(measured.inliers))) < _MOST_FAR:
        yield Finding("far from what is seen", f"only {near:.0%} of the observations lie near the body")
    if inputs.max_iterations and measured.iterations >= inputs.max_iterations:
        used = f"all {inputs.max_iterations:g} iterations are used"
        yield Finding("not converged", f"{used}; inference.max_iterations allows more")


def _cameras(measured: RunMeasurements) -> Iterator[Finding]:
    """Yield the cameras that do not see what the others see."""
    if len(measured.cameras) < 2:
        return
    expected, found = measured.expected.sum(axis=0), (measured.expected & measured.found).sum(axis=0)
    blind = [
        f"{name} shows the person in {found[v]} of {expected[v]} frames"
        for v, name in enumerate(measured.cameras)
        if measured.has_keypoints and expected[v] >= WINDOW and found[v] < 0.5 * expected[v]
    ]
    pairs = [
        f"rays of {first} and {second} pass each other by {np.nanmedian(apart):.0%} of the person's height{since}"
        for (first, second), apart in measured.apart.items()
        if (since := _since(measured, apart)) is not None
    ]
    if blind or pairs:
        more = [f"and {len(pairs) - 2} more pairs"] if len(pairs) > 2 else []
        yield Finding("cameras disagree", ", ".join([*blind, *pairs[:2], *more]))


def _since(measured: RunMeasurements, apart: FloatArray) -> str | None:
    """Return from which frame on a pair of cameras disagrees, "" where from the first; None where it does not."""
    events = lost_and_found(apart.tolist(), [FOREARM] * len(apart))
    if not events:
        return None
    first = events[0].frame
    return f" from frame {measured.frames[first]} on" if first > 0 else ""


def _height(measured: RunMeasurements, height_m: float | None) -> Iterator[Finding]:
    """Compare the given height, or that of the body tracked, with the one at which the limbs measured are usual."""
    lengths = limb_lengths(measured.joints)
    if len(lengths) < len(measured.lengths_m):  # one camera measures no lengths
        return
    usual = usual_height(lengths)
    height = height_m or usual_height(measured.lengths_m)
    if abs(np.log(height / usual)) > np.log1p(_LENGTH_OFF):
        limbs = ", ".join(f"{_words(limb)} {100.0 * length:.0f}" for limb, length in lengths.items())
        yield Finding("height", f"{height:.2f} m told, {usual:.2f} m by the limbs that the cameras see ({limbs} cm)")


def _limbs(measured: RunMeasurements) -> Iterator[Finding]:
    """Compare the body's limbs, and those that cameras measure, with those of people of their height."""
    for lengths, whose in ((measured.lengths_m, "the body has"), (limb_lengths(measured.joints), "the cameras see")):
        if len(lengths) < len(measured.lengths_m):
            continue
        height = usual_height(lengths)
        usual = from_height(height)
        for limb, length in lengths.items():
            expected = float(getattr(usual, limb))
            if abs(np.log(length / expected)) > np.log1p(_LIMB_OFF):
                found, normal = f"{100.0 * length:.0f} cm", f"{100.0 * expected:.0f} cm (of {height:.2f} m)"
                yield Finding("limb lengths", f"{whose} a {_words(limb)} of {found}, usual are {normal}")
                return


def usual_height(lengths: Mapping[str, float]) -> float:
    """Return the height, m, of an average person with limbs (m, by name) as long, the mean over their logarithms."""
    unit = from_height(1.0)
    return float(np.exp(np.mean([np.log(length / getattr(unit, limb)) for limb, length in lengths.items()])))


def _missing(measured: RunMeasurements) -> Iterator[Finding]:
    """Yield stretches of frames without keypoints, and jumps of the keypoints."""
    empty: BoolArray = ~np.any(measured.found, axis=1)
    if np.median(np.diff(np.flatnonzero(~empty), prepend=-1)) <= 1.0:  # marks in a few frames are no gaps
        for first, last in _runs(empty):
            end = min(last + 1, len(empty) - 1)
            if (seconds := measured.times_s[end] - measured.times_s[first]) >= _LEAST_GAP_S:
                where = f"frames {measured.frames[first]} to {measured.frames[last]}"
                yield Finding("frames missing", f"nothing is seen in {where}, {seconds:.2g} s")
    jumps = _jumps(measured.moved)
    if len(jumps):
        at, more = jumps[0], f" and {len(jumps) - 1} times more" if len(jumps) > 1 else ""
        moved = f"by {measured.moved[at]:.0%} of the person's height"
        where = f"from frame {measured.frames[at - 1]} to {measured.frames[at]}"
        yield Finding("frames missing", f"what is seen jumps {moved} {where}{more}")


def _jumps(moved: FloatArray) -> list[int]:
    """Find frames (F,) in which the keypoints move _MOST_JUMP times as far as about it, and by more than a forearm."""
    found = []
    for t in np.flatnonzero(np.nan_to_num(moved) > FOREARM):
        about = np.delete(moved[max(t - _JUMP_FRAMES, 0) : t + _JUMP_FRAMES + 1], min(int(t), _JUMP_FRAMES))
        if np.isfinite(about).sum() >= WINDOW and moved[t] > _MOST_JUMP * np.nanmedian(about):
            found.append(int(t))
    return found


def _worst_view(table: FloatArray) -> FloatArray:
    """Return the mean (F,) over views (F, V), NaN where none is known."""
    known = np.isfinite(table)
    total = np.where(known, table, 0.0).sum(axis=1)
    return np.where(known.any(axis=1), total / np.maximum(known.sum(axis=1), 1), np.nan)


def _runs(chosen: BoolArray) -> list[tuple[int, int]]:
    """Return the first and last place of every run of True in (F,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(np.int8)))
    return [(int(first), int(end) - 1) for first, end in zip(edges[::2], edges[1::2], strict=True)]


def _any(values: FloatArray) -> bool:
    return bool(np.isfinite(values).any())


def _words(name: str) -> str:
    return name.replace("_", " ")
