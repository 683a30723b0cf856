"""Track post-processing: removal of short tracks, extension backwards, and stitching of a returning person's tracks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from workbench.body.skeleton import JOINT_NAMES
from workbench.body.stature import LIMBS, SIDES
from workbench.detections.association.assignment import GAP_S, Assignment, Frames, Tracks, track
from workbench.detections.association.detector_view import DetectorView
from workbench.utils.arrays import FloatArray, IntArray

_MIN_FRAMES = 3
"""Shorter tracks are false detections, unless there is no longer one."""
_PLACE_M, _WALK_M_S = 0.3, 1.0
"""Standard deviations of the position at a person's return, and of the velocity during the absence."""
_LOG_ANYWHERE = -np.log(50.0)
"""Log density, 1/m² on the ground or in the image, of the position where another person appears."""
_SIZE_SIGMA, _PEOPLE_SIGMA = np.sqrt(2.0) * 0.05, np.sqrt(2.0) * 0.10
"""Standard deviations of the difference of a limb's log length, of one person at two times, and of two people."""
_BONES = np.array([[JOINT_NAMES.index(f"{side}_{end}") for end in ends] for side in SIDES for ends in LIMBS.values()])


def without_short(tracks: Tracks) -> Tracks:
    """Return the tracks of at least _MIN_FRAMES frames, or else the longest ones."""
    frames = _frames_of(tracks)
    min_frames = min(_MIN_FRAMES, max(map(len, frames.values()), default=0))
    long = {number for number, indices in frames.items() if len(indices) >= min_frames}
    assigned = [{place: number for place, number in one.items() if number in long} for one in tracks.assigned]
    return Tracks(tuple(assigned), tracks.joints, tracks.log_odds)


def extended_backwards(views: Sequence[DetectorView], frames: Frames, times_s: FloatArray, tracks: Tracks) -> Tracks:
    """Return tracks extended backwards by a backward pass, which assigns earlier, unassigned detections.

    From a track's first frame, the same person's backward track is followed until it claims an assigned detection.
    """
    first_frames = {number: int(indices[0]) for number, indices in _frames_of(tracks).items()}
    n_before = [0, *(sum(map(len, detections)) for detections in frames)]
    late = [t for t in first_frames.values() if t > 0 and len(tracks.assigned[t - 1]) < (n_before[t] or 1)]
    if not late:
        return tracks
    n = int(np.searchsorted(times_s, times_s[max(late)] + GAP_S, side="right"))
    back = track(views, frames[:n][::-1], times_s[n - 1] - times_s[:n][::-1])
    back_assigned, back_joints = back.assigned[::-1], back.joints[::-1]
    assigned, joints = [dict(one) for one in tracks.assigned], [dict(one) for one in tracks.joints]
    for number, first in first_frames.items():
        backward = back_assigned[first] if first < n else {}
        owned = [place for place, owner in tracks.assigned[first].items() if owner == number]
        same = {backward[place] for place in owned if place in backward}
        if len(same) != 1:
            continue
        (other,) = same
        for t in range(first - 1, -1, -1):
            places = [place for place, owner in back_assigned[t].items() if owner == other]
            if any(place in assigned[t] for place in places) or other not in back_joints[t]:
                break
            if places:
                assigned[t] |= dict.fromkeys(places, number)
                joints[t][number] = back_joints[t][other]
    return Tracks(tuple(assigned), tuple(joints), tracks.log_odds)


@dataclass(frozen=True, eq=False)
class _Track:
    """A track's summary. frames: with a detection, increasing. first, last: mean joint in the first and last of them,
    (D,), m. sizes: (B,) logarithms of the limbs' median lengths, m."""

    frames: IntArray
    first: FloatArray
    last: FloatArray
    sizes: FloatArray


def stitched(tracks: Tracks, times_s: FloatArray) -> tuple[Assignment, ...]:
    """Return the people of the detections, with one number for a person who leaves and returns, in order of appearance.

    Ends and beginnings of tracks are joined by the maximum-likelihood assignment, given the distance and time between
    them and the limbs' lengths; another person may appear at any time.
    """
    frames = _frames_of(tracks)
    numbers = sorted(sorted(frames), key=lambda number: frames[number][0])
    each = [_track(frames[number], [tracks.joints[t][number] for t in frames[number]]) for number in numbers]
    spans = [(int(one.frames[0]), int(one.frames[-1])) for one in each]
    people = joined(spans, lambda earlier, later: _log_odds(each[earlier], each[later], times_s))
    person = dict(zip(numbers, people, strict=True))
    return tuple({place: person[number] for place, number in frame.items()} for frame in tracks.assigned)


def joined(spans: Sequence[tuple[int, int]], log_odds: Callable[[int, int], float]) -> list[int]:
    """Return the person of each of n tracks, numbered from 0 in order of appearance.

    spans: first and last frame of the tracks, in order of the first. log_odds: that an earlier and a later track are of
    one person rather than of two, by their indices.
    """
    n = len(spans)
    costs = np.full((n, 2 * n), np.inf)
    np.fill_diagonal(costs[:, n:], 0.0)
    for later, earlier in np.ndindex(n, n):
        if spans[earlier][1] < spans[later][0]:
            costs[later, earlier] = -log_odds(earlier, later)
    people = list[int]()
    for _, earlier in zip(*scipy.optimize.linear_sum_assignment(costs), strict=True):
        people.append(people[earlier] if earlier < n else len(set(people)))
    return people


def log_odds_of_place(shift_m: FloatArray, gap_s: float) -> float:
    """Return the log odds that a person reappears at this distance (D,), m, after a gap, s, rather than anywhere."""
    variance = _PLACE_M**2 + (_WALK_M_S * gap_s) ** 2
    return float(-0.5 * shift_m @ shift_m / variance - np.log(2.0 * np.pi * variance) - _LOG_ANYWHERE)


def _frames_of(tracks: Tracks) -> dict[int, IntArray]:
    """Return the frames with detections of each person, increasing, in order of appearance."""
    frames = dict[int, list[int]]()
    for t, frame in enumerate(tracks.assigned):
        for number in sorted(set(frame.values())):
            frames.setdefault(number, []).append(t)
    return {number: np.array(indices) for number, indices in frames.items()}


def _track(frames: IntArray, joints: Sequence[FloatArray]) -> _Track:
    ends = np.stack(joints)[:, _BONES]  # (T, B, 2, D)
    sizes = np.log(np.maximum(np.median(np.linalg.norm(ends[:, :, 0] - ends[:, :, 1], axis=2), axis=0), 1e-3))
    return _Track(frames, joints[0].mean(axis=0), joints[-1].mean(axis=0), sizes)


def _log_odds(earlier: _Track, later: _Track, times_s: FloatArray) -> float:
    """Return the log odds that two tracks are of one person rather than of two."""
    gap_s = times_s[later.frames[0]] - times_s[earlier.frames[-1]]
    place = log_odds_of_place(later.first - earlier.last, gap_s)
    squares, ratio = (later.sizes - earlier.sizes) ** 2, _PEOPLE_SIGMA / _SIZE_SIGMA
    return float(place + (0.5 * squares * (_PEOPLE_SIGMA**-2 - _SIZE_SIGMA**-2) + np.log(ratio)).sum())
