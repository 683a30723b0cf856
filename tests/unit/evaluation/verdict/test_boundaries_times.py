"""Findings on a run's times, on gaps and jumps of its keypoints on both sides of every threshold."""

from dataclasses import replace

import numpy as np
import pytest
from verdict_scenes import N, level, scene

ONE = scene(1, 0.0).measurements()
JUMP = "missing frames or jumps"


def observed(measured, keypoints=None, times_s=None):
    """Return the measurements with other keypoints (V, N, J, 3) or times (N,)."""
    keypoints = measured.observed.keypoints if keypoints is None else keypoints
    times_s = measured.times_s if times_s is None else times_s
    return replace(measured, times_s=times_s, observed=replace(measured.observed, keypoints=keypoints, times_s=times_s))


@pytest.mark.parametrize(("file_hz", "expected"), [(101.9, ""), (102.1, "doubtful"), (98.1, ""), (97.9, "doubtful")])
def test_the_rate_of_the_file_differs_by_2_percent(file_hz, expected):
    timed = observed(ONE, times_s=np.arange(N) / 100.0)
    assert level(timed, "frame-rate mismatch", rate_hz=100.0, source_rate_hz=file_hz) == expected


@pytest.mark.parametrize(("times_hz", "expected"), [(101.9, ""), (102.1, "doubtful"), (98.1, ""), (97.9, "doubtful")])
def test_the_rate_of_the_times_differs_by_2_percent(times_hz, expected):
    timed = observed(ONE, times_s=np.arange(N) / times_hz)
    assert level(timed, "frame-rate mismatch", rate_hz=100.0) == expected


@pytest.mark.parametrize(("n_missing", "expected"), [(24, ""), (26, "doubtful")])
def test_a_gap_lasts_a_quarter_of_a_second(n_missing, expected):
    keypoints = ONE.observed.keypoints.copy()
    keypoints[:, 20 : 20 + n_missing] = np.nan
    assert level(observed(ONE, keypoints, np.arange(N) / 100.0), JUMP) == expected


@pytest.mark.parametrize(("n_sparse", "expected"), [(12, "doubtful"), (13, "")])
def test_keypoints_in_every_second_frame_have_no_gaps(n_sparse, expected):
    keypoints = ONE.observed.keypoints.copy()
    keypoints[:, 1 : 2 * n_sparse : 2] = np.nan  # every second frame, then 13 in turn
    keypoints[:, 2 * n_sparse + 13 :] = np.nan
    assert level(observed(ONE, keypoints), JUMP) == expected


def moving(steps):
    """Return measurements of keypoints that move by steps (N,), in heights of the person, at 25 Hz."""
    keypoints = np.repeat(ONE.observed.keypoints[:, :1], N, axis=1)
    keypoints[0, ..., 0] += np.cumsum(steps)[:, None] * np.ptp(keypoints[0, 0, :, 1])
    return observed(ONE, keypoints)


def with_jump(around, jump):
    return np.where(np.arange(N) == 30, jump, around)


@pytest.mark.parametrize(("ratio", "expected"), [(4.9, ""), (5.1, "doubtful")])
def test_a_jump_is_five_times_the_motion_around_it(ratio, expected):
    assert level(moving(with_jump(0.02, ratio * 0.02)), JUMP) == expected


@pytest.mark.parametrize(("rate_hz", "jump", "expected"), [
    (100.0, 0.043, ""), (100.0, 0.045, "doubtful"),  # a forearm's width
    (10.0, 0.131, ""), (10.0, 0.133, "doubtful"),  # 1.32 heights, 30 forearms' widths, per second
])  # fmt: skip
def test_a_jump_is_longer_than_a_forearms_width_and_than_the_way_of_a_person_who_begins_to_move(
    rate_hz, jump, expected
):
    jumping = moving(with_jump(0.001, jump))
    assert level(observed(jumping, times_s=np.arange(N) / rate_hz), JUMP) == expected


@pytest.mark.parametrize(("is_slow", "expected"), [(True, "doubtful"), (False, "")])
def test_the_motion_around_a_jump_is_that_of_ten_frames_before_and_after(is_slow, expected):
    # 11 of the 20 frames around the jump are slow, but only 7 of the nearest 16, and 11 of the nearest 24.
    slow = np.isin(np.abs(np.arange(N) - 30), [6, 7, 8, 9, 10]) | np.isin(np.arange(N), [29])
    assert [slow[30 - k : 31 + k].sum() for k in (8, 10, 12)] == [7, 11, 11]
    steps = np.where(slow == is_slow, 0.001, 0.05)
    assert level(moving(with_jump(steps, 0.2)), JUMP) == expected


@pytest.mark.parametrize(("n_known", "expected"), [(4, ""), (5, "doubtful")])
def test_the_motion_around_a_jump_is_known_in_five_frames(n_known, expected):
    jumping, frames, first = moving(with_jump(0.001, 0.2)), np.arange(N), 29 - n_known
    missing = np.where(frames < first, (first - frames) % 2 == 1, (frames > 30) & (frames % 2 == 1))
    keypoints = np.where(missing[:, None, None], np.nan, jumping.observed.keypoints)
    assert level(observed(jumping, keypoints), JUMP) == expected
