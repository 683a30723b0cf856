"""The Gaussian state of a frame: predicted by the prior, smoothed backwards, and two passes fused."""

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

_CHANGE = 1e-5
"""Over which the prior's mean is differentiated, m, rad and their speeds."""


@dataclass(frozen=True, eq=False)
class GaussianState:
    """N(mean (D,), covariance (D, D)) of the state in one frame, and what was believed before the frame was seen, with
    the derivatives (D, D) of that by the state before. doubt: (P,), by how much wider the pose's numbers are told.
    shares: (P,), 0 to 1, how much these count by an earlier look at the clip where both are told."""

    mean: FloatArray
    covariance: FloatArray
    predicted: FloatArray
    predicted_covariance: FloatArray
    transition: FloatArray
    doubt: FloatArray
    shares: FloatArray = field(default_factory=lambda: np.full(len(POSE_NAMES), 0.5))

    def released(self, known: IntArray, values: FloatArray, deviations: FloatArray) -> "GaussianState":
        """As if the past said nothing of some columns `info` (K,), which are expected at values (K,), deviations (K,)
        off."""
        mean, covariance, transition = self.mean.copy(), self.covariance.copy(), self.transition.copy()
        covariance[known], covariance[:, known], transition[known] = 0.0, 0.0, 0.0
        mean[known], covariance[known, known] = values, deviations**2
        return replace(
            self, mean=mean, covariance=covariance, predicted=mean, predicted_covariance=covariance,
            transition=transition,
        )  # fmt: skip


def gaussian_of(prior: Prior) -> Gaussian:
    """Return the prior's density; raises InputError where its noise is not Gaussian, or its states do not begin with
    the pose."""
    density, names = prior.capabilities.density, prior.space.names
    if not isinstance(density, Gaussian) or names[: len(POSE_NAMES)] != POSE_NAMES:
        raise InputError(
            "inference: a Kalman filter needs a prior with Gaussian noise that moves the whole pose, such as linear, "
            f"found {type(prior).__name__}"
        )
    return density


def predict(model: Gaussian, belief: GaussianState, dt_s: float) -> GaussianState:
    """Lead a belief on by the prior's mean, its derivatives and its noise."""
    d = len(belief.mean)
    around = belief.mean + _CHANGE * np.concatenate([np.zeros((1, d)), np.eye(d), -np.eye(d)])
    led = model.mean(around, dt_s)
    transition = (led[1 : d + 1] - led[d + 1 :]).T / (2.0 * _CHANGE)
    covariance = predict_covariance(belief.covariance, transition, model.noise_covariance(belief.mean, dt_s))
    return GaussianState(led[0], covariance, led[0], covariance, transition, belief.doubt)


def smoothed(beliefs: list[GaussianState]) -> list[GaussianState]:
    """Smooth filtered beliefs by one pass back over them (Rauch, Tung & Striebel 1965)."""
    later = beliefs[-1:]
    for belief, following in zip(beliefs[-2::-1], beliefs[:0:-1], strict=True):
        mean, covariance = smooth(
            (belief.mean, belief.covariance), following.transition,
            (following.predicted, following.predicted_covariance), (later[-1].mean, later[-1].covariance),
        )  # fmt: skip
        later.append(replace(belief, mean=mean, covariance=covariance))
    return later[::-1]


PIXELS_SAY = 0.1
"""Power of a frame's likelihood by which looks are weighed: neighbouring frames err together, and so do cells that
learned from poses that were off."""
OWN_M = 0.045
"""By how much a look's joints err by themselves, m; what looks differ by beyond that is put down to the earlier one."""


def shares(
    frame_likelihood: DenseLikelihood,
    skeleton: Skeleton,
    limbs: Sequence[IntArray],
    pose: FloatArray,
    other: FloatArray,
) -> FloatArray:
    """Return the weights (P,) of a first pass's pose `other` (P,) beside the second pass's `pose` (P,), 0 to 1.

    The odds are OWN_M² to OWN_M² + d², d being the mean distance of their joints: inverse variances, where both passes
    err by OWN_M and the first one, which lacked the scene behind the person, by their difference too. Of each limb,
    columns (k,) of the pose, these odds are multiplied by the ratio of the frame's likelihoods with either limb to the
    power PIXELS_SAY, averaged over the bodies of both passes. Deviation: the root is not weighed by the likelihood, as
    pixels do not say how far away the whole body is."""
    n, joints = len(limbs), np.ones(len(skeleton.names), dtype=np.bool_)
    theirs = unwrap_near(other, pose)
    tried = np.repeat(np.stack([pose, theirs]), n + 1, axis=0)  # each body, then with each of the other's limbs
    for k, limb in enumerate(limbs):
        tried[k + 1, limb], tried[n + k + 2, limb] = theirs[limb], pose[limb]
    ratios = frame_likelihood.compare(tried, joints).reshape(2, n + 1)
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
    """Fuse the estimates (D,) of two passes; return mean (D,) and covariance (D, D).

    covariance: (D, D), of the second pass. weights: (P,) of the pose's numbers in the first pass, see `shares`; of the
    other columns both count alike.

    The passes are taken as two samples: x̄ = w x₁ + (1 − w) x₂, and the covariance gains twice their weighted one, 2 Σ
    w (x − x̄)² = 2 w (1 − w) d dᵀ with d = x₁ − x₂, the unbiased estimate d dᵀ / 2 where both count alike. Angles are
    compared on the nearest turn."""
    n = len(POSE_NAMES)
    apart = np.concatenate([unwrap_near(first[:n], second[:n]), first[n:]]) - second
    every = np.concatenate([weights, np.full(len(second) - n, 0.5)])
    spread = np.sqrt(every * (1.0 - every)) * apart
    return second + every * apart, covariance + 2.0 * np.outer(spread, spread)
