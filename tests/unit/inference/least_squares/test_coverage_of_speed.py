"""The 90 % intervals of a walker's mean speed by the samples of the motion, over walkers of random size."""

import numpy as np
import pytest
from detected_walkers import N_FRAMES, RATE_HZ, detected_walker

N_WALKERS = 20


def speed(motions):
    """Return the mean horizontal speeds (S,), m/s, of the pelvis in motions (S, T, P)."""
    return np.linalg.norm(motions[:, -1, :2] - motions[:, 0, :2], axis=1) * RATE_HZ / (N_FRAMES - 1)


def covered(seed, estimated):
    """Return whether the interval contains the true speed, and the width of the interval over the speed."""
    scene = detected_walker(seed)
    fit = scene.fit(scene.estimated_camera() if estimated else scene.camera)
    low, high = np.quantile(speed(fit.posterior.draws(200, np.random.default_rng(seed))), [0.05, 0.95])
    true = speed(scene.poses[None])[0]
    return low < true < high, (high - low) / true


@pytest.mark.slow
def test_intervals_cover_the_speed_of_walkers_and_include_an_estimated_camera():
    """Of 20 intervals that cover 90 %, fewer than 15 do so in 1 % of all cases."""
    cases = np.array([[covered(100 + seed, estimated) for seed in range(N_WALKERS)] for estimated in (False, True)])
    known, estimated = cases.mean(axis=1)
    assert min(known[0], estimated[0]) >= 0.75
    assert estimated[1] > 1.5 * known[1]
