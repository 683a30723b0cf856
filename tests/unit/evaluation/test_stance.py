"""Which foot stands: of a generated walker, of somebody who stands, and of a clip that is too short."""

import numpy as np
import pytest

from workbench.evaluation.run_measurements import foot_speeds, stance, walking_velocity

RATE_HZ = 60.0
TIMES = np.arange(180) / RATE_HZ
WAY = np.array([0.6, 0.8])


def walker(stance_share=0.6, stride_s=1.0, pace=1.4, way=WAY):
    """A pelvis (F, 3), ankles (F, 2, 3), and when each foot stands on the ground (F, 2)."""
    stride = pace * stride_s
    along = np.empty((len(TIMES), 2))
    stands = np.empty((len(TIMES), 2), bool)
    for k, offset in enumerate((0.0, 0.5)):
        steps, phase = np.divmod(TIMES / stride_s + offset, 1.0)
        swing = np.clip((phase - stance_share) / (1.0 - stance_share), 0.0, 1.0)
        along[:, k] = stride * (steps - offset + 0.5 * (1.0 - np.cos(np.pi * swing)))
        stands[:, k] = phase < stance_share
    pelvis, ankles = np.zeros((len(TIMES), 3)), np.zeros((len(TIMES), 2, 3))
    pelvis[:, :2] = pace * TIMES[:, None] * way
    ankles[..., :2] = along[..., None] * way
    return pelvis, ankles, stands


@pytest.mark.parametrize("way", [WAY, -WAY])
def test_a_walkers_feet_stand_while_they_are_on_the_ground(way):
    pelvis, ankles, stands = walker(way=way)
    found = stance(pelvis, ankles, TIMES)
    inner = slice(30, -30)
    agree = (found[inner] == stands[inner]).mean()
    assert agree > 0.85  # a swing begins and ends more slowly than the pelvis goes
    assert found[inner].sum(axis=1).min() >= 1.0  # a walker's feet are never both off the ground


def test_who_stays_has_no_gait():
    pelvis, ankles, _ = walker(pace=0.05)
    assert np.isnan(stance(pelvis, ankles, TIMES)).all()
    assert np.isnan(stance(pelvis[:10], ankles[:10], TIMES[:10])).all()


def test_frames_without_a_pose_are_not_told():
    pelvis, ankles, _ = walker()
    ankles[60] = np.nan
    found = stance(pelvis, ankles, TIMES)
    assert np.isnan(found[60 - 4]).all()
    assert np.isfinite(found[100]).all()


def test_velocities_of_a_uniform_walk_and_none_while_standing_or_where_times_go_back():
    times_s = np.arange(50) / 25.0
    pelvis = np.outer(times_s, [1.2, 0.5, 0.0])
    np.testing.assert_allclose(walking_velocity(pelvis, times_s), np.tile([1.2, 0.5], (50, 1)))
    np.testing.assert_allclose(
        foot_speeds(np.stack([pelvis, 0.0 * pelvis], axis=1), times_s), np.tile([1.3, 0.0], (50, 1))
    )
    assert np.isnan(walking_velocity(0.1 * pelvis, times_s)).all()
    assert np.isnan(walking_velocity(pelvis, times_s % 1.0)).all()
