"""Pairing of the frames of several cameras by time, and estimation of constant offsets between their clocks."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import numpy as np

from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.camera import Camera
from workbench.cameras.time_offset import distance_curve
from workbench.detections.readers.people import People
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.frame_times import FrameTimes
from workbench.utils.nan_statistics import nan_mean

MAX_OFFSET_S = 0.5
"""Largest offset that is searched."""
_MIN_GAIN = 0.25
"""Smallest relative reduction of the rays' distances by an offset that is accepted: a wrong offset leaves the rays of
standing or slow people as close as before."""
_MIN_OFFSET_FRAMES = 0.75
_MIN_OVERLAP = 0.5
"""Smallest fraction of the frames of the shorter video that are compared at an offset."""
_MAX_DISTANCE_M = 0.3
"""Largest distance of rays that counts, for robustness against other people and wrong joints."""


@dataclass(frozen=True, eq=False)
class PairedFrames:
    """Frames of one camera at the times of the reference camera's frames.

    frames: (T,), numbers of the nearest frames. times_s: (T,), their times, with the camera's offset.
    """

    frames: IntArray
    times_s: FloatArray


def paired_by_time(
    reference_s: FloatArray, sources: Sequence[tuple[FrameTimes, int, float]]
) -> tuple[IntArray, list[PairedFrames]]:
    """Return the rows of reference times (T,) at which all cameras have a frame, and their nearest frames there.

    A camera has a frame at a time up to half an interval, at its rate, before its first and after its last frame.
    sources: times, number of frames, and offset, s, of each camera.
    """
    inside, paired = np.ones(len(reference_s), dtype=bool), []
    for times, n_frames, offset_s in sources:
        frame_times_s = times.at(np.arange(n_frames)) + offset_s
        after = np.clip(np.searchsorted(frame_times_s, reference_s), 1, max(n_frames - 1, 1))
        before = after - 1
        later = np.minimum(after, n_frames - 1)
        is_later = np.abs(frame_times_s[later] - reference_s) < np.abs(frame_times_s[before] - reference_s)
        frames = np.where(is_later, later, before)
        margin_s = (0.5 + 1e-6) / times.rate_hz
        inside &= (reference_s >= frame_times_s[0] - margin_s) & (reference_s <= frame_times_s[-1] + margin_s)
        paired.append(PairedFrames(frames, frame_times_s[frames]))
    rows = np.flatnonzero(inside)
    return rows, [PairedFrames(each.frames[rows], each.times_s[rows]) for each in paired]


def people_at(people: People, frames: IntArray, reference: IntArray) -> People:
    """Return the people of frames (T,) under the numbers of the reference camera's frames (T,)."""
    rows = np.searchsorted(people.frames, frames)
    rows[rows == len(people.frames)] = 0
    present = np.flatnonzero(people.frames[rows] == frames)
    return people.at_rows(rows[present], reference[present])


def at_times(joints: FloatArray, joint_times_s: FloatArray, times_s: FloatArray) -> FloatArray:
    """Return joints (T, J, 3) of times (T,), non-decreasing, at other times (T,), interpolated linearly.

    A joint missing in one of the two adjacent frames keeps the value of its own row.
    """
    distinct, first = np.unique(joint_times_s, return_index=True)
    if len(distinct) < 2:
        return joints
    after = np.clip(np.searchsorted(distinct, times_s, side="right"), 1, len(distinct) - 1)
    fraction = np.clip((times_s - distinct[after - 1]) / (distinct[after] - distinct[after - 1]), 0.0, 1.0)
    low, high = joints[first[after - 1]], joints[first[after]]
    interpolated = low + fraction[:, None, None] * (high - low)
    return np.where(np.isfinite(interpolated), interpolated, joints)


def estimated_offsets(
    people: Mapping[str, People], cameras: Mapping[str, Camera], times: Mapping[str, FrameTimes]
) -> dict[str, float]:
    """Return the seconds by which cameras began later than most, from the distances of the rays to people's joints.

    Each pair of cameras has a curve of the mean distance of rays over shifts of ±MAX_OFFSET_S. Offsets minimise the sum
    of all curves by coordinate descent from none, and a parabola through the neighbouring shifts gives fractions of a
    frame. Only offsets that reduce the sum clearly are returned, none otherwise and for less than a second.
    """
    step_s = min(1.0 / each.rate_hz for each in times.values())
    if min(len(each.frames) / times[name].rate_hz for name, each in people.items()) < 2.0 * MAX_OFFSET_S:
        return {}
    n = int(MAX_OFFSET_S / step_s)
    shifts_s = np.asarray(np.arange(-n, n + 1) * step_s, dtype=np.float64)
    rays = {name: _rays(each, cameras[name]) for name, each in people.items()}
    clocks = {name: times[name].at(each.frames) for name, each in people.items()}
    curves = {}
    for a, b in combinations(people, 2):
        min_frames = _MIN_OVERLAP * min(len(clocks[a]), len(clocks[b]))
        curves[a, b] = distance_curve(
            rays[a][:, :, None], clocks[a], rays[b][:, None], clocks[b], cameras[b].position - cameras[a].position,
            shifts_s, partial(_mean_of_closest, min_frames=min_frames),
        )  # fmt: skip

    def cost(offsets: Mapping[str, int]) -> float:
        rows = {(a, b): offsets[b] - offsets[a] + n for a, b in curves}
        inside = all(0 <= row <= 2 * n for row in rows.values())
        return sum(float(curves[pair][row]) for pair, row in rows.items()) if inside else np.inf

    offsets = _descended(cost, list(people), n)
    if not cost(offsets) <= (1.0 - _MIN_GAIN) * cost(dict.fromkeys(people, 0)):
        return {}
    refined = {name: offset + _vertex(cost, offsets, name) if offset else 0.0 for name, offset in offsets.items()}
    middle = 0.0 if len(people) == 2 else float(np.median(list(refined.values())))
    found = {name: (offset - middle) * step_s for name, offset in refined.items()}
    return {name: offset for name, offset in found.items() if abs(offset) >= _MIN_OFFSET_FRAMES * step_s}


def _descended(cost: Callable[[Mapping[str, int]], float], names: Sequence[str], n: int) -> dict[str, int]:
    """Return offsets of the least cost by coordinate descent over -n to n from 0; the first camera keeps 0 of two."""
    offsets, best = dict.fromkeys(names, 0), np.inf
    for _ in range(2 * len(names)):
        moves = [(name, shift) for name in names[len(names) == 2 :] for shift in sorted(range(-n, n + 1), key=abs)]
        costs = [cost(offsets | {name: shift}) for name, shift in moves]
        row = int(np.argmin(np.nan_to_num(costs, nan=np.inf)))
        if not costs[row] < best:
            break
        best = costs[row]
        offsets[moves[row][0]] = moves[row][1]
    return offsets


def _vertex(cost: Callable[[Mapping[str, int]], float], offsets: Mapping[str, int], name: str) -> float:
    """Return where the parabola through the costs of a camera's offset and both neighbours is least, in −0.5 to 0.5."""
    before, here, after = (cost(dict(offsets) | {name: offsets[name] + move}) for move in (-1, 0, 1))
    curvature = before - 2.0 * here + after
    return float(np.clip(0.5 * (before - after) / curvature, -0.5, 0.5)) if 0.0 < curvature < np.inf else 0.0


def _rays(people: People, camera: Camera) -> FloatArray:
    """Return the unit directions (T, n, J, 3) of the rays to people's joints, NaN for fewer than n people."""
    n = max(1, *(len(joints) for joints in people.joints))
    pixels = np.full((len(people.joints), n, len(JOINT_NAMES), 2), np.nan)
    for t, joints in enumerate(people.joints):
        pixels[t, : len(joints)] = joints[..., :2]
    return camera.directions(camera.undistorted(pixels))


def _mean_of_closest(distances: FloatArray, min_frames: float) -> float:
    """Return the mean distance, m, of the rays to the joints of those people whose rays are closest, over all frames.

    distances: (T, n, m, J) between n and m people, NaN for none. NaN for fewer than min_frames with a distance.
    """
    means = np.fmin.reduce(nan_mean(np.minimum(distances, _MAX_DISTANCE_M)), axis=(1, 2))
    return float(np.nanmean(means)) if np.isfinite(means).sum() >= min_frames else np.nan
