"""Correction of left/right labels by the joints' motion and by the other views.

The labels of arms and legs in each view are a hidden Markov chain: each part is "as detected" or "exchanged", and half
of the changes concern both, because a detector of whole people exchanges a person's sides at once. The most likely path
(Viterbi) has small second differences of the joints in the image, with several cameras small distances between rays,
and with world landmarks shoulders and hips whose left sides are on the same side of the body.
"""

from collections.abc import Sequence

import numpy as np

from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.triangulation import triangulate_normalized
from workbench.detections.association.detector_view import HEIGHT_M, SIGMA_M, DetectorView, median_height
from workbench.detections.association.keypoint_kalman import ARMS, LEGS, exchanged
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

PARTS = (ARMS, LEGS)
_STATES = np.array([[False, False], [False, True], [True, False], [True, True]])
"""Exchanged parts in each state of the chain."""
_EXCHANGE, _RETURN = 0.01, 0.5
"""Transition probabilities from labels as detected to exchanged ones and back: as a detector of single frames has no
memory, half of the exchanges end after a frame."""
_LOG_INITIAL = np.log([0.92, 0.02, 0.02, 0.04])
"""Log probabilities of the states in the first frame."""
_ACCELERATION_M_S2 = 15.0
"""Standard deviation of a joint's acceleration, in addition to the detector's noise SIGMA_M."""
_MAX_COST = 4.5
"""Largest cost of a joint, nats, for robustness against outliers."""
_TWIST_COST = np.log(0.87 / 0.13)
"""Of shoulders that are turned by over 90° from the hips by the world landmarks, nats: signs of depths by landmarks are
right in 80 to 93 % (see `landmark_depths`), and people twist by up to 60°. It is not a cost of exchanged legs, in which
the detector often has the hips right."""
_MAX_CHANGES = 20
_ROWS = tuple(np.array([j for j, name in enumerate(JOINT_NAMES) if name.split("_")[-1] in part]) for part in PARTS)
"""Joints of the parts, in the order of JOINT_NAMES."""


def exchanged_labels(views: Sequence[DetectorView], joints: FloatArray, rate_hz: float) -> BoolArray:
    """Return whether left and right are exchanged, (V, T, 2), in arms and legs of V views in T frames.

    Paths are first computed from each view's motion alone, then one at a time given all others, the one with the
    largest gain first, until there is no gain. joints: (V, T, J, 3), [u px, v px, confidence], or (V, T, J, 6) with
    world landmarks, see `People`; NaN without a detection.
    """
    places = np.array([[view.detection(one).places for one in rows] for view, rows in zip(views, joints, strict=True)])
    motion_costs = [_motion_costs(one, rate_hz) + _twist_costs(rows) for one, rows in zip(places, joints, strict=True)]
    states = np.array([_cheapest(costs) for costs in motion_costs])
    for _ in range(_MAX_CHANGES if len(views) > 1 else 0):
        current, best_gain, best = with_corrected_labels(places, _STATES[states]), 1e-6, None
        for v, costs in enumerate(motion_costs):
            total = costs + _ray_costs(views, current, places[v], v)[:, None, None, :]
            path = _cheapest(total)
            gain = _cost(total, states[v]) - _cost(total, path)
            if gain > best_gain:
                best_gain, best = gain, (v, path)
        if best is None:
            break
        states[best[0]] = best[1]
    return np.asarray(_STATES[states])


def with_corrected_labels(joints: FloatArray, swapped: BoolArray) -> FloatArray:
    """Return joints (V, T, J, 3) with left and right exchanged where `swapped` (V, T, 2)."""
    joints = joints.copy()
    for part, names in enumerate(PARTS):
        where = swapped[..., part]
        joints[where] = joints[where][:, exchanged(*names)]
    return joints


def _motion_costs(places: FloatArray, rate_hz: float) -> FloatArray:
    """Return costs (T, 4, 4, 4) of the states two frames ago, one frame ago and now: squared second differences of a
    view's places (T, J, 2), normalized by the accelerations of a person of HEIGHT_M."""
    scale = HEIGHT_M / (median_height(places) or HEIGHT_M)
    scale /= np.hypot(np.sqrt(6.0) * SIGMA_M, _ACCELERATION_M_S2 / rate_hz**2)
    by_part = np.zeros((len(PARTS), len(places), 2, 2, 2))
    for part, costs in enumerate(by_part):
        labelled = _both_labellings(places, part)
        for before, last, now in np.ndindex(2, 2, 2):
            differences = labelled[now, 2:] - 2.0 * labelled[last, 1:-1] + labelled[before, :-2]
            costs[2:, before, last, now] = _robust(differences, scale)
    before, last, now = np.ix_(*[range(len(_STATES))] * 3)
    labels = _STATES.astype(np.intp)
    return np.asarray(
        sum(costs[:, labels[before, k], labels[last, k], labels[now, k]] for k, costs in enumerate(by_part))
    )


def _twist_costs(joints: FloatArray) -> FloatArray:
    """Return costs (T, 1, 1, 4) of the states by the directions of shoulders and hips in one view's world landmarks, of
    joints (T, J, ≥ 6), none of joints (T, J, 3)."""
    costs = np.zeros((len(joints), 1, 1, len(_STATES)))
    if joints.shape[2] < 6:
        return costs
    sides = [[JOINT_NAMES.index(f"{side}_{joint}") for joint in ("shoulder", "hip")] for side in ("left", "right")]
    across = joints[:, sides[0], 3:6] - joints[:, sides[1], 3:6]
    agree = (across[:, 0] * across[:, 1]).sum(axis=1)  # NaN if unknown
    arms_only = _STATES[:, 0] & ~_STATES[:, 1]
    both_or_none = _STATES[:, 0] == _STATES[:, 1]
    costs[agree > 0.0, 0, 0] = _TWIST_COST * arms_only
    costs[agree < 0.0, 0, 0] = _TWIST_COST * both_or_none
    return costs


def _ray_costs(views: Sequence[DetectorView], current: FloatArray, detected: FloatArray, v: int) -> FloatArray:
    """Return costs (T, 4) of the states in view v, detected (T, J, 2): squared distances of all views' rays, with the
    other views' places in `current` (V, T, J, 2)."""
    by_part = np.zeros((len(PARTS), current.shape[1], 2))
    for part, costs in enumerate(by_part):
        for label, labelled in enumerate(_both_labellings(detected, part)):
            rows = current[:, :, _ROWS[part]]
            rows[v] = labelled
            points = triangulate_normalized([view.calibrated for view in views], rows)
            for view, one in zip(views, rows, strict=True):
                projected, depth = view.places(points)
                costs[:, label] += _robust(projected - one, depth[..., None] / SIGMA_M)
    return np.asarray(sum(costs[:, _STATES[:, k].astype(np.intp)] for k, costs in enumerate(by_part)))


def _both_labellings(places: FloatArray, part: int) -> FloatArray:
    """Return a part's places (2, T, M, 2) as detected, of (T, J, 2), and exchanged."""
    return np.stack([places, places[:, exchanged(*PARTS[part])]])[:, :, _ROWS[part]]


def _robust(differences: FloatArray, scale: FloatArray | float) -> FloatArray:
    """Return costs (T,) of joints' differences (T, M, 2), 0 where unknown, with standard deviations 1 / scale."""
    squares = np.nan_to_num(((differences * scale) ** 2).sum(axis=2))
    return np.minimum(0.5 * squares, _MAX_COST).sum(axis=1)


def _log_transition() -> FloatArray:
    """Return the log transition probabilities (4, 4) from states (rows) to states."""
    part = np.array([[1.0 - _EXCHANGE, _EXCHANGE], [_RETURN, 1.0 - _RETURN]])
    together = np.zeros((len(_STATES), len(_STATES)))
    for state, exchanged_parts in enumerate(_STATES):
        change = _RETURN if exchanged_parts.any() else _EXCHANGE
        together[state, state] = 1.0 - change
        together[state, 0 if exchanged_parts.any() else -1] = change
    return np.asarray(np.log(0.5 * np.kron(part, part) + 0.5 * together))


_LOG_TRANSITION = _log_transition()


def _cost(costs: FloatArray, path: IntArray) -> float:
    """Return the cost of a path (T,); see `_motion_costs`."""
    last = np.append(path[:1], path[:-1])
    before = np.append(last[:1], last[:-1])
    path_costs = costs[np.arange(len(path)), before, last, path] - _LOG_TRANSITION[last, path]
    return float(path_costs.sum() - _LOG_INITIAL[path[0]])


def _cheapest(costs: FloatArray) -> IntArray:
    """Return the cheapest path (T,) through costs (T, 4, 4, 4); see `_motion_costs`."""
    n, n_states = costs.shape[:2]
    previous = np.zeros((n, n_states, n_states), dtype=np.intp)
    # labels before the first frame equal those in it
    best = np.where(np.eye(n_states, dtype=bool), -_LOG_INITIAL, np.inf)
    for t in range(n):
        totals = best[:, :, None] + costs[t] - _LOG_TRANSITION[None]  # two frames ago, one frame ago, now
        previous[t] = totals.argmin(axis=0)
        best = totals.min(axis=0)
    path = np.zeros(n, dtype=np.intp)
    last, now = np.unravel_index(best.argmin(), best.shape)
    for t in range(n - 1, -1, -1):
        path[t] = now
        last, now = previous[t, last, now], last
    return path
