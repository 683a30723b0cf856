"""Who comes back: tracks that end and tracks that begin later, joined where they can be of one person."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.association.multi_hypothesis import Assigned, Tracked
from workbench.utils.arrays import FloatArray, IntArray

LEAST_FRAMES = 3
"""Who is seen in fewer is taken for nobody: a detector's mistake."""
PLACE_M, WALK_M_S = 0.3, 1.0
"""Standard deviation of where somebody is when they come back, and of what they walk meanwhile."""
LOG_ANYWHERE = -np.log(50.0)
"""Log density of where somebody comes from who was not there before, 1/m² on the ground or in the image."""
SIZE_SIGMA, PEOPLE_SIGMA = 0.05, 0.10
"""Of the logarithm of a limb's length, of one person at two times, and of two people."""
BONES = tuple(
    (JOINT_NAMES.index(f"{side}_{a}"), JOINT_NAMES.index(f"{side}_{b}"))
    for side in ("left", "right")
    for a, b in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))
)


@dataclass(frozen=True, eq=False)
class _Track:
    """frames: in which somebody is seen, rising. first, last: the middle of the joints then, (D,), m. sizes: (B,)
    logarithms of the limbs' median lengths, m."""

    frames: IntArray
    first: FloatArray
    last: FloatArray
    sizes: FloatArray


def rejoined(tracked: Tracked, times_s: FloatArray) -> tuple[Assigned, ...]:
    """Return whose the detections are, with one number for who leaves and comes back, from 0 in order of appearance.

    Which end goes with which beginning is the likeliest of all pairings, by where they are, how long it took, and how
    long the limbs are; somebody new may come at any time.
    """
    seen = _frames(tracked.assigned)
    least = min(LEAST_FRAMES, max(map(len, seen.values()), default=0))
    kept = {number: frames for number, frames in seen.items() if len(frames) >= least}
    tracks = {number: _track(frames, [tracked.joints[t][number] for t in frames]) for number, frames in kept.items()}
    numbers = sorted(tracks, key=lambda number: tracks[number].frames[0])
    who = dict[int, int]()
    before = _pairs([tracks[number] for number in numbers], times_s)
    for index, number in enumerate(numbers):
        who[number] = len(set(who.values())) if index not in before else who[numbers[before[index]]]
    return tuple({place: who[one] for place, one in frame.items() if one in who} for frame in tracked.assigned)


def _frames(assigned: Sequence[Assigned]) -> Mapping[int, IntArray]:
    frames = dict[int, list[int]]()
    for t, frame in enumerate(assigned):
        for number in sorted(set(frame.values())):
            frames.setdefault(number, []).append(t)
    return {number: np.array(those) for number, those in frames.items()}


def _track(frames: IntArray, joints: Sequence[FloatArray]) -> _Track:
    lengths = [[np.linalg.norm(one[a] - one[b]) for a, b in BONES] for one in joints]
    sizes = np.log(np.maximum(np.median(lengths, axis=0), 1e-3))
    return _Track(frames, joints[0].mean(axis=0), joints[-1].mean(axis=0), sizes)


def _pairs(tracks: Sequence[_Track], times_s: FloatArray) -> dict[int, int]:
    """Return, by the tracks that go on others, which these are."""
    n = len(tracks)
    costs = np.full((n, 2 * n), np.inf)
    costs[np.arange(n), n + np.arange(n)] = 0.0
    for later, earlier in np.ndindex(n, n):
        if tracks[earlier].frames[-1] < tracks[later].frames[0]:
            costs[later, earlier] = -_log_odds(tracks[earlier], tracks[later], times_s)
    rows, columns = scipy.optimize.linear_sum_assignment(costs) if n else ((), ())
    return {int(row): int(column) for row, column in zip(rows, columns, strict=True) if column < n}


def _log_odds(earlier: _Track, later: _Track, times_s: FloatArray) -> float:
    """Weigh that one person is seen earlier and later against two people."""
    gap_s = times_s[later.frames[0]] - times_s[earlier.frames[-1]]
    variance, way = PLACE_M**2 + (WALK_M_S * gap_s) ** 2, later.first - earlier.last
    place = -0.5 * way @ way / variance - np.log(2.0 * np.pi * variance) - LOG_ANYWHERE
    apart = later.sizes - earlier.sizes
    same, other = np.sqrt(2.0) * SIZE_SIGMA, np.sqrt(2.0) * PEOPLE_SIGMA
    return float(place + (0.5 * apart**2 * (other**-2 - same**-2) + np.log(other / same)).sum())
