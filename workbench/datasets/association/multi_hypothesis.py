"""Who is who in all views and frames: multiple hypotheses about whom every detection shows (Reid 1979).

A hypothesis says of every detection so far whose it is, or nobody's. View after view of a frame it is extended by the
likeliest assignments of detections to the people believed to be there; those that are far less likely than the best are
given up. While two people cannot be told apart, both ways to tell them are followed, and what is seen later decides.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.datasets.association.assignment import best_assignments
from workbench.datasets.association.detections import Detection, Eye
from workbench.datasets.association.keypoint_kalman import Belief, Expected, Match, log_other, predict
from workbench.datasets.association.track_initiation import Group, Place, newcomers
from workbench.utils.arrays import FloatArray

LOG_MISSED, LOG_SEEN = float(np.log(0.1)), float(np.log(0.9))
"""Of a person whom a view does not show, or shows."""
LOG_NEW = -5.0
"""Of a person who appears."""
GAP_S = 1.0
"""Time after which a person whom nobody sees is taken to have left."""
UNLIKELY = 10.0
"""Log odds against the best at which a hypothesis is given up."""
N_HYPOTHESES = 8
DECIDED_S = 1.0
"""What was decided earlier than this is not decided otherwise any more."""
SAME_M = 0.08
"""Nobody appears so near to somebody who is seen: it is the same person, found twice."""

Assigned = dict[Place, int]
"""Whose a detection is."""


@dataclass(frozen=True, eq=False)
class Person:
    """number: who. belief: where. seen_s: when they were last seen, s."""

    number: int
    belief: Belief
    seen_s: float


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """log_odds: against the other hypotheses. people: who is there. assigned: whose this frame's detections are.
    before: the hypothesis about the frames up to the last one. n_people: how many there ever were."""

    log_odds: float
    people: tuple[Person, ...] = ()
    assigned: Assigned | None = None
    before: "Hypothesis | None" = None
    n_people: int = 0


@dataclass(frozen=True, eq=False)
class Tracked:
    """Whose the detections of T frames are, and where everybody was then: (J, D), m, by number. rival: log odds of the
    likeliest other way to see it that is left at the end, -inf for none."""

    assigned: tuple[Assigned, ...]
    joints: tuple[dict[int, FloatArray], ...]
    rival: float


def track(eyes: Sequence[Eye], frames: Iterable[Sequence[Sequence[Detection]]], times_s: FloatArray) -> Tracked:
    """Tell whom the detections of every frame and view show.

    frames: at times (T,), s, rising; the detections of each view.
    """
    kept, last_s = [Hypothesis(0.0)], None
    n_decided = max(1, int(DECIDED_S / np.median(np.diff(times_s)))) if len(times_s) > 1 else 1
    for views, now_s in zip(frames, times_s, strict=True):
        step = _Frame(eyes, views, float(now_s), 0.0 if last_s is None else float(now_s) - last_s)
        kept = _agreeing(_likeliest([after for before in kept for after in step.after(before)]), n_decided)
        kept = [replace(one, log_odds=one.log_odds - kept[0].log_odds) for one in kept]
        last_s = float(now_s)
    history = _history(kept[0])
    return Tracked(
        tuple(one.assigned or {} for one in history),
        tuple({person.number: person.belief.joints for person in one.people} for one in history),
        kept[1].log_odds if len(kept) > 1 else -np.inf,
    )


class _Frame:
    """One frame's detections, and what they say of people; whatever hypotheses share is computed once."""

    def __init__(self, eyes: Sequence[Eye], views: Sequence[Sequence[Detection]], now_s: float, dt_s: float) -> None:
        self._eyes, self._views, self._now_s, self._dt_s = eyes, views, now_s, dt_s
        self._predicted: dict[Person, Person] = {}
        self._expected: dict[tuple[Person, int], Expected] = {}
        self._matches: dict[tuple[Person, Place], Match] = {}
        self._updated: dict[tuple[Person, Place], Person] = {}

    def after(self, before: Hypothesis) -> list[Hypothesis]:
        """Extend a hypothesis by this frame, in the likeliest ways."""
        people = tuple(self._predict(person) for person in before.people)
        kept = [Hypothesis(before.log_odds, people, {}, before, before.n_people)]
        for view in range(len(self._eyes)):
            kept = _likeliest([more for one in kept for more in self._seen_by(view, one)])
        return [self._with_newcomers(one) for one in kept]

    def _predict(self, person: Person) -> Person:
        if person not in self._predicted:
            self._predicted[person] = replace(person, belief=predict(person.belief, self._dt_s))
        return self._predicted[person]

    def _seen_by(self, view: int, before: Hypothesis) -> list[Hypothesis]:
        """Assign a view's detections to those who are there, or to nobody."""
        people, detections = before.people, self._views[view]
        log_odds = before.log_odds + LOG_MISSED * len(people)
        if not detections:
            return [replace(before, log_odds=log_odds)]
        costs = np.full((len(detections), len(people) + len(detections)), np.inf)
        for row, detection in enumerate(detections):
            for column, person in enumerate(people):
                match = self._match(person, (view, row))
                costs[row, column] = LOG_MISSED - LOG_SEEN - match.log_density
            costs[row, len(people) + row] = -log_other(detection)
        found, least = list[Hypothesis](), None
        for cost, columns in best_assignments(costs):
            least = cost if least is None else least
            if cost > least + UNLIKELY or len(found) == N_HYPOTHESES:
                break
            pairs = {(view, row): int(column) for row, column in enumerate(columns) if column < len(people)}
            after = list(people)
            for place, column in pairs.items():
                after[column] = self._update(people[column], place)
            assigned = (before.assigned or {}) | {place: people[column].number for place, column in pairs.items()}
            found.append(replace(before, log_odds=log_odds - cost, people=tuple(after), assigned=assigned))
        return found

    def _match(self, person: Person, place: Place) -> Match:
        view, row = place
        if (person, view) not in self._expected:
            self._expected[person, view] = Expected(person.belief, self._eyes[view])
        if (person, place) not in self._matches:
            self._matches[person, place] = self._expected[person, view].match(self._views[view][row])
        return self._matches[person, place]

    def _update(self, person: Person, place: Place) -> Person:
        if (person, place) not in self._updated:
            belief = self._expected[person, place[0]].updated(self._matches[person, place])
            self._updated[person, place] = Person(person.number, belief, self._now_s)
        return self._updated[person, place]

    def _with_newcomers(self, one: Hypothesis) -> Hypothesis:
        """Add those whom detections of nobody show, and take out those whom nobody has seen for long."""
        assigned, born = dict(one.assigned or {}), list[tuple[Person, Group]]()
        people = [person for person in one.people if self._now_s - person.seen_s <= GAP_S]
        here = [person.belief.joints for person in people if person.seen_s == self._now_s]
        free = {
            (view, row): detection for view, detections in enumerate(self._views)
            for row, detection in enumerate(detections) if (view, row) not in assigned
        }  # fmt: skip
        for places, belief in newcomers(self._eyes, free) if free else ():
            if not any(np.median(np.linalg.norm(belief.joints - other, axis=1)) < SAME_M for other in here):
                born.append((Person(one.n_people + len(born), belief, self._now_s), places))
                assigned |= dict.fromkeys(places, born[-1][0].number)
        for person, places in born:
            for view in sorted(set(range(len(self._eyes))) - {view for view, _ in places}):
                person = self._also_seen_by(view, person, assigned)
            people.append(person)
        log_odds, n_people = one.log_odds + LOG_NEW * len(born), one.n_people + len(born)
        return replace(one, log_odds=log_odds, people=tuple(people), assigned=assigned, n_people=n_people)

    def _also_seen_by(self, view: int, person: Person, assigned: Assigned) -> Person:
        """Give a newcomer the detection of nobody that fits best in a view whose rays alone did not say so."""
        free = [(view, row) for row in range(len(self._views[view])) if (view, row) not in assigned]
        gains = [self._match(person, place).log_density - log_other(self._views[view][place[1]]) for place in free]
        if not gains or max(gains) <= 0.0:
            return person
        place = free[int(np.argmax(gains))]
        assigned[place] = person.number
        return self._update(person, place)


def _likeliest(hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    ordered = sorted(hypotheses, key=lambda one: -one.log_odds)[:N_HYPOTHESES]
    return [one for one in ordered if one.log_odds > ordered[0].log_odds - UNLIKELY]


def _agreeing(kept: Sequence[Hypothesis], n_frames: int) -> list[Hypothesis]:
    """Keep those that have the likeliest one's view of what was n frames ago."""
    then = [_earlier(one, n_frames) for one in kept]
    return [one for one, before in zip(kept, then, strict=True) if before is then[0]]


def _earlier(one: Hypothesis, n_frames: int) -> Hypothesis | None:
    before: Hypothesis | None = one
    for _ in range(n_frames):
        before = None if before is None else before.before
    return before


def _history(last: Hypothesis) -> list[Hypothesis]:
    """Return a hypothesis about every frame, the first one first."""
    history, one = list[Hypothesis](), last
    while one.before is not None:
        history.append(one)
        one = one.before
    return history[::-1]
