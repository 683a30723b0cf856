"""What two looks at a clip tell together: limb by limb more of what the frame's pixels say."""

from collections.abc import Sequence

import numpy as np
import scipy

from workbench.body.angles import nearest_turn
from workbench.body.kinematics import forward
from workbench.body.skeleton import POSE_NAMES, Skeleton
from workbench.core.likelihood import LayeredLook
from workbench.utils.arrays import FloatArray, IntArray

PIXELS_SAY = 0.1
"""Power of a frame's likelihood by which looks are weighed: neighbouring frames err together, and so do cells that
learned from poses that were off."""
OWN_M = 0.045
"""By how much a look's joints err by themselves, m; what looks differ by beyond that is put down to the earlier one."""


def shares(
    look: LayeredLook, skeleton: Skeleton, limbs: Sequence[IntArray], pose: FloatArray, other: FloatArray
) -> FloatArray:
    """Tell how much each number (P,) of the pose that an earlier look found, `other` (P,), counts beside this look's
    `pose` (P,), 0 to 1: as much where they agree, and less the farther they are apart, with odds of OWN_M² to
    OWN_M² + d², d being the mean distance of their joints; of each limb, columns (k,) of the pose, with these odds
    times how likely the frame's pixels are with it to how likely with this look's, to the power PIXELS_SAY.

    These are the weights of two estimates by their variances, where both err by OWN_M and the earlier one by what they
    differ by, too: that look does not know what is behind the person, so that it keeps the error of the start. A limb
    of each look is tried on the body of either, and the mean counts: a body that is a little off suits the limbs that
    were found with it. Deviation: pixels do not weigh what limbs hang on, as they do not say how far away the whole
    body is: weighing that too, it was told worse.
    """
    n, joints = len(limbs), np.ones(len(skeleton.names), dtype=np.bool_)
    theirs = nearest_turn(other, pose)
    tried = np.repeat(np.stack([pose, theirs]), n + 1, axis=0)  # each body, then with each of the other's limbs
    for k, limb in enumerate(limbs):
        tried[k + 1, limb], tried[n + k + 2, limb] = theirs[limb], pose[limb]
    ratios = look.compare(tried, joints).reshape(2, n + 1)
    one, another = forward(skeleton, np.stack([pose, other])).positions
    agreeing = -np.log1p((float(np.linalg.norm(one - another, axis=1).mean()) / OWN_M) ** 2)
    found = np.full(len(pose), scipy.special.expit(agreeing))
    for k, limb in enumerate(limbs):
        likelier = 0.5 * (ratios[0, k + 1] - ratios[0, 0] + ratios[1, 0] - ratios[1, k + 1])
        found[limb] = scipy.special.expit(agreeing + PIXELS_SAY * likelier)
    return found


def of_both(
    first: FloatArray, second: FloatArray, covariance: FloatArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return mean (D,) and covariance (D, D) of a state of which two looks found estimates (D,), the second with a
    covariance (D, D) that knows nothing of the first. weights: (P,), see `shares`, of the pose's numbers in the first,
    with which the state begins; of the others both count as much.

    They are two samples of what a look may find: told is their mean, x̄ = w x₁ + (1 − w) x₂, and beside the covariance
    twice their weighted one, 2 Σ w (x − x̄)² = 2 w (1 − w) d dᵀ with d = x₁ − x₂: the unbiased estimate d dᵀ / 2 where
    both count as much, and nothing where one is not believed, by which postures would draw the other one to it. Angles
    are compared on the nearest turn.
    """
    n = len(POSE_NAMES)
    apart = np.concatenate([nearest_turn(first[:n], second[:n]), first[n:]]) - second
    every = np.concatenate([weights, np.full(len(second) - n, 0.5)])
    spread = np.sqrt(every * (1.0 - every)) * apart
    return second + every * apart, covariance + 2.0 * np.outer(spread, spread)
