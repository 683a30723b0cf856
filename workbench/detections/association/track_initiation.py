"""Track initiation: grouping of unassigned detections in several cameras by the distances of their rays."""

from collections.abc import Mapping, Sequence

import numpy as np
import scipy

from workbench.cameras.triangulation import triangulate_normalized
from workbench.detections.association.detector_view import Detection, DetectorView
from workbench.detections.association.keypoint_kalman import KeypointState, initial_state
from workbench.utils.arrays import BoolArray, FloatArray

Place = tuple[int, int]
"""View and number of a detection in one frame."""
Group = tuple[Place, ...]
"""Detections of one person."""

_OTHER_SIGMA_M = 0.5
"""Standard deviation of the distance between rays to joints of two people."""
_OUTLIER_FRACTION = 0.05
"""Fraction of wrongly detected joints."""
_THRESHOLD = 5.0
"""Log odds, over all joints of two views, above which two detections are assumed to be of one person."""
_TRIANGULATED_M, _SINGLE_RAY_M = 0.1, 0.4
"""Standard deviations of a joint detected in two or more cameras, and of others around the mean of these."""


def initiate(views: Sequence[DetectorView], detections: Mapping[Place, Detection]) -> list[tuple[Group, KeypointState]]:
    """Return new people from unassigned detections: their detections and initial states.

    With several cameras a person needs two detections; in a single view every detection is a person.
    """
    if len(views) == 1:
        return [((place,), _state_in_image(one)) for place, one in detections.items() if one.detected.any()]
    groups = [group for group in _partition(_affinities(views, detections), list(detections)) if len(group) > 1]
    return [(group, _triangulated(views, {place: detections[place] for place in group})) for group in groups]


def _state_in_image(detection: Detection) -> KeypointState:
    detected, places = detection.detected, detection.places
    joints = np.where(detected[:, None], places, places[detected].mean(axis=0))
    return initial_state(joints, np.where(detected, detection.sigma, _SINGLE_RAY_M))


def _affinities(
    views: Sequence[DetectorView], detections: Mapping[Place, Detection]
) -> dict[tuple[Place, Place], float]:
    """Return the log odds that two detections in different views, the first before the second, are of one person.

    The distance between two rays to a joint has the detections' sigma for one person, except for outliers, and
    _OTHER_SIGMA_M for two people. Rays whose nearest points are behind a camera belong to two people.
    """
    rays = {place: views[place[0]].calibrated.directions(one.places) for place, one in detections.items()}
    affinities = dict[tuple[Place, Place], float]()
    for a, b in ((a, b) for a in rays for b in rays if a[0] < b[0]):
        baseline = views[b[0]].calibrated.position - views[a[0]].calibrated.position
        distance_m, ahead = _distances(rays[a], rays[b], baseline)
        common = np.isfinite(distance_m)
        sigma = np.hypot(detections[a].sigma, detections[b].sigma)[common]
        same = (1.0 - _OUTLIER_FRACTION) * _half_normal(distance_m[common], sigma) * ahead[common]
        different = _half_normal(distance_m[common], np.full(common.sum(), _OTHER_SIGMA_M))
        affinities[a, b] = float(np.log(same / different + _OUTLIER_FRACTION).sum()) - _THRESHOLD
    return affinities


def _half_normal(x: FloatArray, sigma: FloatArray) -> FloatArray:
    return np.sqrt(2.0 / np.pi) / sigma * np.exp(-0.5 * (x / sigma) ** 2)


def _distances(rays: FloatArray, others: FloatArray, between: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the distances (J,), m, of rays (J, 3) to others (J, 3), whose origin is offset by `between` (3,), m, and
    whether the nearest points are in front of both cameras, (J,)."""
    across = np.cross(rays, others)
    squares = np.maximum((across**2).sum(axis=1), 1e-9)
    ahead = [(np.cross(between, ray) * across).sum(axis=1) / squares > 0.0 for ray in (rays, others)]
    return np.abs(across @ between) / np.sqrt(squares), ahead[0] & ahead[1]


def _partition(affinities: Mapping[tuple[Place, Place], float], places: Sequence[Place]) -> list[Group]:
    """Return groups of at most one detection per view: view after view, detections join groups or start new ones."""
    groups: list[Group] = []
    for view in sorted({view for view, _ in places}):
        in_view = [place for place in places if place[0] == view]
        gains = [[sum(affinities[other, place] for other in group) for group in groups] for place in in_view]
        costs = np.full((len(in_view), len(groups) + len(in_view)), np.inf)
        costs[:, : len(groups)] = -np.array(gains).reshape(len(in_view), -1)
        np.fill_diagonal(costs[:, len(groups) :], 0.0)
        groups += [()] * len(in_view)
        for row, column in zip(*scipy.optimize.linear_sum_assignment(costs), strict=True):
            groups[column] = (*groups[column], in_view[row])
        groups = [group for group in groups if group]
    return groups


def _triangulated(views: Sequence[DetectorView], detections: Mapping[Place, Detection]) -> KeypointState:
    """Return the state with triangulated joints; joints with fewer than two rays are at the mean of the others."""
    places = np.stack([one.places for one in detections.values()])
    joints = triangulate_normalized([views[view].calibrated for view, _ in detections], places)
    triangulated = np.isfinite(places[..., 0]).sum(axis=0) > 1
    joints[~triangulated] = joints[triangulated].mean(axis=0)
    return initial_state(joints, np.where(triangulated, _TRIANGULATED_M, _SINGLE_RAY_M))
