"""Frames that a video lacks, and the thresholds of their finding on both sides."""

from dataclasses import replace

import numpy as np
import pytest
from verdict_scenes import RATE_HZ, N, scene

from workbench.evaluation.verdict import dropped_findings
from workbench.evaluation.verdict.dropped_findings import step_gains

KIND = "dropped frames"
RNG = np.random.default_rng(4)


def of_frames(intact, rows):
    """Return the scene with some of the frames at even times."""
    rows = np.asarray(rows)
    return replace(
        intact, keypoints=intact.keypoints[:, rows], poses=intact.poses[rows], times_s=np.arange(len(rows)) / RATE_HZ
    )


def messages(case):
    return [each.message for each in case.verdict().findings if each.kind == KIND]


@pytest.mark.parametrize("n_cameras", [1, 4])
def test_dropped_frames_are_reported_with_their_number(n_cameras):
    rows = np.flatnonzero(np.arange(N) % 7 != 3)
    (message,) = messages(of_frames(scene(n_cameras), rows))
    assert "frames are missing, and speeds are wrong" in message
    (number,) = [int(word) for word in message.split("about ")[1].split()[:1]]
    assert abs(number - (N - len(rows))) <= 2


def test_an_even_walk_and_true_uneven_times_are_not_reported():
    rows = np.flatnonzero(np.arange(N) % 7 != 3)
    assert not messages(scene(1))
    assert not messages(replace(of_frames(scene(1), rows), times_s=rows / RATE_HZ))


def test_a_person_who_stands_still_shows_no_dropped_frames():
    places = np.repeat(scene(1).keypoints[:, :1, :, :2], 200, axis=1)
    gains = step_gains(places + RNG.normal(0.0, 2.0, places.shape), np.arange(200) / RATE_HZ)
    assert np.isfinite(gains).mean() < 0.05


@pytest.mark.parametrize(("factor", "is_long"), [(1.59, False), (1.61, True)])
def test_a_step_is_long_from_a_factor_on(factor, is_long):
    steps = np.ones(40)
    steps[[10, 20, 30]] = factor
    pixels = np.cumsum(steps)[None, :, None, None] * np.ones((1, 1, 15, 2))
    gains = step_gains(pixels, np.arange(40) / RATE_HZ)
    assert (gains[[10, 20, 30]] > dropped_findings._MIN_GAIN).all() == is_long
    assert np.nanmax(np.delete(gains, [10, 20, 30])) < 1.01


@pytest.mark.parametrize(("n_long", "is_reported"), [(2, False), (3, True)])
def test_one_step_in_twenty_may_be_long(n_long, is_reported):
    """56 of the steps of 60 frames are between two others on each side: 5 % of them are 2.8."""
    steps = np.ones(N)
    steps[np.linspace(10, 50, n_long).astype(int)] = 2.0
    walk = 4.0 * np.cumsum(steps)[:, None, None] * [1.0, 0.0] + scene(1, 0.0).keypoints[0, :1, :, :2]
    intact = scene(1)
    keypoints = intact.keypoints.copy()
    keypoints[0, ..., :2] = walk
    measured = replace(intact, keypoints=keypoints).measurements()
    assert len(list(dropped_findings.dropped_findings(measured))) == is_reported


@pytest.mark.parametrize(("rate_hz", "is_reported"), [(14.0, False), (16.0, True)])
def test_slow_rates_show_no_dropped_frames(rate_hz, is_reported):
    case = of_frames(scene(1, 0.0), np.flatnonzero(np.arange(N) % 7 != 3))
    measured = replace(case, times_s=np.arange(len(case.poses)) / rate_hz).measurements()
    assert len(list(dropped_findings.dropped_findings(measured))) == is_reported


@pytest.mark.parametrize(("n", "is_reported"), [(19, False), (20, True)])
def test_few_steps_show_no_dropped_frames(n, is_reported):
    """Of n frames, n - 5 steps have two others on each side."""
    rows = np.flatnonzero(np.arange(N) % 5 != 3)[:n]
    measured = of_frames(scene(4, 0.0), rows).measurements()
    assert len(list(dropped_findings.dropped_findings(measured))) == is_reported
