"""Stance phases and velocities of a synthetic walker, of a standing person and of a short clip."""

import numpy as np
import pytest

from workbench.evaluation.verdict.run_measurements import foot_speeds, stance, walking_velocity

RATE_HZ = 60.0
TIMES = np.arange(180) / RATE_HZ
DIRECTION = np.array([0.6, 0.8])


def walker(stance_fraction=0.6, stride_s=1.0, speed_m_s=1.4, direction=DIRECTION):
    """Return pelvis (F, 3), ankles (F, 2, 3), and whether each foot is on the ground (F, 2)."""
    stride_m = speed_m_s * stride_s
    along = np.empty((len(TIMES), 2))
    stands = np.empty((len(TIMES), 2), bool)
    for k, offset in enumerate((0.0, 0.5)):
        steps, phase = np.divmod(TIMES / stride_s + offset, 1.0)
        swing = np.clip((phase - stance_fraction) / (1.0 - stance_fraction), 0.0, 1.0)
        along[:, k] = stride_m * (steps - offset + 0.5 * (1.0 - np.cos(np.pi * swing)))
        stands[:, k] = phase < stance_fraction
    pelvis, ankles = np.zeros((len(TIMES), 3)), np.zeros((len(TIMES), 2, 3))
    pelvis[:, :2] = speed_m_s * TIMES[:, None] * direction
    ankles[..., :2] = along[..., None] * direction
    return pelvis, ankles, stands


@pytest.mark.parametrize("direction", [DIRECTION, -DIRECTION])
def test_stance_phases_are_those_of_the_synthetic_walker(direction):
    pelvis, ankles, stands = walker(direction=direction)
    estimated = stance(pelvis, ankles, TIMES)
    inner = slice(30, -30)
    assert (estimated[inner] == stands[inner]).mean() > 0.85  # a swing starts and ends slower than the pelvis moves
    assert estimated[inner].sum(axis=1).min() >= 1.0  # walking has no flight phase


def test_standing_and_short_clips_have_no_stance_phases():
    pelvis, ankles, _ = walker(speed_m_s=0.05)
    assert np.isnan(stance(pelvis, ankles, TIMES)).all()
    assert np.isnan(stance(pelvis[:10], ankles[:10], TIMES[:10])).all()


def test_frames_near_a_missing_pose_have_no_stance():
    pelvis, ankles, _ = walker()
    ankles[60] = np.nan
    estimated = stance(pelvis, ankles, TIMES)
    assert np.isnan(estimated[60 - 4]).all()
    assert np.isfinite(estimated[100]).all()


def test_velocities_of_a_uniform_walk_standing_and_decreasing_times():
    slow_s = np.arange(4) / 1.0  # frames farther apart than the time over which speeds are measured
    np.testing.assert_allclose(foot_speeds(np.outer(slow_s, [3.0, 4.0, 0.0])[:, None], slow_s), np.full((4, 1), 5.0))
    times_s = np.arange(50) / 25.0
    pelvis = np.outer(times_s, [1.2, 0.5, 0.0])
    np.testing.assert_allclose(walking_velocity(pelvis, times_s), np.tile([1.2, 0.5], (50, 1)))
    speeds = foot_speeds(np.stack([pelvis, 0.0 * pelvis], axis=1), times_s)
    np.testing.assert_allclose(speeds, np.tile([1.3, 0.0], (50, 1)))
    assert np.isnan(walking_velocity(0.1 * pelvis, times_s)).all()
    assert np.isnan(walking_velocity(pelvis, times_s % 1.0)).all()
