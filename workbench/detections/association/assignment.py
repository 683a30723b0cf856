"""Forward tracking of several people by one optimal assignment of detections per frame and view.

View after view, the maximum-likelihood assignment of detections to predicted people or to none (global nearest
neighbour) is computed, and the people's states are conditioned on theirs. Unassigned detections initiate tracks.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from workbench.detections.association.detector_view import Detection, DetectorView
from workbench.detections.association.keypoint_kalman import KeypointState, PredictedView, log_other, predict
from workbench.detections.association.track_initiation import Place, initiate
from workbench.utils.arrays import FloatArray

GAP_S = 1.0
"""Time without a detection after which a track ends."""
_LOG_UNDETECTED, _LOG_DETECTED = float(np.log(0.1)), float(np.log(0.9))
"""Log probability that a person is not detected, or is detected, in a view."""
_DUPLICATE_M = 0.08
"""A new track this near to a detected person is a duplicate detection."""

Frames = Sequence[Sequence[Sequence[Detection]]]
"""Detections by frame and view."""
Assignment = dict[Place, int]
"""Track numbers by detection."""


@dataclass(frozen=True, eq=False)
class Tracks:
    """Tracks in T frames.

    assigned: track numbers of detections. joints: estimates (J, D), m, by track number. log_odds: (T,) of the
    assignment against exchanging the two most similar people in one view; inf for fewer than two.
    """

    assigned: tuple[Assignment, ...]
    joints: tuple[dict[int, FloatArray], ...]
    log_odds: FloatArray


@dataclass
class _Person:
    """A track. detected_s: time of its latest detection. places: its detections in the current frame."""

    state: KeypointState
    detected_s: float
    places: list[Place]


def track(views: Sequence[DetectorView], frames: Frames, times_s: FloatArray) -> Tracks:
    """Track all people forwards through frames at increasing times (T,), s."""
    people, n_people, last_s = dict[int, _Person](), 0, float(times_s[0]) if len(times_s) else 0.0
    assigned, joints, log_odds = list[Assignment](), list[dict[int, FloatArray]](), np.full(len(frames), np.inf)
    for t, now_s in enumerate(times_s.tolist()):
        for person in people.values():
            person.state, person.places = predict(person.state, now_s - last_s), []
        free = [{(v, row): one for row, one in enumerate(detections)} for v, detections in enumerate(frames[t])]
        for view, unassigned in zip(views, free, strict=True):
            log_odds[t] = min(log_odds[t], _assign(view, unassigned, list(people.values()), now_s))
        people = {number: person for number, person in people.items() if now_s - person.detected_s <= GAP_S}
        new = _new_people(views, free, [person.state.joints for person in people.values() if person.places], now_s)
        people |= dict(enumerate(new, n_people))
        n_people, last_s = n_people + len(new), now_s
        assigned.append({place: number for number, person in people.items() for place in person.places})
        joints.append({number: person.state.joints for number, person in people.items()})
    return Tracks(tuple(assigned), tuple(joints), log_odds)


def _assign(view: DetectorView, free: dict[Place, Detection], people: Sequence[_Person], now_s: float) -> float:
    """Assign one view's unassigned detections to people or to none, and condition the people's states on theirs.

    Removes the assigned detections from `free` and returns the smallest log odds against exchanging two people.
    """
    if not free or not people:
        return np.inf
    predicted, places = [PredictedView(person.state, view) for person in people], list(free)
    matches = [one.matches(list(free.values())) for one in predicted]  # by person, then detection
    n_people, n_places = len(people), len(places)
    costs = np.full((n_places, n_people + n_places), np.inf)
    densities = np.array([[match.log_density for match in row] for row in matches])
    costs[:, :n_people] = _LOG_UNDETECTED - _LOG_DETECTED - densities.T
    costs[np.arange(n_places), n_people + np.arange(n_places)] = [-log_other(one) for one in free.values()]
    columns = scipy.optimize.linear_sum_assignment(costs)[1]
    rows = np.flatnonzero(columns < n_people)
    for row, column in zip(rows, columns[rows], strict=True):
        person = people[column]
        person.state, person.detected_s = predicted[column].updated(matches[column][row]), now_s
        person.places.append(places[row])
        del free[places[row]]
    table = costs[np.ix_(rows, columns[rows])]
    odds = table + table.T - np.diag(table)[:, None] - np.diag(table)
    return float(odds[~np.eye(len(rows), dtype=bool)].min(initial=np.inf))


def _new_people(
    views: Sequence[DetectorView], free: Sequence[dict[Place, Detection]], tracked: Sequence[FloatArray], now_s: float
) -> list[_Person]:
    """Return new people from detections in `free`, which are removed there, except at joints (J, D) in `tracked`."""
    new: list[_Person] = []
    for group, state in initiate(views, {place: one for unassigned in free for place, one in unassigned.items()}):
        if not any(np.median(np.linalg.norm(state.joints - other, axis=1)) < _DUPLICATE_M for other in tracked):
            new.append(_Person(state, now_s, list(group)))
            for place in group:
                del free[place[0]][place]
    for v, view in enumerate(views):  # detections whose rays did not suffice for initiation
        _assign(view, free[v], [person for person in new if v not in dict(person.places)], now_s)
    return new
