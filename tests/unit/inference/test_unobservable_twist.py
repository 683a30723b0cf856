"""The twist of an upper arm whose elbow is straight and then bends (A, fig. 4): particles against an exact filter."""

from functools import cache

import numpy as np
import pytest
from linear_gaussian import Memoryless, frames, streams

from tests.oracles.twist import WRIST_STD_M, TwistGrid, wrist_offsets
from workbench.body.skeleton import POSE_NAMES
from workbench.inference.smc.bootstrap import Bootstrap
from workbench.inference.smc.particle_filter import ParticleFilter
from workbench.priors.smooth import INITIAL_VELOCITY_SCALE, Smooth

NAME = "right_shoulder_twist"
COLUMN = POSE_NAMES.index(NAME)
SIGMA, SIGMA_VELOCITY, DT_S, N = 0.08, 0.5, 0.1, 20000
BENDS = 8
ELBOWS = np.array([np.nan] + [0.0] * BENDS + [0.15, 0.3, 0.5, 0.5, 0.5])
"""Straight in the first BENDS frames after the initial one, in which nothing is observed."""
TRUTH = 0.6


class Wrist(Memoryless):
    """Offsets of the wrist from the line of the upper arm, (F, 2)."""

    def __init__(self, observed):
        self.observed = observed

    def log_prob(self, previous, frame, previous_pose, pose):
        residuals = wrist_offsets(pose[:, COLUMN], ELBOWS[frame.index]) - self.observed[frame.index]
        return -0.5 * ((residuals / WRIST_STD_M) ** 2).sum(axis=1)


@cache
def posteriors(normalized):
    """Return the exact posterior (F, n) of the twist, the centres of its cells (n,), and the particles' (F, n)."""
    offsets = np.array([wrist_offsets(np.array([TRUTH]), elbow)[0] for elbow in ELBOWS])
    observed = offsets + WRIST_STD_M * np.random.default_rng(0).standard_normal(offsets.shape)
    prior = Smooth(
        parameters=[NAME], sigma={NAME: SIGMA * (1 / 30 / DT_S) ** 0.5},
        sigma_velocity={NAME: SIGMA_VELOCITY * (1 / 30 / DT_S) ** 0.5}, initial_uniform=[NAME], normalized=normalized,
    )  # fmt: skip
    edges = np.linspace(*prior.limits[0], 96)
    grid = TwistGrid(
        0.5 * (edges[1:] + edges[:-1]), np.linspace(-6.0, 6.0, 61), SIGMA, SIGMA_VELOCITY, DT_S, normalized
    )
    speeds = np.exp(-0.5 * (grid.velocities / (INITIAL_VELOCITY_SCALE * prior.sigma_velocity[0])) ** 2)
    cells = np.tile(speeds / speeds.sum() / len(grid.twists), (len(grid.twists), 1))
    exact = grid.posteriors(cells, ELBOWS[1:], observed[1:])
    steps = list(
        ParticleFilter(prior, Wrist(observed), algorithm=Bootstrap(), n_particles=N).run(
            frames(len(ELBOWS)), np.zeros(len(POSE_NAMES)), streams(0)
        )
    )
    counts = [np.histogram(step.particles[:, 0], edges, weights=np.exp(step.log_weights))[0] for step in steps[1:]]
    return exact, grid.twists, np.array(counts)


@pytest.mark.parametrize("normalized", [False, True])
def test_particles_agree_with_the_exact_filter(normalized):
    """The largest difference of the distribution functions is a few 1/√(effective number of particles)."""
    exact, _, particles = posteriors(normalized)
    differences = np.abs(exact.cumsum(axis=1) - particles.cumsum(axis=1)).max(axis=1)
    assert (differences < 0.03).all(), differences


def test_twists_stay_at_their_limits_under_the_normalised_density():
    """20° of the 218° are within 10° of a limit. While nothing is observed, the paper's density leaves less there than
    that; normalised, states that run into a limit stay there."""
    shares = []
    for normalized in (False, True):
        exact, twists, _ = posteriors(normalized)
        near = np.abs(twists) > twists.max() - np.radians(10.0)
        shares.append(exact[BENDS - 1, near].sum())
    assert shares[0] < 20.0 / 218.0 < 0.2 < shares[1]
