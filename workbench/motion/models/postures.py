"""Learn which postures people take, whatever they do."""

import numpy as np

from workbench.core.pose_prior import Postures
from workbench.utils.arrays import FloatArray
from workbench.utils.rng import stream

N_PARTS = 32
"""At most, and one for every FRAMES_A_PART."""
FRAMES_A_PART = 50
"""That a part's own frames outweigh what all parts have in common."""
ROUNDS = 10
BEGUN = 0.2
"""Of the deviations of all postures are those of the first parts, about postures drawn at random."""
LEAST_RAD = 0.02
"""Deviation that every number has at least, beside what was recorded."""
SEED = 0


def learn_postures(postures: FloatArray) -> Postures:
    """Fit a mixture of Gaussians to postures (n, A), rad, by expectation and maximisation (Dempster,
    Laird & Rubin 1977), ROUNDS times.

    Each part's covariance is drawn to the mean one of all parts as by FRAMES_A_PART more frames: a part that few people
    have been in says little about how others may differ there.
    """
    n, a = postures.shape
    n_parts = max(1, min(N_PARTS, n // FRAMES_A_PART))
    first = stream(SEED, "postures").choice(n, n_parts, replace=False)
    wide = BEGUN**2 * np.cov(postures.T) + LEAST_RAD**2 * np.eye(a)
    model = Postures(np.full(n_parts, 1.0 / n_parts), postures[first], np.tile(wide, (n_parts, 1, 1)))
    for _ in range(ROUNDS):
        model = fitted(postures, model.shares(postures))
    return model


def fitted(postures: FloatArray, shares: FloatArray) -> Postures:
    """Return the mixture whose parts have these shares (n, K) in postures (n, A), rad: the maximisation."""
    n, a = postures.shape
    sizes = shares.sum(axis=0) + 1e-9
    means = (shares.T @ postures) / sizes[:, None]
    scatter = np.empty((len(sizes), a, a))
    for k, mean in enumerate(means):
        away = postures - mean
        scatter[k] = (away * shares[:, k, None]).T @ away
    common = scatter.sum(axis=0) / n
    drawn = (scatter + FRAMES_A_PART * common) / (sizes + FRAMES_A_PART)[:, None, None]
    return Postures(sizes / sizes.sum(), means, drawn + LEAST_RAD**2 * np.eye(a))
