"""Left and right that a detector exchanged, found by how joints move and by what other views show.

Arms and legs of each view are a hidden Markov chain with the states as detected and exchanged. Its most likely path
(Viterbi) has small second differences of the joints in the image and, with several cameras, rays that nearly meet.
"""

from collections.abc import Sequence

import numpy as np

from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.association.detections import HEIGHT_M, SIGMA_M, DetectorView, median_height, triangulate_places
from workbench.datasets.association.keypoint_kalman import ARMS, LEGS, exchanged
from workbench.utils.arrays import BoolArray, FloatArray

PARTS = (ARMS, LEGS)
_LOG_KEEP = np.log(np.array([[0.99, 0.01], [0.2, 0.8]]))
"""Log probabilities of sides as detected and exchanged (columns) after sides as detected and exchanged (rows)."""
_LOG_START = np.log(0.05)
"""Log odds of exchanged sides in the first frame."""
_ACCELERATION_M_S2 = 15.0
"""Standard deviation of a joint's acceleration, in addition to the detector's noise SIGMA_M."""
_MAX_COST = 4.5
"""Largest cost of a joint, nats: the detector may have placed it elsewhere."""
_MAX_CHANGES = 20
_ROWS = tuple(np.array([j for j, name in enumerate(JOINT_NAMES) if name.split("_")[-1] in part]) for part in PARTS)
"""Joints of the parts, in the order of JOINT_NAMES."""


def exchanged_sides(views: Sequence[DetectorView], joints: FloatArray, rate_hz: float) -> BoolArray:
    """Return where left and right are exchanged, (V, T, 2): in arms and legs of each of V views and T frames.

    joints: (V, T, J, 3), [u px, v px, confidence], NaN for what was not detected. The path of one part in one view is
    first found by how it moves alone, then given all others, the one that gains most first, until none gains.
    """
    places = np.array(
        [[view.detection(one).places for one in those] for view, those in zip(views, joints, strict=True)]
    )
    swapped = np.zeros((*joints.shape[:2], len(PARTS)), dtype=bool)
    moves = {(v, part): _motion_costs(places[v], part, rate_hz) for v, part in np.ndindex(len(views), len(PARTS))}
    for (v, part), costs in moves.items():
        swapped[v, :, part] = _cheapest(costs)
    for _ in range(_MAX_CHANGES if len(views) > 1 else 0):
        current, best_gain, best = undone(places, swapped), 1e-6, None
        for (v, part), costs in moves.items():
            total = costs + _ray_costs(views, current, places[v], v, part)[:, None, None, :]
            path = _cheapest(total)
            gain = _cost(total, swapped[v, :, part]) - _cost(total, path)
            if gain > best_gain:
                best_gain, best = gain, (v, part, path)
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


def _motion_costs(places: FloatArray, part: int, rate_hz: float) -> FloatArray:
    """Return costs (T, 2, 2, 2) of a part's sides two frames ago, one frame ago and now, by a view's places (T, J, 2):
    their second differences over what a person of HEIGHT_M may accelerate."""
    scale = HEIGHT_M / (median_height(places) or HEIGHT_M)
    scale /= np.hypot(np.sqrt(6.0) * SIGMA_M, _ACCELERATION_M_S2 / rate_hz**2)
    both, costs = _both(places, part), np.zeros((len(places), 2, 2, 2))
    for before, last, now in np.ndindex(2, 2, 2):
        costs[2:, before, last, now] = _robust(both[now, 2:] - 2.0 * both[last, 1:-1] + both[before, :-2], scale)
    return costs


def _ray_costs(
    views: Sequence[DetectorView], current: FloatArray, detected: FloatArray, v: int, part: int
) -> FloatArray:
    """Return costs (T, 2) of the sides of view v as detected (T, J, 2) and exchanged, by how nearly all views' rays
    meet, with the others' places as in `current`, (V, T, J, 2)."""
    costs = np.zeros((current.shape[1], 2))
    for state, own in enumerate(_both(detected, part)):
        seen = current[:, :, _ROWS[part]]
        seen[v] = own
        points, _ = triangulate_places(views, seen)
        for view, one in zip(views, seen, strict=True):
            there, depth = view.places(points)
            costs[:, state] += _robust(there - one, depth[..., None] / SIGMA_M)
    return costs


def _both(places: FloatArray, part: int) -> FloatArray:
    """Return a part's places (2, T, M, 2) as detected, of (T, J, 2), and exchanged."""
    return np.stack([places, places[:, exchanged(*PARTS[part])]])[:, :, _ROWS[part]]


def _robust(off: FloatArray, scale: FloatArray | float) -> FloatArray:
    """Return costs (T,) of joints' distances (T, M, 2), which are 0 where unknown, in standard deviations 1 / scale."""
    squares = np.nan_to_num(((off * scale) ** 2).sum(axis=2))
    return np.minimum(0.5 * squares, _MAX_COST).sum(axis=1)


def _cost(costs: FloatArray, path: BoolArray) -> float:
    """Return the cost of a path (T,); see `_motion_costs`."""
    now = path.astype(np.intp)
    last = np.append(now[:1], now[:-1])
    before = np.append(last[:1], last[:-1])
    paid = costs[np.arange(len(now)), before, last, now] - _LOG_KEEP[last, now]
    return float(paid.sum() - _LOG_START * path[0])


def _cheapest(costs: FloatArray) -> BoolArray:
    """Return the cheapest path (T,), true where exchanged, through costs (T, 2, 2, 2); see `_motion_costs`."""
    n = len(costs)
    best, came = np.zeros((2, 2)), np.zeros((n, 2, 2), dtype=np.intp)
    best[0, 1], best[1, 0], best[1, 1] = np.inf, np.inf, -_LOG_START  # before the first frame they are as in it
    for t in range(n):
        ways = best[:, :, None] + costs[t] - _LOG_KEEP[None]  # two frames ago, one frame ago, now
        came[t] = ways.argmin(axis=0)
        best = ways.min(axis=0)
    path = np.zeros(n, dtype=bool)
    last, now = np.unravel_index(best.argmin(), best.shape)
    for t in range(n - 1, -1, -1):
        path[t] = bool(now)
        last, now = came[t, last, now], last
    return path
