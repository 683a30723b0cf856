"""The verdict on a run: tracked, lost, or the reason why its numbers are not to be trusted.

A ground truth decides where there is one: a person is tracked while the estimate's error is below a threshold. In any
case the configured inputs are compared with the measurements, and inconsistencies come first. Thresholds are the width
of a forearm, or published differences between people and detectors; none was fitted to failed runs.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.body.shape import from_height
from workbench.evaluation.multiview_consistency import bends, limb_lengths
from workbench.evaluation.run_measurements import RunMeasurements
from workbench.evaluation.track_loss import WINDOW_FRAMES, track_events
from workbench.utils.arrays import BoolArray, FloatArray

FOREARM_OVER_HEIGHT = 0.044
"""A forearm's width over a person's height, the mean of the two ends of `from_height`: the threshold of a track."""
TRACKED_MM = 150.0
"""Threshold of the mean joint error of a track without images: half a head, see the README."""
_HEIGHT_TOLERANCE = 0.10
"""Tolerance of a height against that of the measured limbs: twice the 5 % by which a length over the height differs
between people and detectors' joints from anatomists' (`limb_lengths.PROPORTION_SIGMA`)."""
_LIMB_TOLERANCE = 0.20
"""Tolerance of a single limb against the others: three deviations, and the error of a detector's joint."""
_MAX_JUMP = 5.0
"""Times the motion of the keypoints in the frames around. Even a kick at 30 Hz stays below twice, by the accelerations
that legs and arms are capable of."""
_JUMP_FRAMES = 10
_MIN_GAP_S = 0.25
"""Shortest reported gap in keypoints that are otherwise there in every frame: half a step of a walk."""
_MIN_OBSERVED_JOINTS = 0.5
"""Fraction of the 14 joints without the pelvis that must be observed in some frame."""
_MIN_INLIERS = 0.5
"""Fraction of the observations that must lie near the body; with fewer, most show the person elsewhere."""
_MIN_BENT_LEGS = 10
_RATE_TOLERANCE = 0.02


@dataclass(frozen=True)
class RunInputs:
    """Configured inputs of a run.

    height_m: the person's. max_iterations: of a fit. rate_hz, source_rate_hz: configured rate of the frames, and the
    rate in their source's file. shows_person: the dataset has observations of the person.
    """

    height_m: float | None = None
    max_iterations: float | None = None
    rate_hz: float | None = None
    source_rate_hz: float | None = None
    shows_person: bool = True


@dataclass(frozen=True)
class Finding:
    """An outcome or an inconsistency.

    kind: an outcome, "tracked", "lost", "no ground truth" or "no person visible"; or an inconsistency, "inconsistent
    cameras", "height mismatch", "implausible limb lengths", "left–right swap", "frame-rate mismatch", "missing frames
    or jumps", "too few observations", "observations far from the body" or "not converged". message: details with
    numbers.
    """

    kind: str
    message: str


@dataclass(frozen=True)
class Verdict:
    """The verdict on a run.

    findings: inconsistencies, the worst first. outcome: whether the person was tracked. states: (F,) by frame,
    "tracked", "lost", "not known" in a frame without errors, or "" in a run without errors.
    """

    findings: tuple[Finding, ...]
    outcome: Finding
    states: tuple[str, ...]

    @property
    def kind(self) -> str:
        """The worst finding's kind, or else the outcome's."""
        return self.findings[0].kind if self.findings else self.outcome.kind

    @property
    def message(self) -> str:
        """The worst finding, then the outcome, then the other findings."""
        ordered = (*self.findings[:1], self.outcome, *self.findings[1:])
        return "; ".join(f"{each.kind}: {each.message}" for each in ordered)

    @property
    def as_dict(self) -> dict[str, Any]:
        """The verdict without the states, for JSON."""
        findings = [{"kind": each.kind, "message": each.message} for each in (*self.findings, self.outcome)]
        return {"kind": self.kind, "message": self.message, "findings": findings}


def verdict(measured: RunMeasurements, inputs: RunInputs) -> Verdict:
    """Return the verdict on a run from its measurements and inputs."""
    outcome, states = _outcome(measured, inputs)
    return Verdict(tuple(_findings(measured, inputs)), outcome, states)


def _outcome(measured: RunMeasurements, inputs: RunInputs) -> tuple[Finding, tuple[str, ...]]:
    """Return whether the person was tracked, by the ground truth or else by the keypoints, and the states (F,)."""
    errors, n = measured.errors, len(measured.frames)
    numbers, by_annotations = _numbers(measured), _annotation_error(measured)
    if {"mpjpe_px", "forearm_width_px"} <= errors.keys():
        return _tracked(measured, errors["mpjpe_px"], errors["forearm_width_px"], numbers)
    if "mpjpe_abs_mm" in errors:
        return _tracked(measured, errors["mpjpe_abs_mm"], np.full(n, TRACKED_MM), numbers)
    if measured.has_keypoints:
        error_px = _mean_over_views(measured.keypoint_error_px)
        width_px = FOREARM_OVER_HEIGHT * _mean_over_views(measured.person_height_px)
        outcome, states = _tracked(measured, error_px, width_px, "")
        details = "; ".join(filter(None, (_keypoint_error(measured), by_annotations)))
        if outcome.kind == "lost":
            return Finding("lost", f"{outcome.message}; {details}"), states
        return Finding("no ground truth", details), states
    states = ("",) * n
    if by_annotations:
        return Finding("no ground truth", by_annotations), states
    if not inputs.shows_person:
        return Finding("no person visible", "no frame shows a person: the estimate is drawn from the prior"), states
    if measured.has_points:
        inliers = measured.inlier_fraction
        near = f": {np.nanmean(inliers):.0%} of them lie near the body" if _any(inliers) else ""
        return Finding("no ground truth", f"only the points themselves to compare with{near}"), states
    return Finding("no ground truth", "nothing to compare with: look at the images to see a loss"), states


def _tracked(
    measured: RunMeasurements, errors: FloatArray, thresholds: FloatArray, numbers: str
) -> tuple[Finding, tuple[str, ...]]:
    """Classify the frames after the first, whose pose may be given, by errors and thresholds (F,) in one unit."""
    frames, n = measured.frames[1:], max(len(errors) - 1, 0)
    with_comma = f", {numbers}" if numbers else ""
    if not _any(errors[1:]):
        return Finding("no ground truth", f"only one frame, whose pose is given{with_comma}"), ("",) * len(errors)
    events = track_events(errors[1:].tolist(), thresholds[1:].tolist())
    states, state, kinds = [], "tracked", {event.frame: event.kind for event in events}
    for k in range(n):
        state = {"lost": "lost", "recovered": "tracked"}.get(kinds.get(k, ""), state)
        states.append(state if np.isfinite(errors[k + 1]) else "not known")
    all_states = ("tracked", *states)
    if not events:
        return Finding("tracked", f"in all {n} frames after the first{with_comma}"), all_states
    first = f"from frame {frames[events[0].frame]}"
    if events[-1].kind == "recovered":
        first += f", recovered from frame {frames[events[-1].frame]}"
    fraction = states.count("lost") / max(n, 1)
    return Finding("lost", f"{first}, {fraction:.0%} of the frames{with_comma}"), all_states


def _numbers(measured: RunMeasurements) -> str:
    """Return the mean errors after the first frame in words, with units."""
    forms = {"mpjpe_abs_mm": "absolute MPJPE {:.0f} mm", "pa_mpjpe_mm": "PA-MPJPE {:.0f} mm", "mpjpe_px": "{:.1f} px"}
    errors = {name: measured.errors[name][1:] for name in forms if name in measured.errors}
    return ", ".join(forms[name].format(float(np.nanmean(each))) for name, each in errors.items() if _any(each))


def _annotation_error(measured: RunMeasurements) -> str:
    """Describe the distance from annotated joints after the first frame, whose annotations may start a run; or ""."""
    px, heights = measured.errors.get("mpjpe_px", np.full(1, np.nan))[1:], measured.annotation_height_px[1:]
    if not _any(px):
        return ""
    valid = np.isfinite(px) & np.isfinite(heights) & (heights > 0.0)
    relative = f", {np.mean(px[valid] / heights[valid]):.1%} of the person's height" if valid.any() else ""
    return f"{np.nanmean(px):.1f} px from the joints annotated in {int(np.isfinite(px).sum())} frames{relative}"


def _keypoint_error(measured: RunMeasurements) -> str:
    """Describe the distances from the keypoints by camera, and over the person's height."""
    px, heights = measured.keypoint_error_px, measured.person_height_px
    each = [f"{name} {np.nanmean(px[:, v]):.1f}" for v, name in enumerate(measured.cameras) if _any(px[:, v])]
    relative = float(np.nanmedian(px / np.where(heights > 0.0, heights, np.nan)))
    by_camera = f" ({', '.join(each)})" if len(each) > 1 else ""
    n = int(np.isfinite(px).any(axis=1).sum())
    return (
        f"joints {np.nanmean(px):.1f} px from the keypoints{by_camera}, {relative:.1%} of the person's height, in {n} "
        f"of {len(px)} frames"
    )


def _findings(measured: RunMeasurements, inputs: RunInputs) -> Iterator[Finding]:
    """Yield the inconsistencies, the worst first."""
    yield from _cameras(measured)
    n_observed, n_joints = int(measured.observed_joints[1:].sum()), len(measured.observed_joints) - 1
    if measured.has_keypoints and n_observed < _MIN_OBSERVED_JOINTS * n_joints:
        message = f"only {n_observed} of {n_joints} joints are observed in any frame, the others follow the prior"
        yield Finding("too few observations", message)
    bent = bends(measured.triangulated_joints)
    if len(bent) >= _MIN_BENT_LEGS and (backwards := float((bent < 0.0).mean())) > 0.5:
        legs = f"{backwards:.0%} of {len(bent)} bent legs"
        yield Finding("left–right swap", f"left and right are exchanged, or knees bend the wrong way, in {legs}")
    yield from _height(measured, inputs.height_m)
    yield from _limbs(measured)
    rate_hz, file_hz = inputs.rate_hz, inputs.source_rate_hz
    if rate_hz and file_hz and abs(np.log(rate_hz / file_hz)) > _RATE_TOLERANCE:
        message = f"{rate_hz:g} Hz configured, {file_hz:g} Hz in the file: times and speeds are wrong"
        yield Finding("frame-rate mismatch", message)
    if measured.has_keypoints:
        yield from _missing(measured)
    inliers = measured.inlier_fraction
    if _any(inliers) and (near := float(np.nanmean(inliers))) < _MIN_INLIERS:
        yield Finding("observations far from the body", f"only {near:.0%} of the observations lie near the body")
    if inputs.max_iterations and measured.iterations >= inputs.max_iterations:
        used = f"all {inputs.max_iterations:g} iterations are used"
        yield Finding("not converged", f"{used}; increase inference.max_iterations")


def _cameras(measured: RunMeasurements) -> Iterator[Finding]:
    """Yield the cameras that contradict the others."""
    if len(measured.cameras) < 2:
        return
    in_image, has_person = measured.in_image.sum(axis=0), (measured.in_image & measured.has_person).sum(axis=0)
    blind = [
        f"{name} shows the person in {has_person[v]} of {in_image[v]} frames"
        for v, name in enumerate(measured.cameras)
        if measured.has_keypoints and in_image[v] >= WINDOW_FRAMES and has_person[v] < 0.5 * in_image[v]
    ]
    pairs = [
        f"rays of {first} and {second} miss each other by {np.nanmedian(separation):.0%} of the person's height{since}"
        for (first, second), separation in measured.ray_separation.items()
        if (since := _since(measured, separation)) is not None
    ]
    if blind or pairs:
        more = [f"and {len(pairs) - 2} more pairs"] if len(pairs) > 2 else []
        yield Finding("inconsistent cameras", ", ".join([*blind, *pairs[:2], *more]))


def _since(measured: RunMeasurements, separation: FloatArray) -> str | None:
    """Return from which frame on a pair of cameras disagrees, "" where from the first; None where it does not."""
    events = track_events(separation.tolist(), [FOREARM_OVER_HEIGHT] * len(separation))
    if not events:
        return None
    first = events[0].frame
    return f" from frame {measured.frames[first]} on" if first > 0 else ""


def _height(measured: RunMeasurements, height_m: float | None) -> Iterator[Finding]:
    """Compare the configured height, or the tracked body's, with the usual height for the triangulated limbs."""
    lengths = limb_lengths(measured.triangulated_joints)
    if len(lengths) < len(measured.lengths_m):  # one camera measures no lengths
        return
    usual = usual_height(lengths)
    height = height_m or usual_height(measured.lengths_m)
    if abs(np.log(height / usual)) > np.log1p(_HEIGHT_TOLERANCE):
        limbs = ", ".join(f"{_words(limb)} {100.0 * length:.0f}" for limb, length in lengths.items())
        message = f"{height:.2f} m configured, {usual:.2f} m by the triangulated limbs ({limbs} cm)"
        yield Finding("height mismatch", message)


def _limbs(measured: RunMeasurements) -> Iterator[Finding]:
    """Compare the body's limbs, and the triangulated ones, with those of people of their height."""
    triangulated = limb_lengths(measured.triangulated_joints)
    for lengths, source in ((measured.lengths_m, "the body has"), (triangulated, "the cameras measure")):
        if len(lengths) < len(measured.lengths_m):
            continue
        height = usual_height(lengths)
        usual = from_height(height)
        for limb, length in lengths.items():
            expected = float(getattr(usual, limb))
            if abs(np.log(length / expected)) > np.log1p(_LIMB_TOLERANCE):
                actual, normal = f"{100.0 * length:.0f} cm", f"{100.0 * expected:.0f} cm (of {height:.2f} m)"
                message = f"{source} a {_words(limb)} of {actual}, usual are {normal}"
                yield Finding("implausible limb lengths", message)
                return


def usual_height(lengths: Mapping[str, float]) -> float:
    """Return the height, m, of an average person with limbs (m, by name) as long, the mean over their logarithms."""
    unit = from_height(1.0)
    return float(np.exp(np.mean([np.log(length / getattr(unit, limb)) for limb, length in lengths.items()])))


def _missing(measured: RunMeasurements) -> Iterator[Finding]:
    """Yield stretches of frames without keypoints, and jumps of the keypoints."""
    empty: BoolArray = ~np.any(measured.has_person, axis=1)
    if np.median(np.diff(np.flatnonzero(~empty), prepend=-1)) <= 1.0:  # keypoints in a few frames have no gaps
        for first, last in _stretches(empty):
            end = min(last + 1, len(empty) - 1)
            if (seconds := measured.times_s[end] - measured.times_s[first]) >= _MIN_GAP_S:
                where = f"frames {measured.frames[first]} to {measured.frames[last]}"
                yield Finding("missing frames or jumps", f"no keypoints in {where}, {seconds:.2g} s")
    jumps = _jumps(measured.keypoint_motion)
    if len(jumps):
        at, more = jumps[0], f" and {len(jumps) - 1} times more" if len(jumps) > 1 else ""
        moved = f"by {measured.keypoint_motion[at]:.0%} of the person's height"
        where = f"from frame {measured.frames[at - 1]} to {measured.frames[at]}"
        yield Finding("missing frames or jumps", f"the keypoints jump {moved} {where}{more}")


def _jumps(motion: FloatArray) -> list[int]:
    """Return the frames whose motion (F,) is _MAX_JUMP times the median around them, and more than a forearm."""
    jumps = []
    for t in np.flatnonzero(np.nan_to_num(motion) > FOREARM_OVER_HEIGHT):
        around = np.delete(motion[max(t - _JUMP_FRAMES, 0) : t + _JUMP_FRAMES + 1], min(int(t), _JUMP_FRAMES))
        if np.isfinite(around).sum() >= WINDOW_FRAMES and motion[t] > _MAX_JUMP * np.nanmedian(around):
            jumps.append(int(t))
    return jumps


def _mean_over_views(table: FloatArray) -> FloatArray:
    """Return the mean (F,) over views (F, V), NaN ignored, NaN where all are."""
    valid = np.isfinite(table)
    total = np.where(valid, table, 0.0).sum(axis=1)
    return np.where(valid.any(axis=1), total / np.maximum(valid.sum(axis=1), 1), np.nan)


def _stretches(chosen: BoolArray) -> list[tuple[int, int]]:
    """Return the first and last index of every stretch of True in (F,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(np.int8)))
    return [(int(first), int(end) - 1) for first, end in zip(edges[::2], edges[1::2], strict=True)]


def _any(values: FloatArray) -> bool:
    return bool(np.isfinite(values).any())


def _words(name: str) -> str:
    return name.replace("_", " ")
