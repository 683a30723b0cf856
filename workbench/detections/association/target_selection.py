"""Selection of the target person among the people detected in all views."""

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.camera import Camera
from workbench.detections.association.assignment import Assignment, track
from workbench.detections.association.detector_view import detector_view, median_height, prominence
from workbench.detections.association.left_right import PARTS, exchanged_labels, with_corrected_labels
from workbench.detections.association.track_stitching import extended_backwards, stitched, without_short
from workbench.detections.readers.formats import LAYOUTS
from workbench.detections.readers.named_points import layout_joints
from workbench.detections.readers.people import People
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.frame_times import FrameTimes

log = logging.getLogger(__name__)

MOVING = "moving"
"""The person who is prominent and moves most in the image."""
Choice = int | str | Mapping[str, int] | None
"""Target: an index in the first camera's first frame with a detection, or indices in those of the cameras named."""

_LONG_GAP_S = 0.5
"""Gaps in the detections of a view above this duration are reported."""
_MIN_LOG_ODDS = np.log(20.0)
"""Assignments with lower log odds are reported as uncertain."""


@dataclass(frozen=True, eq=False)
class TargetPerson:
    """The target's detections.

    Parameters
    ----------
    frames : (T,) numbers of the frames, increasing.
    joints : (V, T, J, 3) by view, [u px, v px, confidence], with corrected left/right labels; NaN without a detection.
        (V, T, J, 6) with world landmarks, see `People`.
    counts : numbers of people, of frames without a detection of the target, and of arms and legs in views with
        exchanged left/right labels.
    """

    frames: IntArray
    joints: FloatArray
    counts: Mapping[str, int]


@dataclass(frozen=True, eq=False)
class _TrackedPeople:
    """All detections. names: of the V views. frames: (T,) numbers. joints: (n, J, 3) by frame and view. assigned: track
    numbers of the detections, by frame."""

    names: Sequence[str]
    frames: IntArray
    joints: Sequence[Sequence[FloatArray]]
    assigned: Sequence[Assignment]

    def of(self, number: int) -> FloatArray:
        """Return one person's joints (V, T, J, 3), or (V, T, J, 6) if all views have world landmarks."""
        width = min(rows.shape[2] for views in self.joints for rows in views if len(rows))
        joints = np.full((len(self.names), len(self.frames), len(JOINT_NAMES), width), np.nan)
        for t, frame in enumerate(self.assigned):
            for view, row in (place for place, track_number in frame.items() if track_number == number):
                joints[view, t] = self.joints[t][view][row, :, :width]
        return joints


def select_target(
    people: Mapping[str, People], cameras: Mapping[str, Camera] | None, rate_hz: float, person: Choice = None,
    within: tuple[int, int | None] = (0, None), uneven_s: FloatArray | None = None,
) -> TargetPerson:  # fmt: skip
    """Return the detections of the target person in synchronized views of one frame rate.

    Parameters
    ----------
    people : detections by view; with several views, a person is visible in at least two of them at once.
    cameras : of all views; None for a single view.
    rate_hz : frame rate.
    person : index of the target; None for the person in the first frame with a detection who is largest and most
        confidently detected over all frames and views.
    within : numbers of the first frame and of the last, None for the end.
    uneven_s : times of all frames, s, where they are not at a constant rate; see `FrameTimes`.

    Raises
    ------
    InputError
        Without any person, and for a target that is not detected in its view or in a second one.
    """
    frames = np.unique(np.concatenate([each.frames for each in people.values()]))
    frames = frames[(frames >= within[0]) & (frames <= (frames[-1] if within[1] is None else within[1]))]
    several = cameras if len(people) > 1 else None
    views = [detector_view(each, several[name] if several else None) for name, each in people.items()]
    joints = [[_in_frame(each, frame) for each in people.values()] for frame in frames]
    detections = [[list(map(v.detection, rows)) for v, rows in zip(views, each, strict=True)] for each in joints]
    times_s = FrameTimes(rate_hz, uneven_s).at(frames)
    tracks = without_short(track(views, detections, times_s))
    assigned = stitched(extended_backwards(views, detections, times_s, tracks), times_s)
    tracked = _TrackedPeople(list(people), frames, joints, assigned)
    target = tracked.of(_selected(tracked, person))
    detected = np.asarray(np.isfinite(target[..., 0]).any(axis=2), bool)  # (V, T)
    swapped = exchanged_labels(views, target, rate_hz) & detected[..., None]
    counts = {
        "people": len({number for frame in assigned for number in frame.values()}),
        "frames_unseen": int((~detected.any(axis=0)).sum()), "swapped_sides": int(swapped.sum()),
    }  # fmt: skip
    if counts["people"] > 1:
        share = f"{100.0 * detected.any(axis=0).mean():.0f} % of {len(frames)} frames"
        log.info("%s: %d people; the target is detected in %s", ", ".join(people), counts["people"], share)
        uncertain = tracks.log_odds[tracks.log_odds < _MIN_LOG_ODDS]
        if len(uncertain):
            odds = np.exp(max(uncertain.min(), 0))
            log.info("people may be exchanged in %d frames: odds %.1f to 1", len(uncertain), odds)
    _report_gaps(tracked, detected, rate_hz)
    _report_joints(people, target, swapped)
    return TargetPerson(frames, with_corrected_labels(target, swapped), counts)


def _in_frame(people: People, frame: int) -> FloatArray:
    """Return the joints (n, J, 3) of the people detected in a frame."""
    row = int(np.searchsorted(people.frames, frame))
    is_present = row < len(people.frames) and people.frames[row] == frame
    return people.joints[row] if is_present else np.empty((0, len(JOINT_NAMES), 3))


def _selected(tracked: _TrackedPeople, person: Choice) -> int:
    """Return the track number of the target."""
    first = next((frame for frame in tracked.assigned if frame), None)
    if first is None:
        several = "two cameras at once; check that the videos are synchronized and match the calibration"
        expected = several if len(tracked.names) > 1 else "the frames used"
        raise InputError(f"{', '.join(tracked.names)}: expected a person in {expected}")
    if person == MOVING:
        everyone = sorted({number for frame in tracked.assigned for number in frame.values()})
        return max(everyone, key=lambda number: _presence(tracked.of(number)) * (1.0 + _way(tracked.of(number))))
    if person is None:
        return max(sorted(set(first.values())), key=lambda number: _presence(tracked.of(number)))
    indices: dict[str, Any] = dict(person) if isinstance(person, Mapping) else {tracked.names[0]: person}
    is_valid = all(isinstance(row, int) and not isinstance(row, bool) for row in indices.values())
    if not is_valid or not indices or not set(indices) <= set(tracked.names):
        raise InputError(
            f"person: expected an index, or indices by some of {', '.join(tracked.names)}, found {person!r}; to track "
            "all people, sweep over the indices: workbench run -m dataset.person=0,1"
        )
    numbers = {_track_number(tracked, name, row) for name, row in indices.items()}
    if len(numbers) > 1:
        listed = ", ".join(f"{row} of {name}" for name, row in indices.items())
        raise InputError(f"person: expected indices of one person, found {len(numbers)} people: {listed}")
    return numbers.pop()


def _track_number(tracked: _TrackedPeople, name: str, row: int) -> int:
    """Return the track number of an index in a view's first frame with a detection."""
    view = list(tracked.names).index(name)
    t = next((t for t, views in enumerate(tracked.joints) if np.isfinite(views[view]).any()), None)
    if t is None:
        raise InputError(f"{name}: no person {row}: no person is detected in the frames used")
    frame, n = tracked.frames[t], len(tracked.joints[t][view])
    if not 0 <= row < n:
        raise InputError(f"{name}: no person {row} in frame {frame}, the first with detections; expected 0 to {n - 1}")
    if (view, row) not in tracked.assigned[t]:
        raise InputError(
            f"{name}: person {row} in frame {frame} cannot be tracked: no other camera detects this person then, or "
            "too few joints are detected; use the index in another camera, or another first_frame"
        )
    return tracked.assigned[t][view, row]


def _way(joints: FloatArray) -> float:
    """Return the largest distance of one person's joints (V, T, J, 3) from their first place, in heights."""
    largest = 0.0
    for view in joints[..., :2]:
        detected = view[np.isfinite(view[..., 0]).any(axis=1)]
        if len(detected):
            centres = np.nanmean(detected, axis=1)
            height = max(median_height(detected), 1.0)
            largest = max(largest, float(np.linalg.norm(centres - centres[0], axis=1).max()) / height)
    return largest


def _presence(joints: FloatArray) -> float:
    """Return the sum of confidence times height in the image over one person's joints (V, T, J, 3)."""
    detected = joints[np.isfinite(joints[..., 0]).any(axis=2)]
    return float(prominence(detected).sum())


def most_prominent(people: Iterable[People]) -> FloatArray:
    """Return the pixels (V, T, J, 2) of the most prominent person of every view and frame with people; NaN without."""
    views = tuple(people)
    frames = np.unique(np.concatenate([each.frames for each in views]))
    pixels = np.full((len(views), len(frames), len(JOINT_NAMES), 2), np.nan)
    for v, each in enumerate(views):
        for frame, joints in zip(each.frames, each.joints, strict=True):
            if len(joints):
                row = np.searchsorted(frames, frame)
                pixels[v, row] = joints[int(np.argmax(prominence(joints))), :, :2]
    return pixels


def _report_gaps(tracked: _TrackedPeople, detected: BoolArray, rate_hz: float) -> None:
    """Log long gaps of the target's detections (V, T)."""
    for name, in_view in zip(tracked.names, detected, strict=True):
        for is_gap, run in groupby(range(len(in_view)), key=lambda t: not in_view[t]):
            gap = list(run)
            if is_gap and len(gap) > _LONG_GAP_S * rate_hz:
                first, last = tracked.frames[gap[0]], tracked.frames[gap[-1]]
                log.info("%s: the target is not detected in frames %d to %d", name, first, last)


def _report_joints(people: Mapping[str, People], joints: FloatArray, swapped: BoolArray) -> None:
    """Log exchanged left/right labels, and joints of the detectors' layouts without any detection."""
    for part, number in zip(PARTS, swapped.sum(axis=(0, 1)), strict=True):
        if number:
            limbs = "arms" if "elbow" in part else "legs"
            log.info("left and right labels of %s corrected in %d detections", limbs, number)
    names = {name for each in people.values() if each.layout in LAYOUTS for name in layout_joints(LAYOUTS[each.layout])}
    detected = np.asarray(np.isfinite(joints[..., 0]).any(axis=(0, 1)), bool)
    if missing := [name for name, once in zip(JOINT_NAMES, detected, strict=True) if name in names and not once]:
        log.info("joints without detections, estimated by body and prior: %s", ", ".join(missing))
