"""When a person is lost and found again, in sequences made up by hand."""

import numpy as np
import pytest

from workbench.evaluation.events import Event, lost_and_found, lost_share

WIDTH = [10.0] * 20


def test_who_is_held_is_never_lost():
    assert lost_and_found([9.0] * 20, WIDTH) == []
    assert lost_share([9.0] * 20, WIDTH) == 0.0
    assert lost_and_found([], []) == []
    assert lost_share([], []) == 0.0


def test_one_bad_frame_loses_nobody():
    errors = [5.0] * 20
    errors[8] = 29.0  # the mean of five is then 9.8
    assert lost_and_found(errors, WIDTH) == []


def test_a_loss_and_a_find_are_dated_by_their_first_frames():
    errors = [2.0] * 6 + [40.0] * 8 + [2.0] * 6
    assert lost_and_found(errors, WIDTH) == [Event("lost", 6), Event("found", 14)]
    assert lost_share(errors, WIDTH) == pytest.approx(8 / 20)


def test_who_is_lost_to_the_end_and_from_the_beginning():
    assert lost_and_found([2.0] * 10 + [50.0] * 10, WIDTH) == [Event("lost", 10)]
    assert lost_share([2.0] * 10 + [50.0] * 10, WIDTH) == pytest.approx(0.5)
    assert lost_and_found([50.0] * 20, WIDTH) == [Event("lost", 0)]
    assert lost_share([50.0] * 2, WIDTH[:2]) == 1.0


def test_frames_without_a_truth_say_nothing():
    errors = [2.0] * 3 + [np.nan] * 4 + [40.0] * 6
    assert lost_and_found(errors, WIDTH[:13]) == [Event("lost", 7)]
    assert lost_and_found([np.nan] * 5, WIDTH[:5]) == []
