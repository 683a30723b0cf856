"""Tracks of people whom the detector itself follows from frame to frame in one view, and the joining of fragments.

A detector that searches each person in the region that follows from the frame before keeps hold of motions that no
motion model predicts, such as a serve. Its tracks are therefore never split, except where its region moves from one
person to another who covers them. Where it loses a person, the next track of this person is chosen by the predicted
position and the size.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from workbench.cameras.image_height import height_px
from workbench.detections.association.assignment import Assignment
from workbench.detections.association.detector_view import HEIGHT_M
from workbench.detections.association.keypoint_kalman import TAU_S
from workbench.detections.association.track_stitching import joined, log_odds_of_place
from workbench.utils.arrays import FloatArray, IntArray

_MIN_FRAMES, _MIN_S = 3, 0.5
"""Shorter tracks are false detections: half a second is the time of a step. Where all are short, those of less than
half the longest track's frames are."""
_SAME_PLACE = 0.15
"""Largest mean distance of two detections' joints, in heights, for which they show one person; the detector's own."""
_END_S = 0.3
"""Time at a track's ends over which its position, velocity and size are measured: half a step."""
_MAX_GAP_S = 5.0
"""Longest gap: after it the position and the size of a person who walks are unrelated."""
_SIZE_SIGMA, _DEPTH_SIGMA_PER_S, _PEOPLE_SIGMA = 0.1, 0.2, 0.5
"""Standard deviations of the log size of one person by the landmarks' error and by a walk of 1 m/s at a distance of
5 m, and of two people at different distances."""


@dataclass
class _Fragment:
    """A detector's track. first: index of its first frame. rows, joints: of the person, (J, 3) or (J, 6), by frame."""

    first: int
    rows: list[int] = field(default_factory=list)
    joints: list[FloatArray] = field(default_factory=list)

    @property
    def last(self) -> int:
        """Index of its last frame."""
        return self.first + len(self.rows) - 1


@dataclass(frozen=True, eq=False)
class _End:
    """An end of a track. place: (2,) px. velocity: (2,) px/s. px_per_m: scale of the image at the person."""

    place: FloatArray
    velocity: FloatArray
    px_per_m: float


def people_followed(
    joints: Sequence[FloatArray], identities: Sequence[IntArray], times_s: FloatArray
) -> tuple[Assignment, ...]:
    """Return the people of the detections of one view, numbered from 0 in order of appearance.

    Parameters
    ----------
    joints : (n, J, 3) or (n, J, 6) of the people by frame, see `People`.
    identities : (n,) the detector's numbers by frame; a number is one person's in consecutive frames.
    times_s : (T,) increasing times of the frames, s.
    """
    fragments = _without_short(_fragments(joints, identities), times_s)
    starts = [_end(each, times_s, at_start=True) for each in fragments]
    ends = [_end(each, times_s, at_start=False) for each in fragments]

    def log_odds(earlier: int, later: int) -> float:
        gap_s = float(times_s[fragments[later].first] - times_s[fragments[earlier].last])
        return _log_odds(ends[earlier], starts[later], gap_s)

    people = joined([(each.first, each.last) for each in fragments], log_odds)
    assigned: tuple[Assignment, ...] = tuple({} for _ in joints)
    for fragment, person in zip(fragments, people, strict=True):
        for t, row in enumerate(fragment.rows, fragment.first):
            assigned[t][0, row] = person
    return assigned


def _fragments(joints: Sequence[FloatArray], identities: Sequence[IntArray]) -> list[_Fragment]:
    """Return the detector's tracks in order of appearance."""
    tracks, following = list[_Fragment](), dict[int, _Fragment]()
    for t, (people, numbers) in enumerate(zip(joints, identities, strict=True)):
        rows = {int(number): row for row, number in enumerate(numbers) if np.isfinite(people[row, :, 0]).any()}
        following = _handed_over(following, {number: people[row] for number, row in rows.items()})
        for number, row in rows.items():
            if number not in following:
                following[number] = _Fragment(t)
                tracks.append(following[number])
            following[number].rows.append(row)
            following[number].joints.append(people[row])
    return tracks


def _handed_over(following: Mapping[int, _Fragment], people: Mapping[int, FloatArray]) -> dict[int, _Fragment]:
    """Return the tracks that the next frame's people (J, 3) continue, by the detector's numbers.

    Where a number leaves its own person for the place of one whose number ends, it continues the latter's track.
    """
    continued = {number: track for number, track in following.items() if number in people}
    ended = [track for number, track in following.items() if number not in people]
    for number, track in list(continued.items()):
        moved = _distance(track.joints[-1], people[number])
        for other in list(ended):
            distance = _distance(other.joints[-1], people[number])
            if distance < _SAME_PLACE < moved:
                continued[number] = other
                ended.remove(other)
                break
    return continued


def _distance(one: FloatArray, other: FloatArray) -> float:
    """Return the mean distance of the joints (J, 3) that two detections have in common, in heights; inf without any."""
    distances = np.linalg.norm(one[:, :2] - other[:, :2], axis=1)
    known, height = np.isfinite(distances), float(max(height_px(one[:, :2]), height_px(other[:, :2])))
    return float(distances[known].mean()) / height if known.any() and height > 0.0 else np.inf


def _without_short(fragments: Sequence[_Fragment], times_s: FloatArray) -> list[_Fragment]:
    longest = max((len(each.rows) for each in fragments), default=0)
    step_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else _MIN_S
    min_frames = min(max(_MIN_FRAMES, round(_MIN_S / step_s)), 0.5 * longest)
    return [each for each in fragments if len(each.rows) >= min_frames]


def _end(fragment: _Fragment, times_s: FloatArray, at_start: bool) -> _End:
    """Measure a track's first or last _END_S."""
    t = times_s[fragment.first : fragment.last + 1]
    near = np.flatnonzero(t <= t[0] + _END_S) if at_start else np.flatnonzero(t >= t[-1] - _END_S)
    joints = [fragment.joints[k] for k in near]
    places = np.array([np.nanmean(each[:, :2], axis=0) for each in joints])
    velocity = np.polyfit(t[near] - t[near].mean(), places, 1)[0] if len(near) > 1 else np.zeros(2)
    return _End(places[0 if at_start else -1], velocity, float(np.median([_px_per_m(each) for each in joints])))


def _px_per_m(joints: FloatArray) -> float:
    """Return the scale of the image at a person by the joints (J, 6), which a bent person does not change; by the
    height in the image without world landmarks (J, 3)."""
    known = joints[np.isfinite(joints).all(axis=1)]
    if joints.shape[1] == 6 and len(known) > 1:
        pixels, metres = (np.ptp(known[:, axes], axis=0).max() for axes in (slice(0, 2), slice(3, 5)))
        if pixels > 0.0 and metres > 0.0:
            return float(pixels / metres)
    return max(float(height_px(joints[:, :2])), 1.0) / HEIGHT_M


def _log_odds(earlier: _End, later: _End, gap_s: float) -> float:
    """Return the log odds that two tracks are of one person rather than of two."""
    if gap_s > _MAX_GAP_S:
        return -np.inf
    reach_s = TAU_S * (1.0 - np.exp(-0.5 * gap_s / TAU_S))  # both are predicted to the middle of the gap
    distance_px = (later.place - reach_s * later.velocity) - (earlier.place + reach_s * earlier.velocity)
    ratio = float(np.log(later.px_per_m / earlier.px_per_m))
    sigma = min(float(np.hypot(_SIZE_SIGMA, _DEPTH_SIGMA_PER_S * gap_s)), _PEOPLE_SIGMA)
    size = 0.5 * ratio**2 * (_PEOPLE_SIGMA**-2 - sigma**-2) + np.log(_PEOPLE_SIGMA / sigma)
    return log_odds_of_place(distance_px / np.sqrt(later.px_per_m * earlier.px_per_m), gap_s) + float(size)
