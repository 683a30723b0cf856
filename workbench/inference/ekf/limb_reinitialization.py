"""Reinitialization of limbs: local optimisation does not recover an arm or leg whose track is lost."""

import numpy as np

from workbench.body.kinematics import descendants
from workbench.body.skeleton import Skeleton
from workbench.core.likelihood import DenseLikelihood
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

ANGLE_STD_RAD = 0.7
"""Standard deviation of a reinitialized limb's angles about those of the previous frame, rad."""
FIXED_COST = 6.0
"""Cost of a reinitialization in addition to that of the distance, nats."""
MIN_GAIN = 12.0
"""Minimum increase of the log likelihood of the image layers, nats."""
ABANDON_MARGIN = 20.0
"""The search ends if the best candidate is worse than the current pose by this, nats."""
N_INITIAL, N_REFINED, N_BEST = 120, (60, 60), 5
"""Number of initial candidates, of candidates about the N_BEST best ones in later rounds, and of these."""
REFINED_STDS_RAD = (0.25, 0.12)
"""Standard deviations of the candidates in the later rounds, rad."""


def reinitialize_limb(
    frame_likelihood: DenseLikelihood, skeleton: Skeleton, limb: IntArray, pose: FloatArray, previous_pose: FloatArray,
    rng: np.random.Generator,
) -> FloatArray | None:  # fmt: skip
    """Return the pose (P,) with better angles of a limb by all pixels of the frame, or None.

    Candidates are sampled about the limb's previous angles, and twice about the best candidates, so that the result
    need not be near the current estimate. The log likelihood less `reinitialization_cost` has to grow by MIN_GAIN.

    Parameters
    ----------
    frame_likelihood : of the frame.
    skeleton : with joint limits.
    limb : (k,), columns of the limb's angles in a pose.
    pose, previous_pose : (P,), in this frame and the previous one.
    rng : of the candidates.
    """
    joints, low, high = _affected_joints(skeleton, limb), *skeleton.limits[limb].T
    candidates, scores, current = np.empty((0, len(limb))), np.empty(0), -np.inf
    for n, deviation in zip((N_INITIAL, *N_REFINED), (ANGLE_STD_RAD, *REFINED_STDS_RAD), strict=True):
        best = candidates[np.argsort(-scores)[:N_BEST]]
        around = best[rng.integers(0, len(best), n)] if len(best) else previous_pose[limb]
        sampled = np.clip(around + deviation * rng.standard_normal((n, len(limb))), low, high)
        poses = np.repeat(pose[None], n + 1, axis=0)
        poses[1:, limb] = sampled
        log_probs = frame_likelihood.compare(poses, joints)
        current = log_probs[0]
        candidates = np.concatenate([candidates, sampled])
        scores = np.concatenate([scores, log_probs[1:] - reinitialization_cost(sampled, previous_pose[limb])])
        if scores.max() < current - ABANDON_MARGIN:
            return None
    if not scores.max() >= current + MIN_GAIN:
        return None
    reinitialized = pose.copy()
    reinitialized[limb] = candidates[np.argmax(scores)]
    return reinitialized


def reinitialization_cost(angles: FloatArray, previous_angles: FloatArray) -> FloatArray:
    """Return the cost, nats, of reinitializing a limb from angles (k,) to angles (..., k)."""
    return np.asarray(FIXED_COST + 0.5 * (((angles - previous_angles) / ANGLE_STD_RAD) ** 2).sum(axis=-1))


def is_better(
    frame_likelihood: DenseLikelihood, n_joints: int, pose: FloatArray, reinitialized: FloatArray, limb: IntArray,
    previous_pose: FloatArray,
) -> bool:  # fmt: skip
    """Return whether the pose (P,) optimised after a reinitialization is better by all pixels of the frame.

    The points are not compared: a limb that is occluded costs them nothing, and a visible one costs them something at
    any pose.
    """
    log_probs = frame_likelihood.compare(np.stack([pose, reinitialized]), np.ones(n_joints, dtype=np.bool_))
    cost = reinitialization_cost(reinitialized[limb], previous_pose[limb])
    return bool(log_probs[1] - log_probs[0] - cost > MIN_GAIN)


def _affected_joints(skeleton: Skeleton, limb: IntArray) -> BoolArray:
    """Select the joints (J,) that a limb's angles move, or belong to."""
    joints = np.unique(skeleton.dof_joints[limb])
    below = descendants(skeleton)[joints].any(axis=0)
    return np.asarray(below | np.isin(np.arange(len(skeleton.names)), joints))
