"""Left and right that a detector took for each other, told by how joints move and by what other views show.

Arms and legs of each view are a hidden Markov chain: as found, or exchanged. Its likeliest path (Viterbi) is by the
second differences of the joints in the image, which are small where sides go on, and with several cameras by how nearly
the rays to each joint meet.
"""

from collections.abc import Sequence

import numpy as np

from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.association.detections import HEIGHT_M, SIGMA_M, Eye, meeting
from workbench.datasets.association.keypoint_kalman import ARMS, LEGS, exchanged
from workbench.utils.arrays import BoolArray, FloatArray

PARTS = (ARMS, LEGS)
LOG_KEEP = np.log(np.array([[0.99, 0.01], [0.2, 0.8]]))
"""Of sides as found and exchanged ones (columns) in the frame after sides as found and exchanged ones (rows)."""
LOG_START = np.log(0.05)
"""Of exchanged sides in the first frame, against sides as found."""
ACCELERATION_M_S2 = 15.0
"""Standard deviation of a joint's, beside which the detector's noise is SIGMA_M."""
MOST = 4.5
"""What a joint may cost at most, nats: the detector may have put it elsewhere."""
MOST_CHANGES = 20
ROWS = tuple(np.array([j for j, name in enumerate(JOINT_NAMES) if name.split("_")[-1] in part]) for part in PARTS)
"""Joints of the parts, in the order of JOINT_NAMES."""


def exchanged_sides(eyes: Sequence[Eye], joints: FloatArray, rate_hz: float) -> BoolArray:
    """Tell where left and right are exchanged, (V, T, 2): in arms and legs of each of V views and T frames.

    joints: (V, T, J, 3), [u px, v px, confidence], NaN for what was not found. The path of one part in one view is
    found first by how it moves alone, then given all others, the one that gains most first, until none gains.
    """
    found = np.array([[eye.detection(one).places for one in view] for eye, view in zip(eyes, joints, strict=True)])
    swapped = np.zeros((*joints.shape[:2], len(PARTS)), dtype=bool)
    chains = list(np.ndindex(len(eyes), len(PARTS)))
    jumps = {(view, part): _jumps(_both(found[view], part), _metres(found[view]), rate_hz) for view, part in chains}
    for (view, part), costs in jumps.items():
        swapped[view, :, part] = _likeliest(costs)
    for _ in range(MOST_CHANGES if len(eyes) > 1 else 0):
        best_gain, best = 0.0, None
        places = undone(found, swapped)
        for view, part in chains:
            costs = jumps[view, part] + _misses(eyes, places, found, view, part)[:, None, None, :]
            path = _likeliest(costs)
            gain = _cost(costs, swapped[view, :, part]) - _cost(costs, path)
            if gain > best_gain + 1e-6:
                best_gain, best = gain, (view, part, path)
        if best is None:
            break
        swapped[best[0], :, best[1]] = best[2]
    return swapped


def undone(joints: FloatArray, swapped: BoolArray) -> FloatArray:
    """Return joints (V, T, J, 3) with the sides exchanged back where they are swapped, (V, T, 2)."""
    joints = joints.copy()
    for part, names in enumerate(PARTS):
        where = swapped[..., part]
        joints[where] = joints[where][:, exchanged(*names)]
    return joints


def _metres(places: FloatArray) -> float:
    """Tell how many metres a unit of places (T, J, 2) is, by the person's height in them."""
    seen = places[np.isfinite(places[..., 0]).sum(axis=1) > 1]
    heights = (np.nanmax(seen, axis=1) - np.nanmin(seen, axis=1)).max(axis=1)
    return HEIGHT_M / float(np.median(heights)) if len(heights) and np.median(heights) > 0.0 else 1.0


def _jumps(both: FloatArray, metres: float, rate_hz: float) -> FloatArray:
    """Return costs (T, 2, 2, 2) of how the sides are two frames ago, one frame ago and now, by places (2, T, M, 2)."""
    sigma_m = np.hypot(np.sqrt(6.0) * SIGMA_M, ACCELERATION_M_S2 / rate_hz**2)
    costs = np.zeros((both.shape[1], 2, 2, 2))
    for before, last, now in np.ndindex(2, 2, 2):
        second = both[now, 2:] - 2.0 * both[last, 1:-1] + both[before, :-2]
        squares = (second**2).sum(axis=2) * (metres / sigma_m) ** 2
        costs[2:, before, last, now] = np.minimum(0.5 * np.nan_to_num(squares), MOST).sum(axis=1)
    return costs


def _misses(eyes: Sequence[Eye], places: FloatArray, found: FloatArray, view: int, part: int) -> FloatArray:
    """Return costs (T, 2) of a view's sides as found and exchanged, by how nearly all V views' rays meet.

    places: (V, T, J, 2) as they are taken to be now. found: as they were found.
    """
    costs = np.zeros((places.shape[1], 2))
    if len(eyes) < 2:
        return costs
    for way, own in enumerate(_both(found[view], part)):
        seen = places[:, :, ROWS[part]]
        seen[view] = own
        met, _ = meeting(eyes, seen)
        for eye, one in zip(eyes, seen, strict=True):
            there, depth = eye.seen(met)
            squares = ((there - one) ** 2).sum(axis=2) * (depth / SIGMA_M) ** 2
            costs[:, way] += np.minimum(0.5 * np.nan_to_num(squares), MOST).sum(axis=1)
    return costs


def _both(places: FloatArray, part: int) -> FloatArray:
    """Return a part's places (2, T, M, 2) as found, of (T, J, 2), and exchanged."""
    return np.stack([places, places[:, exchanged(*PARTS[part])]])[:, :, ROWS[part]]


def _cost(costs: FloatArray, path: BoolArray) -> float:
    """Add up what a path (T,) costs; see `_jumps`."""
    now = path.astype(np.intp)
    last = np.append(now[:1], now[:-1])
    before = np.append(last[:1], last[:-1])
    paid = costs[np.arange(len(now)), before, last, now] - LOG_KEEP[last, now]
    return float(paid.sum() - LOG_START * path[0])


def _likeliest(costs: FloatArray) -> BoolArray:
    """Return the cheapest path (T,), true where sides are exchanged, through costs (T, 2, 2, 2); see `_jumps`."""
    n = len(costs)
    best, came = np.zeros((2, 2)), np.zeros((n, 2, 2), dtype=np.intp)
    best[0, 1], best[1, 0], best[1, 1] = np.inf, np.inf, -LOG_START  # before the first frame they are as in it
    for t in range(n):
        ways = best[:, :, None] + costs[t] - LOG_KEEP[None]  # two frames ago, one frame ago, now
        came[t] = ways.argmin(axis=0)
        best = ways.min(axis=0)
    path = np.zeros(n, dtype=bool)
    last, now = np.unravel_index(best.argmin(), best.shape)
    for t in range(n - 1, -1, -1):
        path[t] = bool(now)
        last, now = came[t, last, now], last
    return path
