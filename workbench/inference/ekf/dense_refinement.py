"""Climb on by all pixels of a frame: cells that learned from a pose that was a little off agree with that pose, however
far the person drifts from it, while the image as layers says where they really end and what hides what."""

import numpy as np

from workbench.core.likelihood import DenseLikelihood, Derivatives
from workbench.inference.ekf.levenberg_marquardt import Tails
from workbench.utils.arrays import BoolArray, FloatArray

STEPS = 4
LENGTHS = (1.0, 0.5, 0.25)
"""Parts of a step that are tried, the first that leads up is taken."""
LEAST_SEEN = 3.0
"""How many times as much as the prior the points must say of a direction for the layers to be asked: of what no image
sees, such as depth, their pixels tell nothing but noise."""
NARROWEST, WIDEST = 0.025, 0.15
"""Between which the layers are looked at to either side of a pose: the largest change of a number, m or rad."""
ENOUGH = 0.5
"""Nats below which a step is none."""


def settle(
    frame_likelihood: DenseLikelihood,
    prior: Tails,
    pose: FloatArray,
    slope: Derivatives,
    limits: FloatArray,
    joints: BoolArray,
) -> tuple[FloatArray, Derivatives, int]:
    """Climb log prior + log p(points) + log p(layers) from a pose (P,) near the mode of the first two.

    limits: (P, 2). slope: of the points at the pose it begins with. joints: (J,), all true. Returns the pose, the slope
    of the points there, and the number of evaluations of the layers. The layers' derivatives are differences along the
    axes that the prior's precision and the points' curvature share, over the deviations of both there, where the points
    see them (LEAST_SEEN). Curvature is taken to be diagonal and not negative."""
    last, count = frame_likelihood.n_levels - 1, 0
    for _ in range(STEPS):
        precision = prior.precision(pose)
        root = np.linalg.inv(np.linalg.cholesky(precision)).T
        seen, turned = np.linalg.eigh(root.T @ slope.curvature @ root)
        axes, asked = root @ turned, seen > LEAST_SEEN  # the prior's deviations along them are 1, the points' √(1/seen)
        largest = np.abs(axes).max(axis=0)
        widths = np.clip(1.0 / np.sqrt(1.0 + np.maximum(seen, 0.0)), NARROWEST / largest, WIDEST / largest)
        gradient, curvature = np.zeros(len(pose)), np.zeros(len(pose))
        ways = (axes * widths)[:, asked]
        gradient[asked], curvature[asked] = _differences(frame_likelihood, pose, ways, limits, joints)
        uphill = axes.T @ (slope.gradient - precision @ (pose - prior.mean)) + gradient / widths
        step = axes @ (uphill / (1.0 + seen + curvature / widths**2))
        tried = np.clip(pose + np.array(LENGTHS)[:, None] * step, *limits.T)
        heights = frame_likelihood.compare(np.concatenate([pose[None], tried]), joints)
        count += 2 * ways.shape[1] + 2 + len(LENGTHS)
        here = slope.log_prob + prior.height(pose) + heights[0]
        for place, height in zip(tried, heights[1:], strict=True):
            at_place = frame_likelihood.derivatives(place, last)
            if at_place.log_prob + prior.height(place) + height > here + ENOUGH:
                pose, slope = place, at_place
                break
        else:
            break
    return pose, slope, count


def _differences(
    frame_likelihood: DenseLikelihood, pose: FloatArray, ways: FloatArray, limits: FloatArray, joints: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Approximate gradient (D,) and downward curvature (D,), not negative, of the layers at a pose (P,) along ways
    (P, D), in their units."""
    d = ways.shape[1]
    places = pose + np.concatenate([np.zeros((1, len(pose))), ways.T, -ways.T])
    heights = frame_likelihood.compare(np.clip(places, *limits.T), joints)
    here, above, below = heights[0], heights[1 : d + 1], heights[d + 1 :]
    return 0.5 * (above - below), np.maximum(2.0 * here - above - below, 0.0)
