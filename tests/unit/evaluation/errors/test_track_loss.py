"""Losses and recoveries of a track in constructed error sequences."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from workbench.evaluation.errors.track_loss import (
    TRACKED_MM,
    TrackEvent,
    criteria,
    lost_frames,
    lost_states,
    track_events,
    track_metrics,
)

WIDTH = [10.0] * 20


def test_small_errors_are_no_loss():
    assert track_events([9.0] * 20, WIDTH) == []
    assert lost_states([9.0] * 20, WIDTH).mean() == 0.0
    assert track_events([], []) == []
    assert not len(lost_states([], []))


def test_one_large_error_is_no_loss():
    errors = [5.0] * 20
    errors[8] = 29.0  # the mean of five frames is 9.8
    assert track_events(errors, WIDTH) == []


def test_losses_and_recoveries_start_with_their_first_frames():
    errors = [2.0] * 6 + [40.0] * 8 + [2.0] * 6
    assert track_events(errors, WIDTH) == [TrackEvent("lost", 6), TrackEvent("recovered", 14)]
    assert lost_states(errors, WIDTH).mean() == pytest.approx(8 / 20)


def test_losses_at_the_end_and_from_the_beginning():
    assert track_events([2.0] * 10 + [50.0] * 10, WIDTH) == [TrackEvent("lost", 10)]
    assert lost_states([2.0] * 10 + [50.0] * 10, WIDTH).mean() == pytest.approx(0.5)
    assert track_events([50.0] * 20, WIDTH) == [TrackEvent("lost", 0)]
    assert lost_states([50.0] * 2, WIDTH[:2]).mean() == 1.0


def test_frames_without_truth_are_ignored():
    errors = [2.0] * 3 + [np.nan] * 4 + [40.0] * 6
    assert track_events(errors, WIDTH[:13]) == [TrackEvent("lost", 7)]
    assert track_events([np.nan] * 5, WIDTH[:5]) == []


def test_a_recovery_follows_its_loss():
    errors = [9.0, 0.0, 0.0, 0.0, 42.0, 0.0, 0.0, 0.0]  # the window after frame 4 is below the threshold again
    assert track_events(errors, WIDTH[:8]) == [TrackEvent("lost", 4), TrackEvent("recovered", 5)]
    assert lost_states(errors, WIDTH[:8]).mean() == pytest.approx(1 / 8)


@given(st.lists(st.sampled_from([0.0, 15.0, 21.0, 60.0]), max_size=30))
def test_losses_and_recoveries_alternate_in_the_order_of_frames(errors):
    events = track_events(errors, [20.0] * len(errors))
    frames = [event.frame for event in events]
    assert frames == sorted(set(frames))
    assert [event.kind for event in events] == ["lost", "recovered"] * (len(events) // 2) + ["lost"] * (len(events) % 2)
    assert lost_states(errors, [20.0] * len(errors)).any() == bool(events)


def test_a_track_is_lost_by_the_image_and_by_the_root_aligned_error():
    near, far, n = [2.0] * 10, [2.0] * 5 + [50.0] * 5, 10
    tracked = {"mpjpe_px": near, "forearm_width_px": [20.0] * n, "mpjpe_mm": [100.0] * n, "mpjpe_abs_mm": [100.0] * n}
    lost = {"mpjpe_px": far}, {"mpjpe_mm": [100.0] * 5 + [250.0] * 5}
    for errors in (*(tracked | change for change in lost), {"mpjpe_abs_mm": [100.0] * 5 + [400.0] * 5}):
        assert lost_frames(errors).tolist() == [False] * 5 + [True] * 5
        assert track_metrics(errors) == {"n_track_losses": 1.0, "tracked": 0.0, "lost_fraction": 0.5}
    assert track_metrics(tracked | {"mpjpe_abs_mm": [900.0] * n})["tracked"] == 1.0  # drift in depth
    assert lost_frames({"mpjpe_px": near}) is None
    assert track_metrics({"mpjpe_px": near}) == {}


@given(st.sampled_from(["mpjpe_px", "mpjpe_mm"]), st.lists(st.floats(0.0, 400.0), min_size=6, max_size=6))
def test_no_criterion_compensates_for_another(name, values):
    small = {"mpjpe_px": [0.0] * 6, "forearm_width_px": [20.0] * 6, "mpjpe_mm": [0.0] * 6}
    errors = small | {name: values}
    lost = lost_states(values, [20.0 if name == "mpjpe_px" else TRACKED_MM] * 6)
    assert lost_frames(errors).tolist() == lost.tolist()
    assert set(criteria(errors)) == {"mpjpe_px", "mpjpe_mm"}
