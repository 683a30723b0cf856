"""Linear-Gaussian motion model of all activities: the next frame's velocities, regressed on pose and velocities.

It extends constant velocity by what recorded motions show: correlations between angles, decay of velocities, and
preferred postures. It has no activity and no phase.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.body.angles import mirror_image
from workbench.body.skeleton import POSE_NAMES
from workbench.core.pose_prior import PosePrior
from workbench.motion.pose_sequence import Motion
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.rng import stream

N_POSE = len(POSE_NAMES)
POSTURE = slice(4, N_POSE)
"""The columns of a pose that do not depend on the person's place and heading: pitch, roll and the joint angles."""
_RIDGE = 1e-3
_POSTURE_RATE_HZ = 5.0
"""Rate at which frames are sampled for the pose prior, since neighbouring frames are redundant."""
_MIN_FRAMES = 3
MAX_COMPONENTS = 32
"""Of the pose prior, and at most one for every FRAMES_PER_COMPONENT frames."""
FRAMES_PER_COMPONENT = 50
"""Frames per component, and the weight of the pooled covariance in each component's covariance, in frames."""
N_EM_ITERATIONS = 10
INITIAL_STD_FRACTION = 0.2
"""Initial standard deviations of the components, as a fraction of those of all postures."""
MIN_STD_RAD = 0.02
"""Added in quadrature to the standard deviation of every angle."""
SEED = 0


@dataclass(frozen=True, eq=False)
class LinearMotion:
    """v' = gain [posture, v] + offset + N(0, covariance), one frame at `rate_hz` later.

    In a first frame v = initial_gain posture + initial_offset + N(0, initial_covariance). v (25,) are the velocities
    of the pose parameters, m/s and rad/s; those of the root's place are along and to the left of the heading in the
    previous frame. posture (21,), rad. pose_prior : over the training postures and their mirror images, if learned.
    """

    rate_hz: float
    gain: FloatArray
    offset: FloatArray
    covariance: FloatArray
    initial_gain: FloatArray
    initial_offset: FloatArray
    initial_covariance: FloatArray
    pose_prior: PosePrior | None = None


def velocities(before: FloatArray, after: FloatArray, rate_hz: float) -> FloatArray:
    """Return the velocities (..., 25) between poses (..., 25) of consecutive frames, see `LinearMotion`."""
    change = rate_hz * (after - before)
    c, s = np.cos(before[..., 3]), np.sin(before[..., 3])
    local = change.copy()
    local[..., 0], local[..., 1] = c * change[..., 0] + s * change[..., 1], c * change[..., 1] - s * change[..., 0]
    return local


def integrated(before: FloatArray, velocity: FloatArray, rate_hz: float) -> FloatArray:
    """Return the poses (..., 25) one frame after poses (..., 25) with velocities (..., 25); inverts `velocities`."""
    c, s = np.cos(before[..., 3]), np.sin(before[..., 3])
    change = velocity / rate_hz
    after = before + change
    after[..., 0] = before[..., 0] + c * change[..., 0] - s * change[..., 1]
    after[..., 1] = before[..., 1] + s * change[..., 0] + c * change[..., 1]
    return after


def learn_linear_motion(motions: Sequence[Motion], rate_hz: float) -> LinearMotion:
    """Fit the model to all frames of resampled motions by ridge regression.

    Raises InputError if there are not more frames than parameters.
    """
    inputs_by_motion, targets_by_motion, postures_by_motion = [], [], []
    for motion in motions:
        poses = motion.resampled(rate_hz).poses
        if len(poses) >= _MIN_FRAMES:
            v = velocities(poses[:-1], poses[1:], rate_hz)
            inputs_by_motion.append(np.concatenate([poses[1:-1, POSTURE], v[:-1]], axis=1))
            targets_by_motion.append(v[1:])
            postures_by_motion.append(poses[1:-1, POSTURE])
    n = sum(map(len, inputs_by_motion))
    if n <= 2 * (N_POSE + len(POSE_NAMES[POSTURE])):
        raise InputError(f"prior: a linear motion model needs some hundred frames to learn from, found {n}")
    groups = (inputs_by_motion, targets_by_motion, postures_by_motion)
    inputs, targets, postures = (np.concatenate(each) for each in groups)
    gain, offset, covariance = _ridge_regression(inputs, targets)
    initial = _ridge_regression(postures, targets)
    pose_prior = learn_pose_prior(_with_mirror_images(postures[:: max(1, round(rate_hz / _POSTURE_RATE_HZ))]))
    return LinearMotion(rate_hz, gain, offset, covariance, *initial, pose_prior)


def _with_mirror_images(postures: FloatArray) -> FloatArray:
    """Return postures (n, 21) followed by their mirror images."""
    poses = np.zeros((len(postures), N_POSE))
    poses[:, POSTURE] = postures
    return np.concatenate([postures, mirror_image(poses)[:, POSTURE]])


def _ridge_regression(inputs: FloatArray, targets: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return gain, offset and residual covariance of the regression of targets (n, T) on inputs (n, F)."""
    input_mean, target_mean = inputs.mean(axis=0), targets.mean(axis=0)
    scales = inputs.std(axis=0) + 1e-9
    scaled = (inputs - input_mean) / scales
    normal = scaled.T @ scaled + _RIDGE * len(scaled) * np.eye(scaled.shape[1])
    gain = np.linalg.solve(normal, scaled.T @ (targets - target_mean)).T / scales
    residual = targets - target_mean - (inputs - input_mean) @ gain.T
    covariance = residual.T @ residual / len(residual) + 1e-9 * np.eye(targets.shape[1])
    return gain, target_mean - gain @ input_mean, covariance


def learn_pose_prior(postures: FloatArray) -> PosePrior:
    """Fit a Gaussian mixture to postures (n, A), rad, by expectation maximisation with N_EM_ITERATIONS iterations.

    Each component's covariance is shrunk towards the pooled one with the weight of FRAMES_PER_COMPONENT frames, since
    a component with few frames determines its covariance poorly.

    References
    ----------
    Dempster, Laird & Rubin, 1977.
    """
    n, a = postures.shape
    n_components = max(1, min(MAX_COMPONENTS, n // FRAMES_PER_COMPONENT))
    first = stream(SEED, "postures").choice(n, n_components, replace=False)
    covariance = INITIAL_STD_FRACTION**2 * np.cov(postures.T) + MIN_STD_RAD**2 * np.eye(a)
    covariances = np.tile(covariance, (n_components, 1, 1))
    model = PosePrior(np.full(n_components, 1.0 / n_components), postures[first], covariances)
    for _ in range(N_EM_ITERATIONS):
        model = maximisation_step(postures, model.responsibilities(postures))
    return model


def maximisation_step(postures: FloatArray, responsibilities: FloatArray) -> PosePrior:
    """Return the mixture for given responsibilities (n, K) of postures (n, A), rad: the M step."""
    n, a = postures.shape
    sizes = responsibilities.sum(axis=0) + 1e-9
    means = (responsibilities.T @ postures) / sizes[:, None]
    scatter = np.empty((len(sizes), a, a))
    for k, mean in enumerate(means):
        deviations = postures - mean
        scatter[k] = (deviations * responsibilities[:, k, None]).T @ deviations
    pooled = scatter.sum(axis=0) / n
    shrunk = (scatter + FRAMES_PER_COMPONENT * pooled) / (sizes + FRAMES_PER_COMPONENT)[:, None, None]
    return PosePrior(sizes / sizes.sum(), means, shrunk + MIN_STD_RAD**2 * np.eye(a))
