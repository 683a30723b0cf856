"""Forward tracking of several people by one optimal assignment of detections per frame and view.

View after view the detections are assigned to the people predicted there, or to nobody, at the highest likelihood
(global nearest neighbour), and the people's states are conditioned on them. Detections of nobody initiate tracks.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from workbench.datasets.association.detections import Detection, DetectorView
from workbench.datasets.association.keypoint_kalman import KeypointState, PredictedView, log_other, predict
from workbench.datasets.association.track_initiation import Place, initiate
from workbench.utils.arrays import FloatArray

GAP_S = 1.0
"""Time after which a person whom no view shows is assumed to have left."""
_LOG_MISSED, _LOG_SEEN = float(np.log(0.1)), float(np.log(0.9))
"""Log probability that a view does not show, or shows, a person."""
_SAME_M = 0.08
"""A person initiated this near to one who is seen is the same, detected twice."""

Frames = Sequence[Sequence[Sequence[Detection]]]
"""Detections by frame and view."""
Assignment = dict[Place, int]
"""The number of the person whom a detection shows."""


@dataclass(frozen=True, eq=False)
class Tracks:
    """People in T frames. assigned: whom the detections show. joints: estimates (J, D), m, by the person's number.
    log_odds: (T,) against exchanging the two most similar people in one view, inf for fewer than two."""

    assigned: tuple[Assignment, ...]
    joints: tuple[dict[int, FloatArray], ...]
    log_odds: FloatArray


@dataclass
class _Person:
    """seen_s: time when a view last showed them. places: their detections in the current frame."""

    state: KeypointState
    seen_s: float
    places: list[Place]


def track(views: Sequence[DetectorView], frames: Frames, times_s: FloatArray) -> Tracks:
    """Track everybody forwards through frames at rising times (T,), s."""
    people, n_people, last_s = dict[int, _Person](), 0, float(times_s[0]) if len(times_s) else 0.0
    assigned, joints, log_odds = list[Assignment](), list[dict[int, FloatArray]](), np.full(len(frames), np.inf)
    for t, now_s in enumerate(times_s.tolist()):
        for person in people.values():
            person.state, person.places = predict(person.state, now_s - last_s), []
        free = [{(v, row): one for row, one in enumerate(shown)} for v, shown in enumerate(frames[t])]
        for view, rest in zip(views, free, strict=True):
            log_odds[t] = min(log_odds[t], _assign(view, rest, list(people.values()), now_s))
        people = {number: person for number, person in people.items() if now_s - person.seen_s <= GAP_S}
        born = _new_people(views, free, [person.state.joints for person in people.values() if person.places], now_s)
        people |= dict(enumerate(born, n_people))
        n_people, last_s = n_people + len(born), now_s
        assigned.append({place: number for number, person in people.items() for place in person.places})
        joints.append({number: person.state.joints for number, person in people.items()})
    return Tracks(tuple(assigned), tuple(joints), log_odds)


def _assign(view: DetectorView, free: dict[Place, Detection], people: Sequence[_Person], now_s: float) -> float:
    """Assign one view's free detections to people or to nobody, condition the people on theirs, and remove these.

    Returns the smallest log odds against exchanging two of the people assigned.
    """
    if not free or not people:
        return np.inf
    predicted, places = [PredictedView(person.state, view) for person in people], list(free)
    matches = [[one.match(detection) for one in predicted] for detection in free.values()]
    n_people, n_places = len(people), len(places)
    costs = np.full((n_places, n_people + n_places), np.inf)
    costs[:, :n_people] = [[_LOG_MISSED - _LOG_SEEN - match.log_density for match in row] for row in matches]
    costs[np.arange(n_places), n_people + np.arange(n_places)] = [-log_other(one) for one in free.values()]
    columns = scipy.optimize.linear_sum_assignment(costs)[1]
    rows = np.flatnonzero(columns < n_people)
    for row, column in zip(rows, columns[rows], strict=True):
        person = people[column]
        person.state, person.seen_s = predicted[column].updated(matches[row][column]), now_s
        person.places.append(places[row])
        del free[places[row]]
    table = costs[np.ix_(rows, columns[rows])]
    odds = table + table.T - np.diag(table)[:, None] - np.diag(table)
    return float(odds[~np.eye(len(rows), dtype=bool)].min(initial=np.inf))


def _new_people(
    views: Sequence[DetectorView], free: Sequence[dict[Place, Detection]], here: Sequence[FloatArray], now_s: float
) -> list[_Person]:
    """Return the people whom free detections show, which are removed, except at joints (J, D) of people `here`."""
    born: list[_Person] = []
    for group, state in initiate(views, {place: one for rest in free for place, one in rest.items()}):
        if not any(np.median(np.linalg.norm(state.joints - other, axis=1)) < _SAME_M for other in here):
            born.append(_Person(state, now_s, list(group)))
            for place in group:
                del free[place[0]][place]
    for v, view in enumerate(views):  # which may show them although its rays alone did not suffice
        _assign(view, free[v], [person for person in born if v not in dict(person.places)], now_s)
    return born
