"""The Gaussian state of a frame: prediction by the prior, backward smoothing, and fusion of two passes."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from workbench.body.angles import unwrap_near
from workbench.body.kinematics import forward
from workbench.body.skeleton import POSE_NAMES, Skeleton
from workbench.core.gaussian import predict_covariance, smooth
from workbench.core.likelihood import DenseLikelihood
from workbench.core.prior import Gaussian, Prior
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

_DIFFERENCE = 1e-5
"""Step of the finite differences of the prior's mean, in m, rad and their speeds."""


@dataclass(frozen=True, eq=False)
class GaussianState:
    """N(mean (D,), covariance (D, D)) of the state in one frame.

    predicted, predicted_covariance: before the frame is observed. transition: (D, D), derivatives of the prediction by
    the previous state. std_inflation: (P,), factors of the reported standard deviations of the pose parameters.
    first_pass_weights: (P,), 0 to 1, weights of the first pass's estimate if two passes are fused.
    """

    mean: FloatArray
    covariance: FloatArray
    predicted: FloatArray
    predicted_covariance: FloatArray
    transition: FloatArray
    std_inflation: FloatArray
    first_pass_weights: FloatArray = field(default_factory=lambda: np.full(len(POSE_NAMES), 0.5))

    def decoupled(self, columns: IntArray, values: FloatArray, deviations: FloatArray) -> "GaussianState":
        """Return the prediction with K columns independent of the past: means (K,) and standard deviations (K,)."""
        mean, covariance, transition = self.mean.copy(), self.covariance.copy(), self.transition.copy()
        covariance[columns], covariance[:, columns], transition[columns] = 0.0, 0.0, 0.0
        mean[columns], covariance[columns, columns] = values, deviations**2
        return replace(
            self, mean=mean, covariance=covariance, predicted=mean, predicted_covariance=covariance,
            transition=transition,
        )  # fmt: skip


def gaussian_density(prior: Prior) -> Gaussian:
    """Return the prior's density; raises InputError if its noise is not Gaussian or its states omit the whole pose."""
    density, names = prior.capabilities.density, prior.space.names
    if not isinstance(density, Gaussian) or names[: len(POSE_NAMES)] != POSE_NAMES:
        raise InputError(
            "inference: a Kalman filter needs a prior with Gaussian noise over the whole pose, such as linear, "
            f"found {type(prior).__name__}"
        )
    return density


def predict(model: Gaussian, state: GaussianState, dt_s: float) -> GaussianState:
    """Predict the next frame's state by the prior's mean, its derivatives and its noise."""
    d = len(state.mean)
    around = state.mean + _DIFFERENCE * np.concatenate([np.zeros((1, d)), np.eye(d), -np.eye(d)])
    means = model.mean(around, dt_s)
    transition = (means[1 : d + 1] - means[d + 1 :]).T / (2.0 * _DIFFERENCE)
    covariance = predict_covariance(state.covariance, transition, model.noise_covariance(state.mean, dt_s))
    return GaussianState(means[0], covariance, means[0], covariance, transition, state.std_inflation)


def smooth_backward(states: list[GaussianState]) -> list[GaussianState]:
    """Return the smoothed states of filtered ones by a backward pass (Rauch, Tung & Striebel 1965)."""
    smoothed = states[-1:]
    for state, following in zip(states[-2::-1], states[:0:-1], strict=True):
        mean, covariance = smooth(
            (state.mean, state.covariance), following.transition,
            (following.predicted, following.predicted_covariance), (smoothed[-1].mean, smoothed[-1].covariance),
        )  # fmt: skip
        smoothed.append(replace(state, mean=mean, covariance=covariance))
    return smoothed[::-1]


LIKELIHOOD_POWER = 0.1
"""Power of a frame's likelihood in the weights of passes: errors of neighbouring frames are correlated, as are those of
surface elements that were learned at wrong poses."""
PASS_STD_M = 0.045
"""Joint error of each pass, m; larger differences between passes are attributed to the first one."""


def first_pass_weights(
    frame_likelihood: DenseLikelihood, skeleton: Skeleton, limbs: Sequence[IntArray], pose: FloatArray,
    first_pose: FloatArray,
) -> FloatArray:  # fmt: skip
    """Return the weights (P,), 0 to 1, of the first pass's pose (P,) relative to the second pass's `pose` (P,).

    The odds are PASS_STD_M² to PASS_STD_M² + d², with the mean distance d of their joints: inverse variances, where
    both passes err by PASS_STD_M and the first one, which lacked the background model, by their difference too. For
    each limb, columns (k,) of the pose, the odds are multiplied by the ratio of the frame's likelihoods with either
    limb to the power LIKELIHOOD_POWER, averaged over the bodies of both passes. Deviation: the likelihood does not
    weight the root, as pixels do not determine the distance of the whole body.
    """
    n, joints = len(limbs), np.ones(len(skeleton.names), dtype=np.bool_)
    aligned = unwrap_near(first_pose, pose)
    candidates = np.repeat(np.stack([pose, aligned]), n + 1, axis=0)  # each body, then with each limb of the other
    for k, limb in enumerate(limbs):
        candidates[k + 1, limb], candidates[n + k + 2, limb] = aligned[limb], pose[limb]
    log_probs = frame_likelihood.compare(candidates, joints).reshape(2, n + 1)
    positions, first_positions = forward(skeleton, np.stack([pose, first_pose])).positions
    log_odds = -np.log1p((float(np.linalg.norm(positions - first_positions, axis=1).mean()) / PASS_STD_M) ** 2)
    weights = np.full(len(pose), scipy.special.expit(log_odds))
    for k, limb in enumerate(limbs):
        log_ratio = 0.5 * (log_probs[0, k + 1] - log_probs[0, 0] + log_probs[1, 0] - log_probs[1, k + 1])
        weights[limb] = scipy.special.expit(log_odds + LIKELIHOOD_POWER * log_ratio)
    return weights


def fuse_passes(
    first: FloatArray, second: FloatArray, covariance: FloatArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return mean (D,) and covariance (D, D) of the fused estimates (D,) of two passes.

    The passes are treated as two samples: x̄ = w x₁ + (1 − w) x₂, and the covariance grows by twice their weighted one,
    2 Σ w (x − x̄)² = 2 w (1 − w) d dᵀ with d = x₁ − x₂; for equal weights this is the unbiased estimate d dᵀ / 2.
    Angles are compared on the nearest turn.

    Parameters
    ----------
    first, second : (D,), the means of the passes.
    covariance : (D, D), of the second pass.
    weights : (P,), of the pose parameters in the first pass, see `first_pass_weights`; 0.5 for the other columns.
    """
    n = len(POSE_NAMES)
    difference = np.concatenate([unwrap_near(first[:n], second[:n]), first[n:]]) - second
    weights = np.concatenate([weights, np.full(len(second) - n, 0.5)])
    scaled = np.sqrt(weights * (1.0 - weights)) * difference
    return second + weights * difference, covariance + 2.0 * np.outer(scaled, scaled)
