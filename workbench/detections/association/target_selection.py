"""Selection of the target person among the people detected in all views."""

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.ndimage import find_objects, label

from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.camera import Camera
from workbench.detections.association.assignment import Assignment, track
from workbench.detections.association.detector_tracks import people_followed
from workbench.detections.association.detector_view import DetectorView, detector_view, median_height, prominence
from workbench.detections.association.isolated_joints import isolated_joints
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
"""The most prominent person, by size, visible time and motion."""
Choice = int | str | Mapping[str, int] | None
"""Target: a number of `TrackedPeople`, or indices in the first frames with a detection of the cameras named."""

_LONG_GAP_S = 0.5
"""Gaps in the detections of a view above this duration are reported."""
_MIN_LOG_ODDS = np.log(20.0)
"""Assignments with lower log odds are reported as uncertain."""
_WALK_SPREAD = 0.05
"""Mean standard deviation of a walking person's joints about their centre, in heights: ankles swing by a quarter of the
height, wrists by a sixth; head, shoulders and hips hardly."""


@dataclass(frozen=True, eq=False)
class TargetPerson:
    """The target's detections.

    Parameters
    ----------
    frames : (T,) numbers of the frames, increasing.
    joints : (V, T, J, 3) by view, [u px, v px, confidence], with corrected left/right labels; NaN without a detection
        and for `isolated_joints`. (V, T, J, 6) with world landmarks, (V, T, J, 12) with feet, see `People`.
    counts : numbers of people, of the video's frames within the chosen ones, of frames without any detection
        (empty), of the target (unseen), of those of them that may show the target (lost), of the others before the
        target's first detection and after the last, and of arms and legs in views with exchanged left/right labels. Of
        an edited film also the number of cuts, the number of the frame after the first one, and those of the first and
        the last frame of the part between cuts that shows the target.
    """

    frames: IntArray
    joints: FloatArray
    counts: Mapping[str, int]


@dataclass(frozen=True, eq=False)
class TrackedPeople:
    """All people detected, numbered from 0 in order of appearance.

    Parameters
    ----------
    names : of the V views.
    frames : (T,) numbers of the frames, increasing.
    joints : (n, J, 3) by frame and view, see `People`.
    assigned : people's numbers of the detections, by frame.
    log_odds : (T,) of the assignments, see `Tracks`.
    cuts : numbers of the frames that begin another part of an edited film, increasing, within the frames.
    """

    names: Sequence[str]
    frames: IntArray
    joints: Sequence[Sequence[FloatArray]]
    assigned: Sequence[Assignment]
    log_odds: FloatArray
    cuts: Sequence[int] = ()

    @property
    def numbers(self) -> list[int]:
        """The people's numbers, increasing."""
        return sorted({number for frame in self.assigned for number in frame.values()})

    def of(self, number: int) -> FloatArray:
        """Return one person's joints (V, T, J, 3), (V, T, J, 6) if all views have world landmarks, or (V, T, J, 12) if
        all have feet."""
        width = min(rows.shape[2] for views in self.joints for rows in views if len(rows))
        joints = np.full((len(self.names), len(self.frames), len(JOINT_NAMES), width), np.nan)
        for t, frame in enumerate(self.assigned):
            for view, row in (place for place, track_number in frame.items() if track_number == number):
                joints[view, t] = self.joints[t][view][row, :, :width]
        return joints


def select_target(
    people: Mapping[str, People], cameras: Mapping[str, Camera] | None, rate_hz: float, person: Choice = None,
    within: tuple[int, int | None] = (0, None), uneven_s: FloatArray | None = None, cuts: Sequence[int] = (),
) -> TargetPerson:  # fmt: skip
    """Return the detections of the target person in synchronized views of one frame rate.

    Parameters
    ----------
    people : detections by view; with several views, a person is visible in at least two of them at once.
    cameras : of all views; None for a single view.
    rate_hz : frame rate.
    person : number of the target, see `TrackedPeople`, or indices by camera; MOVING for the most prominent person; None
        for the person in the first frame with a detection, of any part between cuts, who is largest and most
        confidently detected over all frames and views.
    within : numbers of the first frame and of the last, None for the end.
    uneven_s : times of all frames, s, where they are not at a constant rate; see `FrameTimes`.
    cuts : numbers of the frames that begin another part of an edited film. People after a cut are other people.

    Raises
    ------
    InputError : without any person, and for a target that is not detected in its view or in a second one.
    """
    tracked = tracked_people(people, cameras, rate_hz, within, uneven_s, cuts)
    number = _selected(tracked, person)
    target = tracked.of(number)
    isolated = isolated_joints(target, tracked.frames, rate_hz)
    target[isolated] = np.nan
    detected = np.asarray(np.isfinite(target[..., 0]).any(axis=2), bool)  # (V, T)
    views = _views(people, cameras)
    swapped = exchanged_labels(views, target, rate_hz) & detected[..., None]
    counts = _counts(tracked, number, within) | {"swapped_sides": int(swapped.sum())}
    counts |= _counts_of_cuts(tracked, number, within)
    _report_people(tracked, np.asarray(detected.any(axis=0), bool))
    _report_gaps(tracked, detected, rate_hz)
    _report_joints(people, target, swapped)
    if isolated.any():
        log.info("%d detected joints lie elsewhere than in the frames around them, and are omitted", isolated.sum())
    return TargetPerson(tracked.frames, with_corrected_labels(target, swapped), counts)


def tracked_people(
    people: Mapping[str, People], cameras: Mapping[str, Camera] | None, rate_hz: float,
    within: tuple[int, int | None] = (0, None), uneven_s: FloatArray | None = None, cuts: Sequence[int] = (),
) -> TrackedPeople:  # fmt: skip
    """Return all people detected in synchronized views; parameters as of `select_target`.

    The parts between cuts are tracked one by one. In a single view, people whom the detector follows by numbers of its
    own keep these tracks, see `people_followed`.
    """
    frames = np.unique(np.concatenate([each.frames for each in people.values()]))
    frames = frames[(frames >= within[0]) & (frames <= (frames[-1] if within[1] is None else within[1]))]
    times_s = FrameTimes(rate_hz, uneven_s).at(frames)
    seen = [[_in_frame(each, frame) for each in people.values()] for frame in frames]
    joints = [[rows for rows, _ in each] for each in seen]
    inside = [cut for cut in np.unique(cuts).tolist() if len(frames) and frames[0] < cut <= frames[-1]]
    is_followed = len(people) == 1 and all(each.identities is not None for each in people.values())
    views = [] if is_followed else _views(people, cameras)
    assigned, log_odds, n_people = list[Assignment](), list[FloatArray](), 0
    for part in np.split(np.arange(len(frames)), np.searchsorted(frames, inside)):
        in_part, odds = _associated([seen[t] for t in part], times_s[part], views)
        assigned += [{place: number + n_people for place, number in frame.items()} for frame in in_part]
        n_people = 1 + max((number for frame in assigned for number in frame.values()), default=-1)
        log_odds.append(odds)
    return TrackedPeople(list(people), frames, joints, assigned, np.concatenate(log_odds), inside)


def _associated(
    seen: Sequence[Sequence[tuple[FloatArray, IntArray]]], times_s: FloatArray, views: Sequence[DetectorView]
) -> tuple[Sequence[Assignment], FloatArray]:
    """Return people's numbers of the detections in frames at times (T,), s, and the log odds (T,) of the assignments.

    seen: joints and identities by frame and view. views: none for people whom the detector follows.
    """
    if not views:
        assigned = people_followed([rows for ((rows, _),) in seen], [numbers for ((_, numbers),) in seen], times_s)
        return assigned, np.full(len(seen), np.inf)
    detections = [[list(map(v.detection, rows)) for v, (rows, _) in zip(views, each, strict=True)] for each in seen]
    tracks = without_short(track(views, detections, times_s))
    return stitched(extended_backwards(views, detections, times_s, tracks), times_s), tracks.log_odds


def _views(people: Mapping[str, People], cameras: Mapping[str, Camera] | None) -> list[DetectorView]:
    several = cameras if len(people) > 1 else None
    return [detector_view(each, several[name] if several else None) for name, each in people.items()]


def _in_frame(people: People, frame: int) -> tuple[FloatArray, IntArray]:
    """Return the joints (n, J, 3) of the people in a frame, and their identities (n,), -1 without."""
    row = int(np.searchsorted(people.frames, frame))
    if row == len(people.frames) or people.frames[row] != frame:
        return np.empty((0, len(JOINT_NAMES), 3)), np.empty(0, dtype=np.intp)
    joints = people.joints[row]
    identities = np.full(len(joints), -1) if people.identities is None else people.identities[row]
    return joints, identities


def _counts(tracked: TrackedPeople, target: int, within: tuple[int, int | None]) -> dict[str, int]:
    """Return the counts of `TargetPerson` without the labels; within: as of `select_target`.

    A frame without the target may show the target if it lies between the target's detections, or if a person is
    detected in it who is in no frame with the target and may be the same person. Frames without a file of detections
    count, except between those at a regular interval.
    """
    people = {int(n): set(frame.values()) for n, frame in zip(tracked.frames, tracked.assigned, strict=True)}
    interval = int(np.gcd.reduce(np.diff(tracked.frames))) or 1
    first, last = within[0] + int(tracked.frames[0] - within[0]) % interval, within[1]
    numbers = range(first, (int(tracked.frames[-1]) if last is None else last) + 1, interval)
    present = [people.get(number, set()) for number in numbers]
    others = set[int]().union(*(frame for frame in present if target in frame))
    shown = [t for t, frame in enumerate(present) if target in frame]
    unseen = {t for t, frame in enumerate(present) if target not in frame}
    lost = {t for t in unseen if shown[0] < t < shown[-1] or present[t] - others}
    return {
        "people": len(tracked.numbers), "frames": len(present), "frames_empty": sum(not frame for frame in present),
        "frames_unseen": len(unseen), "frames_lost": len(lost),
        "frames_before": sum(t < shown[0] for t in unseen - lost),
        "frames_after": sum(t > shown[-1] for t in unseen - lost),
    }  # fmt: skip


def _counts_of_cuts(tracked: TrackedPeople, target: int, within: tuple[int, int | None]) -> dict[str, int]:
    """Return the counts of `TargetPerson` of an edited film, none without a cut; within: as of `select_target`."""
    if not tracked.cuts:
        return {}
    frames = zip(tracked.frames.tolist(), tracked.assigned, strict=True)
    shown = next(frame for frame, people in frames if target in people.values())
    end = int(tracked.frames[-1]) if within[1] is None else within[1]
    first = max((cut for cut in tracked.cuts if cut <= shown), default=within[0])
    last = min((cut - 1 for cut in tracked.cuts if cut > shown), default=end)
    return {"cuts": len(tracked.cuts), "first_cut": tracked.cuts[0], "part_first": first, "part_last": last}


def _report_people(tracked: TrackedPeople, detected: BoolArray) -> None:
    """Log the number of people, the share of the frames with the target, (T,), and uncertain assignments."""
    if (n_people := len(tracked.numbers)) < 2:
        return
    share = f"{100.0 * detected.mean():.0f} % of {len(detected)} frames"
    log.info("%s: %d people; the target is detected in %s", ", ".join(tracked.names), n_people, share)
    uncertain = tracked.log_odds[tracked.log_odds < _MIN_LOG_ODDS]
    if len(uncertain):
        odds = np.exp(max(uncertain.min(), 0))
        log.info("people may be exchanged in %d frames: odds %.1f to 1", len(uncertain), odds)


def _selected(tracked: TrackedPeople, person: Choice) -> int:
    parts = np.split(np.arange(len(tracked.frames)), np.searchsorted(tracked.frames, tracked.cuts))
    firsts = [next((tracked.assigned[t] for t in part if tracked.assigned[t]), None) for part in parts]
    if not any(firsts):
        several = "two cameras at once; check that the videos are synchronized and match the calibration"
        expected = several if len(tracked.names) > 1 else "the frames used"
        raise InputError(f"{', '.join(tracked.names)}: expected a person in {expected}")
    if person == MOVING:
        return max(tracked.numbers, key=lambda number: _presence(tracked.of(number)) * _weight(tracked.of(number)))
    if person is None:
        candidates = sorted({number for first in firsts if first for number in first.values()})
        return max(candidates, key=lambda number: _presence(tracked.of(number)))
    if isinstance(person, int) and not isinstance(person, bool):
        if person not in tracked.numbers:
            raise InputError(
                f"{', '.join(tracked.names)}: no person {person}, expected 0 to {tracked.numbers[-1]}: people have "
                "numbers in order of appearance, which people.png of workbench detect and workbench track shows"
            )
        return person
    indices: dict[str, Any] = dict(person) if isinstance(person, Mapping) else {"": person}
    is_valid = all(isinstance(row, int) and not isinstance(row, bool) for row in indices.values())
    if not is_valid or not indices or not set(indices) <= set(tracked.names):
        raise InputError(
            f"person: expected a number, or indices by some of {', '.join(tracked.names)}, found {person!r}; to track "
            "all people, sweep over the numbers: workbench run -m dataset.person=0,1"
        )
    numbers = {_track_number(tracked, name, row) for name, row in indices.items()}
    if len(numbers) > 1:
        listed = ", ".join(f"{row} of {name}" for name, row in indices.items())
        raise InputError(f"person: expected indices of one person, found {len(numbers)} people: {listed}")
    return numbers.pop()


def _track_number(tracked: TrackedPeople, name: str, row: int) -> int:
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


def _weight(joints: FloatArray) -> float:
    """Return the weight of one person's motion, joints (V, T, J, 3): 1 at rest, 3 for one who walks by.

    A walk's spread of the joints about their centre adds 1, and the largest distance of the centre from its first place
    adds as many heights, up to 1: a moving camera moves all people, small ones by many heights.
    """
    largest = 0.0
    for view in joints[..., :2]:
        detected = view[np.isfinite(view[..., 0]).any(axis=1)]
        if len(detected):
            centres, height = np.nanmean(detected, axis=1), max(median_height(detected), 1.0)
            way = float(np.linalg.norm(centres - centres[0], axis=1).max()) / height
            seen = np.isfinite(detected[..., 0]).all(axis=0)
            limbs = (detected - centres[:, None])[:, seen] / height
            spread = float(np.linalg.norm(limbs.std(axis=0), axis=1).mean()) if seen.any() else 0.0
            largest = max(largest, min(way, 1.0) + min(spread / _WALK_SPREAD, 1.0))
    return 1.0 + largest


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


def _report_gaps(tracked: TrackedPeople, detected: BoolArray, rate_hz: float) -> None:
    """Log long gaps of the target's detections (V, T)."""
    for name, in_view in zip(tracked.names, detected, strict=True):
        for (gap,) in find_objects(label(~in_view)[0]):
            if gap.stop - gap.start > _LONG_GAP_S * rate_hz:
                first, last = tracked.frames[gap.start], tracked.frames[gap.stop - 1]
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
