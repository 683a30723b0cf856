"""Who is new in a frame: detections of several cameras that can be of one person, by where their rays meet."""

from collections.abc import Mapping, Sequence

import numpy as np

from workbench.datasets.association.assignment import best_assignments
from workbench.datasets.association.detections import Detection, Eye, meeting
from workbench.datasets.association.keypoint_kalman import Belief, born
from workbench.utils.arrays import BoolArray, FloatArray

Place = tuple[int, int]
"""View and number of a detection in one frame."""
Group = tuple[Place, ...]
"""Detections of one person."""

PASS_SIGMA_M = 0.5
"""By how much rays to joints of two people miss each other."""
ASTRAY = 0.05
"""Part of the joints that a detector puts elsewhere."""
SURE = 5.0
"""Log odds, over all joints of two views, from which on they are taken to show one person."""
N_KEPT = 20
"""Partitions that are kept from view to view."""
MET_M, ALONE_M = 0.1, 0.4
"""Standard deviations of a joint that two cameras show or more, and of others about the middle of these."""


def newcomers(eyes: Sequence[Eye], detections: Mapping[Place, Detection]) -> list[tuple[Group, Belief]]:
    """Find people in detections that are nobody's so far: which are theirs, and where they are.

    With cameras a person is seen by two at least; a single view shows as many people as detections.
    """
    if len(eyes) == 1:
        return [((place,), _flat(one)) for place, one in detections.items() if one.found.any()]
    groups = [group for group in _partition(_affinities(eyes, detections), list(detections)) if len(group) > 1]
    return [(group, _triangulated(eyes, {place: detections[place] for place in group})) for group in groups]


def _flat(detection: Detection) -> Belief:
    found, places = detection.found, detection.places
    joints = np.where(found[:, None], places, places[found].mean(axis=0))
    return born(joints, np.where(found, detection.sigma, ALONE_M))


def _affinities(eyes: Sequence[Eye], detections: Mapping[Place, Detection]) -> dict[tuple[Place, Place], float]:
    """Return the log odds, for every pair of different views, the first before the second, that they show one person.

    Under one person the rays to a joint miss each other by the detections' sigma, but for those astray; under two by
    PASS_SIGMA_M. Rays that would meet behind a camera are of two people.
    """
    rays = {place: eyes[place[0]].rays(one.places) for place, one in detections.items()}
    sigma = {place: one.sigma for place, one in detections.items()}
    found = dict[tuple[Place, Place], float]()
    for a, b in ((a, b) for a in rays for b in rays if a[0] < b[0]):
        apart_m, ahead = _misses(rays[a], rays[b], eyes[b[0]].position - eyes[a[0]].position)
        both = np.isfinite(apart_m)
        one = (1.0 - ASTRAY) * _half_normal(apart_m[both], np.hypot(sigma[a], sigma[b])[both]) * ahead[both]
        two = _half_normal(apart_m[both], np.full(both.sum(), PASS_SIGMA_M))
        found[a, b] = float(np.log(one / two + ASTRAY).sum()) - SURE
    return found


def _half_normal(x: FloatArray, sigma: FloatArray) -> FloatArray:
    return np.sqrt(2.0 / np.pi) / sigma * np.exp(-0.5 * (x / sigma) ** 2)


def _misses(rays: FloatArray, others: FloatArray, between: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the least distances (J,), m, of rays (J, 3) to others (J, 3) that start `between` (3,), m, away from them,
    and whether (J,) that is ahead on both."""
    across = np.cross(rays, others)
    squares = np.maximum((across**2).sum(axis=1), 1e-9)
    apart = np.abs(across @ between) / np.sqrt(squares)
    ahead = [(np.cross(between, ray) * across).sum(axis=1) / squares > 0.0 for ray in (rays, others)]
    return apart, ahead[0] & ahead[1]


def _partition(affinities: Mapping[tuple[Place, Place], float], places: Sequence[Place]) -> tuple[Group, ...]:
    """Return the groups, of one detection a view at most, whose pairs have the highest log odds together.

    View after view its detections join groups or found their own; the N_KEPT best ways to do so are followed.
    """
    beams: list[tuple[float, tuple[Group, ...]]] = [(0.0, ())]
    for view in sorted({view for view, _ in places}):
        own = [place for place in places if place[0] == view]
        following = list[tuple[float, tuple[Group, ...]]]()
        for cost, groups in beams:
            costs = np.full((len(own), len(groups) + len(own)), np.inf)
            for row, place in enumerate(own):
                costs[row, : len(groups)] = [-sum(affinities[other, place] for other in group) for group in groups]
                costs[row, len(groups) + row] = 0.0
            for number, (more, columns) in enumerate(best_assignments(costs)):
                if number == N_KEPT:
                    break
                grown = [*groups, *[()] * len(own)]
                for place, column in zip(own, columns, strict=True):
                    grown[column] = (*grown[column], place)
                following.append((cost + more, tuple(group for group in grown if group)))
        beams = sorted(following, key=lambda beam: beam[0])[:N_KEPT]
    return beams[0][1]


def _triangulated(eyes: Sequence[Eye], detections: Mapping[Place, Detection]) -> Belief:
    """Believe every joint where its rays pass each other nearest, those of one ray about the middle of the others."""
    places = np.stack([one.places for one in detections.values()])
    joints, n_rays = meeting([eyes[view] for view, _ in detections], places)
    met = n_rays > 1
    joints[~met] = joints[met].mean(axis=0)
    return born(joints, np.where(met, MET_M, ALONE_M))
