"""Track initiation: unassigned detections of several cameras that can be of one person, by where their rays meet."""

from collections.abc import Mapping, Sequence

import numpy as np
import scipy

from workbench.datasets.association.detections import Detection, DetectorView, triangulate_places
from workbench.datasets.association.keypoint_kalman import KeypointState, initial_state
from workbench.utils.arrays import BoolArray, FloatArray

Place = tuple[int, int]
"""View and number of a detection in one frame."""
Group = tuple[Place, ...]
"""Detections of one person."""

_OTHER_SIGMA_M = 0.5
"""Standard deviation of the distance between rays to joints of two people."""
_ASTRAY = 0.05
"""Fraction of wrongly detected joints."""
_THRESHOLD = 5.0
"""Log odds, over all joints of two views, above which they are assumed to show one person."""
_MET_M, _ALONE_M = 0.1, 0.4
"""Standard deviations of a joint that two cameras show or more, and of others about the middle of these."""


def initiate(views: Sequence[DetectorView], detections: Mapping[Place, Detection]) -> list[tuple[Group, KeypointState]]:
    """Return the people shown by unassigned detections: which are theirs, and their states.

    With several cameras a person is seen by two at least; a single view shows as many people as detections.
    """
    if len(views) == 1:
        return [((place,), _state_in_image(one)) for place, one in detections.items() if one.detected.any()]
    groups = [group for group in _partition(_affinities(views, detections), list(detections)) if len(group) > 1]
    return [(group, _triangulated(views, {place: detections[place] for place in group})) for group in groups]


def _state_in_image(detection: Detection) -> KeypointState:
    detected, places = detection.detected, detection.places
    joints = np.where(detected[:, None], places, places[detected].mean(axis=0))
    return initial_state(joints, np.where(detected, detection.sigma, _ALONE_M))


def _affinities(
    views: Sequence[DetectorView], detections: Mapping[Place, Detection]
) -> dict[tuple[Place, Place], float]:
    """Return the log odds, for every pair of different views, the first before the second, that they show one person.

    The distance between two rays to a joint has the detections' sigma for one person, but for wrongly detected joints,
    and _OTHER_SIGMA_M for two. Rays that would meet behind a camera are of two people.
    """
    rays = {place: views[place[0]].rays(one.places) for place, one in detections.items()}
    affinities = dict[tuple[Place, Place], float]()
    for a, b in ((a, b) for a in rays for b in rays if a[0] < b[0]):
        distance_m, ahead = _distances(rays[a], rays[b], views[b[0]].position - views[a[0]].position)
        both = np.isfinite(distance_m)
        sigma = np.hypot(detections[a].sigma, detections[b].sigma)[both]
        one = (1.0 - _ASTRAY) * _half_normal(distance_m[both], sigma) * ahead[both]
        two = _half_normal(distance_m[both], np.full(both.sum(), _OTHER_SIGMA_M))
        affinities[a, b] = float(np.log(one / two + _ASTRAY).sum()) - _THRESHOLD
    return affinities


def _half_normal(x: FloatArray, sigma: FloatArray) -> FloatArray:
    return np.sqrt(2.0 / np.pi) / sigma * np.exp(-0.5 * (x / sigma) ** 2)


def _distances(rays: FloatArray, others: FloatArray, between: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the distances (J,), m, of rays (J, 3) to others (J, 3) that start `between` (3,), m, away from them, and
    whether the nearest points are in front of both cameras, (J,)."""
    across = np.cross(rays, others)
    squares = np.maximum((across**2).sum(axis=1), 1e-9)
    ahead = [(np.cross(between, ray) * across).sum(axis=1) / squares > 0.0 for ray in (rays, others)]
    return np.abs(across @ between) / np.sqrt(squares), ahead[0] & ahead[1]


def _partition(affinities: Mapping[tuple[Place, Place], float], places: Sequence[Place]) -> list[Group]:
    """Return groups of at most one detection a view: view after view, detections join groups or begin their own."""
    groups: list[Group] = []
    for view in sorted({view for view, _ in places}):
        own = [place for place in places if place[0] == view]
        gains = [[sum(affinities[other, place] for other in group) for group in groups] for place in own]
        costs = np.full((len(own), len(groups) + len(own)), np.inf)
        costs[:, : len(groups)] = -np.array(gains).reshape(len(own), -1)
        np.fill_diagonal(costs[:, len(groups) :], 0.0)
        groups += [()] * len(own)
        for row, column in zip(*scipy.optimize.linear_sum_assignment(costs), strict=True):
            groups[column] = (*groups[column], own[row])
        groups = [group for group in groups if group]
    return groups


def _triangulated(views: Sequence[DetectorView], detections: Mapping[Place, Detection]) -> KeypointState:
    """Return the state with every joint nearest to its rays, those of one ray about the middle of the others."""
    places = np.stack([one.places for one in detections.values()])
    joints, n_rays = triangulate_places([views[view] for view, _ in detections], places)
    met = n_rays > 1
    joints[~met] = joints[met].mean(axis=0)
    return initial_state(joints, np.where(met, _MET_M, _ALONE_M))
