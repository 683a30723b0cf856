"""A linear model of how all people move: the next frame's velocities, regressed on pose and velocities of this one.

Constant velocity with what recorded motions add to it: which angles change together, how soon a movement ends, and
where limbs tend to. It knows no activity and no phase.
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
"""The columns of a pose that do not depend on where a person is and faces: pitch, roll and the joint angles."""
_RIDGE = 1e-3
_POSTURES_HZ = 5.0
"""Neighbouring frames say the same of which postures people take."""
_LEAST_FRAMES = 3
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


@dataclass(frozen=True, eq=False)
class LinearMotion:
    """v' = gain [posture, v] + offset + N(0, covariance), and in a first frame v = start_gain posture + start_offset +
    N(0, start_covariance): velocities v (25,), m/s and rad/s, of the pose's numbers, the root's place as the person
    headed in the frame before, ahead and to the left; posture (21,), rad; one frame at rate_hz later. postures: which
    of these people take, if learned, as often as their mirror images."""

    rate_hz: float
    gain: FloatArray
    offset: FloatArray
    covariance: FloatArray
    start_gain: FloatArray
    start_offset: FloatArray
    start_covariance: FloatArray
    postures: PosePrior | None = None


def velocities(before: FloatArray, after: FloatArray, rate_hz: float) -> FloatArray:
    """Tell the velocities (..., 25) between poses (..., 25) of consecutive frames, see `LinearMotion`."""
    change = rate_hz * (after - before)
    c, s = np.cos(before[..., 3]), np.sin(before[..., 3])
    own = change.copy()
    own[..., 0], own[..., 1] = c * change[..., 0] + s * change[..., 1], c * change[..., 1] - s * change[..., 0]
    return own


def moved(before: FloatArray, velocity: FloatArray, rate_hz: float) -> FloatArray:
    """Lead poses (..., 25) on by velocities (..., 25), for one frame; undoes `velocities`."""
    c, s = np.cos(before[..., 3]), np.sin(before[..., 3])
    change = velocity / rate_hz
    after = before + change
    after[..., 0] = before[..., 0] + c * change[..., 0] - s * change[..., 1]
    after[..., 1] = before[..., 1] + s * change[..., 0] + c * change[..., 1]
    return after


def learn_linear_motion(motions: Sequence[Motion], rate_hz: float) -> LinearMotion:
    """Regress on all frames of motions, resampled, by least squares with a little ridge. Raises InputError where there
    are not more frames than numbers to learn."""
    known, following, postures = [], [], []
    for motion in motions:
        poses = motion.resampled(rate_hz).poses
        if len(poses) >= _LEAST_FRAMES:
            v = velocities(poses[:-1], poses[1:], rate_hz)
            known.append(np.concatenate([poses[1:-1, POSTURE], v[:-1]], axis=1))
            following.append(v[1:])
            postures.append(poses[1:-1, POSTURE])
    n = sum(map(len, known))
    if n <= 2 * (N_POSE + len(POSE_NAMES[POSTURE])):
        raise InputError(f"prior: a linear motion model needs some hundred frames to learn from, found {n}")
    inputs, targets, posture = (np.concatenate(each) for each in (known, following, postures))
    gain, offset, covariance = _regressed(inputs, targets)
    start_gain, start_offset, start_covariance = _regressed(posture, targets)
    taken = learn_postures(_with_mirror_images(posture[:: max(1, round(rate_hz / _POSTURES_HZ))]))
    return LinearMotion(rate_hz, gain, offset, covariance, start_gain, start_offset, start_covariance, taken)


def _with_mirror_images(postures: FloatArray) -> FloatArray:
    """Return postures (n, 21) and after them what a mirror makes of them: what one side does, the other may."""
    poses = np.zeros((len(postures), N_POSE))
    poses[:, POSTURE] = postures
    return np.concatenate([postures, mirror_image(poses)[:, POSTURE]])


def _regressed(inputs: FloatArray, targets: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return gain, offset and the covariance of what is left of targets (n, T) given inputs (n, F)."""
    middle, mean = inputs.mean(axis=0), targets.mean(axis=0)
    scales = inputs.std(axis=0) + 1e-9
    white = (inputs - middle) / scales
    normal = white.T @ white + _RIDGE * len(white) * np.eye(white.shape[1])
    gain = np.linalg.solve(normal, white.T @ (targets - mean)).T / scales
    residual = targets - mean - (inputs - middle) @ gain.T
    return gain, mean - gain @ middle, residual.T @ residual / len(residual) + 1e-9 * np.eye(targets.shape[1])


def learn_postures(postures: FloatArray) -> PosePrior:
    """Fit a mixture of Gaussians to postures (n, A), rad, by expectation and maximisation (Dempster,
    Laird & Rubin 1977), ROUNDS times.

    Each part's covariance is drawn to the mean one of all parts as by FRAMES_A_PART more frames: a part that few people
    have been in says little about how others may differ there.
    """
    n, a = postures.shape
    n_parts = max(1, min(N_PARTS, n // FRAMES_A_PART))
    first = stream(SEED, "postures").choice(n, n_parts, replace=False)
    wide = BEGUN**2 * np.cov(postures.T) + LEAST_RAD**2 * np.eye(a)
    model = PosePrior(np.full(n_parts, 1.0 / n_parts), postures[first], np.tile(wide, (n_parts, 1, 1)))
    for _ in range(ROUNDS):
        model = fitted(postures, model.shares(postures))
    return model


def fitted(postures: FloatArray, shares: FloatArray) -> PosePrior:
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
    return PosePrior(sizes / sizes.sum(), means, drawn + LEAST_RAD**2 * np.eye(a))
