"""Correction of left/right labels by the joints' motion and by the other views.

The labels of arms and legs in each view are a hidden Markov chain with the states "as detected" and "exchanged". Its
most likely path (Viterbi) has small second differences of the joints in the image and, with several cameras, small
distances between rays.
"""

from collections.abc import Sequence

import numpy as np

from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.association.detections import HEIGHT_M, SIGMA_M, DetectorView, median_height, triangulate_places
from workbench.datasets.association.keypoint_kalman import ARMS, LEGS, exchanged
from workbench.utils.arrays import BoolArray, FloatArray

PARTS = (ARMS, LEGS)
_LOG_TRANSITION = np.log(np.array([[0.99, 0.01], [0.2, 0.8]]))
"""Log transition probabilities from labels as detected and exchanged (rows) to both (columns)."""
_LOG_INITIAL = np.log(0.05)
"""Log odds of exchanged labels in the first frame."""
_ACCELERATION_M_S2 = 15.0
"""Standard deviation of a joint's acceleration, in addition to the detector's noise SIGMA_M."""
_MAX_COST = 4.5
"""Largest cost of a joint, nats, for robustness against outliers."""
_MAX_CHANGES = 20
_ROWS = tuple(np.array([j for j, name in enumerate(JOINT_NAMES) if name.split("_")[-1] in part]) for part in PARTS)
"""Joints of the parts, in the order of JOINT_NAMES."""


def exchanged_labels(views: Sequence[DetectorView], joints: FloatArray, rate_hz: float) -> BoolArray:
    """Return whether left and right are exchanged, (V, T, 2), in arms and legs of V views in T frames.

    Paths are first computed from each part's motion alone, then one at a time given all others, the one with the
    largest gain first, until there is no gain. joints: (V, T, J, 3), [u px, v px, confidence]; NaN without a detection.
    """
    places = np.array([[view.detection(one).places for one in rows] for view, rows in zip(views, joints, strict=True)])
    swapped = np.zeros((*joints.shape[:2], len(PARTS)), dtype=bool)
    parts = [*np.ndindex(len(views), len(PARTS))]
    motion_costs = {(v, part): _motion_costs(places[v], part, rate_hz) for v, part in parts}
    for (v, part), costs in motion_costs.items():
        swapped[v, :, part] = _cheapest(costs)
    for _ in range(_MAX_CHANGES if len(views) > 1 else 0):
        current, best_gain, best = with_corrected_labels(places, swapped), 1e-6, None
        for (v, part), costs in motion_costs.items():
            total = costs + _ray_costs(views, current, places[v], v, part)[:, None, None, :]
            path = _cheapest(total)
            gain = _cost(total, swapped[v, :, part]) - _cost(total, path)
            if gain > best_gain:
                best_gain, best = gain, (v, part, path)
        if best is None:
            break
        swapped[best[0], :, best[1]] = best[2]
    return swapped


def with_corrected_labels(joints: FloatArray, swapped: BoolArray) -> FloatArray:
    """Return joints (V, T, J, 3) with left and right exchanged where `swapped` (V, T, 2)."""
    joints = joints.copy()
    for part, names in enumerate(PARTS):
        where = swapped[..., part]
        joints[where] = joints[where][:, exchanged(*names)]
    return joints


def _motion_costs(places: FloatArray, part: int, rate_hz: float) -> FloatArray:
    """Return costs (T, 2, 2, 2) of a part's labels two frames ago, one frame ago and now: squared second
    differences of a view's places (T, J, 2), normalized by the accelerations of a person of HEIGHT_M."""
    scale = HEIGHT_M / (median_height(places) or HEIGHT_M)
    scale /= np.hypot(np.sqrt(6.0) * SIGMA_M, _ACCELERATION_M_S2 / rate_hz**2)
    labelled, costs = _both_labellings(places, part), np.zeros((len(places), 2, 2, 2))
    for before, last, now in np.ndindex(2, 2, 2):
        differences = labelled[now, 2:] - 2.0 * labelled[last, 1:-1] + labelled[before, :-2]
        costs[2:, before, last, now] = _robust(differences, scale)
    return costs


def _ray_costs(
    views: Sequence[DetectorView], current: FloatArray, detected: FloatArray, v: int, part: int
) -> FloatArray:
    """Return costs (T, 2) of a part's labels in view v as detected (T, J, 2) and exchanged: squared distances of all
    views' rays, with the other views' places in `current` (V, T, J, 2)."""
    costs = np.zeros((current.shape[1], 2))
    for state, labelled in enumerate(_both_labellings(detected, part)):
        rows = current[:, :, _ROWS[part]]
        rows[v] = labelled
        points, _ = triangulate_places(views, rows)
        for view, one in zip(views, rows, strict=True):
            projected, depth = view.places(points)
            costs[:, state] += _robust(projected - one, depth[..., None] / SIGMA_M)
    return costs


def _both_labellings(places: FloatArray, part: int) -> FloatArray:
    """Return a part's places (2, T, M, 2) as detected, of (T, J, 2), and exchanged."""
    return np.stack([places, places[:, exchanged(*PARTS[part])]])[:, :, _ROWS[part]]


def _robust(differences: FloatArray, scale: FloatArray | float) -> FloatArray:
    """Return costs (T,) of joints' differences (T, M, 2), 0 where unknown, with standard deviations 1 / scale."""
    squares = np.nan_to_num(((differences * scale) ** 2).sum(axis=2))
    return np.minimum(0.5 * squares, _MAX_COST).sum(axis=1)


def _cost(costs: FloatArray, path: BoolArray) -> float:
    """Return the cost of a path (T,); see `_motion_costs`."""
    now = path.astype(np.intp)
    last = np.append(now[:1], now[:-1])
    before = np.append(last[:1], last[:-1])
    path_costs = costs[np.arange(len(now)), before, last, now] - _LOG_TRANSITION[last, now]
    return float(path_costs.sum() - _LOG_INITIAL * path[0])


def _cheapest(costs: FloatArray) -> BoolArray:
    """Return the cheapest path (T,), true where exchanged, through costs (T, 2, 2, 2); see `_motion_costs`."""
    n = len(costs)
    best, previous = np.zeros((2, 2)), np.zeros((n, 2, 2), dtype=np.intp)
    # labels before the first frame equal those in it
    best[0, 1], best[1, 0], best[1, 1] = np.inf, np.inf, -_LOG_INITIAL
    for t in range(n):
        totals = best[:, :, None] + costs[t] - _LOG_TRANSITION[None]  # two frames ago, one frame ago, now
        previous[t] = totals.argmin(axis=0)
        best = totals.min(axis=0)
    path = np.zeros(n, dtype=bool)
    last, now = np.unravel_index(best.argmin(), best.shape)
    for t in range(n - 1, -1, -1):
        path[t] = bool(now)
        last, now = previous[t, last, now], last
    return path
