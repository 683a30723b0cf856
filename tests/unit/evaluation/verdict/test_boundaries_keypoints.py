"""Findings on keypoints of no person, and of another person, on both sides of every threshold."""

from dataclasses import replace

import numpy as np
import pytest
from verdict_scenes import N, level, scene

ONE, TWO = scene(1, 0.0).measurements(), scene(2, 0.0).measurements()
HEIGHT_PX = np.ptp(ONE.observed.keypoints[0, 0, :, 1])
FRAMES, START = np.arange(N), 30


def observed(measured, pixels, rate_hz=25.0):
    """Return the measurements with other pixels (V, N, J, 2) of the keypoints, and other times."""
    keypoints = measured.observed.keypoints.copy()
    keypoints[..., :2] = pixels
    times_s = FRAMES / rate_hz
    return replace(measured, times_s=times_s, observed=replace(measured.observed, keypoints=keypoints, times_s=times_s))


def growing(measured, log_size, rate_hz=25.0):
    """Return measurements of a person who stands still and whose lengths change by factors exp(log_size), (N,)."""
    still = measured.observed.keypoints[:, :1, :, :2]
    if len(still) == 1:
        pixels = still.mean(axis=2, keepdims=True)
        return observed(measured, pixels + np.exp(log_size)[:, None, None] * (still - pixels), rate_hz)
    places = measured.estimated_joints[:1] - measured.estimated_joints[0, 0]
    places = np.exp(log_size)[:, None, None] * places + measured.estimated_joints[0, 0]
    return observed(measured, np.stack([camera.project(places) for camera in measured.observed.cameras]), rate_hz)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize(("rate_hz", "change", "expected"), [
    (25.0, 0.241, ""), (25.0, 0.247, "doubtful"),  # 0.1 and 0.6 per second in a quarter of a second, 6 frames: 0.244
    (4.0, 0.54, ""), (4.0, 0.56, "doubtful"),  # in three frames: 0.55
])  # fmt: skip
def test_another_person_in_the_image_is_larger_than_one_who_comes_nearer(rate_hz, change, expected, sign):
    larger = growing(ONE, sign * np.where(FRAMES < START, 0.0, change), rate_hz)
    assert level(larger, "change of person") == expected


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize(("change", "expected"), [(0.099, ""), (0.101, "doubtful")])
def test_another_person_in_space_is_larger_by_10_percent(change, expected, sign):
    assert level(growing(TWO, sign * np.where(FRAMES < START, 0.0, change)), "change of person") == expected


@pytest.mark.parametrize(("n_frames", "expected"), [(6, ""), (7, "doubtful")])
def test_another_person_in_space_is_seen_in_most_of_half_a_second(n_frames, expected):
    """Half a second are 12 frames."""
    larger = np.where(np.isin(FRAMES - START, range(n_frames)), 0.15, 0.0)
    assert level(growing(TWO, larger), "change of person") == expected


@pytest.mark.parametrize(("up_and_down", "ratio", "expected"), [(0.23, 0.68, ""), (0.26, 0.72, "not usable")])
def test_neighbouring_frames_differ_by_07_of_the_distance_between_any_two(up_and_down, ratio, expected):
    moved = np.stack([FRAMES / N, up_and_down * (FRAMES % 2)], axis=1)
    between_any = np.linalg.norm(moved[:, None] - moved, axis=-1)[np.triu_indices(N, 1)]
    assert np.linalg.norm(moved[1] - moved[0]) / np.median(between_any) == pytest.approx(ratio, abs=0.005)
    pixels = ONE.observed.keypoints[:, :1, :, :2] + HEIGHT_PX * moved[:, None]
    assert level(observed(ONE, pixels), "impossible motion") == expected


@pytest.mark.parametrize(("n_joints", "expected"), [(3, ""), (4, "not usable")])
def test_the_order_of_frames_is_known_by_four_joints(n_joints, expected):
    pixels = np.repeat(ONE.observed.keypoints[:, :1, :, :2], N, axis=1)
    pixels[0, :, 1 : 1 + n_joints] += 0.2 * HEIGHT_PX * np.random.default_rng(0).standard_normal((N, n_joints, 2))
    assert level(observed(ONE, pixels), "impossible motion") == expected


def test_a_speed_is_that_over_a_tenth_of_a_second():
    """A person who moves back and forth in a tenth of a second has none, but one of 15 heights per second over 0.08 s
    and 10 over 0.12 s."""
    back_and_forth = np.sin(2.0 * np.pi * FRAMES / 10.0)[:, None, None] * [HEIGHT_PX, 0.0]
    pixels = ONE.observed.keypoints[:, :1, :, :2] + 1.5 * back_and_forth
    assert level(observed(ONE, pixels, rate_hz=100.0), "impossible motion") == ""
