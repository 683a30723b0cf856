"""Who comes back: by where, after how long, and with limbs of what length."""

import numpy as np
from crowd_scenes import walkers

from workbench.datasets.association.assignment import Tracks
from workbench.datasets.association.track_stitching import stitched, without_short

RATE_HZ = 30.0


def tracks(*spans, n_frames=90):
    """Of people who stand, (body (J, 3), first frame, last frame), each a track of its own."""
    assigned, joints = [{} for _ in range(n_frames)], [{} for _ in range(n_frames)]
    for number, (body, first, last) in enumerate(spans):
        for t in range(first, last + 1):
            assigned[t][0, number] = number
            joints[t][number] = body
    return Tracks(tuple(assigned), tuple(joints), np.full(n_frames, np.inf)), np.arange(n_frames) / RATE_HZ


def who(*spans):
    """Whose the tracks turn out to be, None for nobody's."""
    tracked, times_s = tracks(*spans)
    found = stitched(without_short(tracked), times_s)
    return [found[first].get((0, number)) for number, (_, first, _) in enumerate(spans)]


SMALL, _, TALL = (one[0] for one in walkers([((0.0, 0.0), (1.0, 0.0))] * 3, 1))  # 1.65 m and 1.85 m


def test_who_comes_back_nearby_is_the_same_and_who_comes_far_off_at_once_is_not():
    assert who((SMALL, 0, 30), (SMALL + 0.3, 60, 80)) == [0, 0]
    assert who((SMALL, 0, 30), (SMALL + np.array([5.0, 0.0, 0.0]), 40, 80)) == [0, 1]


def test_of_two_who_left_each_comes_back_as_themselves():
    aside = np.array([0.4, 0.0, 0.0])
    spans = ((SMALL, 0, 30), (TALL + aside, 0, 30), (TALL + 0.5 * aside, 60, 80), (SMALL + 0.5 * aside, 60, 80))
    assert who(*spans) == [0, 1, 1, 0]


def test_who_is_there_at_the_same_time_is_somebody_else():
    assert who((SMALL, 0, 60), (SMALL + 0.2, 40, 80)) == [0, 1]


def test_who_is_hardly_seen_is_nobody():
    assert who((SMALL, 0, 60), (SMALL + 1.0, 20, 21)) == [0, None]
    assert who((SMALL, 3, 3)) == [0]
