"""Losses and recoveries of a track in constructed error sequences."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from workbench.evaluation.errors.track_loss import TRACKED_MM, criteria, lost_frames, lost_states, track_metrics
from workbench.utils.crossings import crossings


@pytest.mark.parametrize(
    ("errors", "lost"),
    [
        ([], []),
        ([9.0] * 20, []),
        ([5.0] * 8 + [29.0] + [5.0] * 11, []),  # the mean of five frames is 9.8
        ([2.0] * 6 + [40.0] * 8 + [2.0] * 6, range(6, 14)),
        ([2.0] * 10 + [50.0] * 10, range(10, 20)),
        ([50.0] * 20, range(20)),
        ([50.0] * 2, range(2)),
        ([2.0] * 3 + [np.nan] * 4 + [40.0] * 6, range(7, 13)),
        ([np.nan] * 5, []),
        ([9.0, 0.0, 0.0, 0.0, 42.0, 0.0, 0.0, 0.0], [4]),
    ],
)
def test_losses_and_recoveries_start_with_their_first_frames(errors, lost):
    """The threshold is 10, and frames without truth do not count."""
    assert np.flatnonzero(lost_states(errors, [10.0] * len(errors))).tolist() == list(lost)


@given(st.lists(st.sampled_from([0.0, 15.0, 21.0, 60.0]), max_size=30))
def test_losses_and_recoveries_are_in_the_order_of_frames(errors):
    frames = crossings(errors, [20.0] * len(errors))
    assert frames == sorted(set(frames))
    assert lost_states(errors, [20.0] * len(errors)).any() == bool(frames)


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
