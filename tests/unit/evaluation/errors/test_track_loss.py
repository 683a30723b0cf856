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


@pytest.mark.parametrize(
    ("errors", "events", "n_lost"),
    [
        ([], [], 0),
        ([9.0] * 20, [], 0),
        ([5.0] * 8 + [29.0] + [5.0] * 11, [], 0),  # the mean of five frames is 9.8
        ([2.0] * 6 + [40.0] * 8 + [2.0] * 6, [("lost", 6), ("recovered", 14)], 8),
        ([2.0] * 10 + [50.0] * 10, [("lost", 10)], 10),
        ([50.0] * 20, [("lost", 0)], 20),
        ([50.0] * 2, [("lost", 0)], 2),
        ([2.0] * 3 + [np.nan] * 4 + [40.0] * 6, [("lost", 7)], 6),
        ([np.nan] * 5, [], 0),
        ([9.0, 0.0, 0.0, 0.0, 42.0, 0.0, 0.0, 0.0], [("lost", 4), ("recovered", 5)], 1),
    ],
)
def test_losses_and_recoveries_start_with_their_first_frames(errors, events, n_lost):
    """The threshold is 10, and frames without truth do not count."""
    widths = [10.0] * len(errors)
    assert track_events(errors, widths) == [TrackEvent(*event) for event in events]
    assert lost_states(errors, widths).sum() == n_lost


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
