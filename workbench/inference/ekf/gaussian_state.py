"""What is believed of the state in a frame: a Gaussian, led on by the prior and, when all frames are seen, led back."""

from dataclasses import dataclass, field, replace

import numpy as np

from workbench.body.skeleton import POSE_NAMES
from workbench.core.gaussian import predict_covariance, smooth
from workbench.core.prior import Gaussian, Prior
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

_CHANGE = 1e-5
"""Over which the prior's mean is differentiated, m, rad and their speeds."""


@dataclass(frozen=True, eq=False)
class Belief:
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

    def released(self, known: IntArray, values: FloatArray, deviations: FloatArray) -> "Belief":
        """As if the past said nothing of some columns `known` (K,), which are expected at values (K,), deviations (K,)
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
    density, names = prior.powers.density, prior.space.names
    if not isinstance(density, Gaussian) or names[: len(POSE_NAMES)] != POSE_NAMES:
        raise InputError(
            "inference: a Kalman filter needs a prior with Gaussian noise that moves the whole pose, such as linear, "
            f"found {type(prior).__name__}"
        )
    return density


def predict(model: Gaussian, belief: Belief, dt_s: float) -> Belief:
    """Lead a belief on by the prior's mean, its derivatives and its noise."""
    d = len(belief.mean)
    around = belief.mean + _CHANGE * np.concatenate([np.zeros((1, d)), np.eye(d), -np.eye(d)])
    led = model.mean(around, dt_s)
    transition = (led[1 : d + 1] - led[d + 1 :]).T / (2.0 * _CHANGE)
    covariance = predict_covariance(belief.covariance, transition, model.noise_covariance(belief.mean, dt_s))
    return Belief(led[0], covariance, led[0], covariance, transition, belief.doubt)


def smoothed(beliefs: list[Belief]) -> list[Belief]:
    """Smooth filtered beliefs by one pass back over them (Rauch, Tung & Striebel 1965)."""
    later = beliefs[-1:]
    for belief, following in zip(beliefs[-2::-1], beliefs[:0:-1], strict=True):
        mean, covariance = smooth(
            (belief.mean, belief.covariance), following.transition,
            (following.predicted, following.predicted_covariance), (later[-1].mean, later[-1].covariance),
        )  # fmt: skip
        later.append(replace(belief, mean=mean, covariance=covariance))
    return later[::-1]
