"""Least squares one frame after the other: the root alone, root and motion followed, or a pose without a model."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from tqdm import tqdm

from workbench.arrays import FloatArray, IntArray
from workbench.body.skeleton import N_ROOT
from workbench.body.turns import nearest_turn
from workbench.core.residual import Loss, ResidualFunction
from workbench.core.smoothness import PACE_HZ, Smoothness
from workbench.inference.fit.arrowhead import Pattern
from workbench.inference.fit.decoding import Decoder, MotionDecoder, PoseDecoder
from workbench.inference.fit.solver import Minimum, Quadratic, minimise

WIDENED = (8.0, 1.0)
"""Scales of the loss, one after the other, with which a root is found that may start decimetres away: a redescending
loss sees nothing further off than its scale (graduated non-convexity, Blake & Zisserman 1987)."""
STEADY_FRAMES = 6
"""Frames over which the phase's speed is taken when a motion is followed: the last difference alone is so noisy that a
phase may stall, and from half a cycle behind nothing brings it back."""
STYLE_HELD = 0.4
"""Part of the smoothness that a style has while a motion is followed: one frame alone bends it to fit a wrong phase."""
FLAT = 1.0
"""Standard deviation, m and rad, that numbers of a pose have which no point and no prior speaks of."""

PRIOR_PHASES = 64
PRIOR_RAD = 0.05
"""Standard deviation of an angle beside what the motion model explains of it."""


@dataclass(frozen=True, eq=False)
class Gaussian:
    """A Gaussian over states: whitening (m, D) times (state − mean) is m standard normal numbers. mean: (D,)."""

    mean: FloatArray
    whitening: FloatArray

    @staticmethod
    def independent(mean: FloatArray, deviations: FloatArray) -> "Gaussian":
        """With these standard deviations (D,); infinite ones leave a number free."""
        return Gaussian(mean, np.diag(1.0 / deviations))


def fit_frame(
    decoder: Decoder,
    residual: ResidualFunction,
    loss: Loss,
    state: FloatArray,
    *,
    free: IntArray | None = None,
    prior: Gaussian | None = None,
    max_iterations: int = 20,
    tolerance: float = 1e-3,
) -> Minimum:
    """The state near `state` (D,) that fits one frame best, over its columns `free` (n,), all by default.

    The minimum's x is the whole state; its quadratic is that of the free columns.
    """
    free = np.arange(len(state)) if free is None else free
    places = _full(len(free)).place(*np.indices((len(free), len(free))))

    def expand(x: FloatArray) -> Quadratic:
        moved = _with(state, free, x)[None]
        misses, slopes = residual(decoder.poses(moved)[0])
        rho, weights = loss(misses)
        slopes = slopes @ decoder.jacobian(moved)[0][:, free]
        weighted = weights[:, None] * slopes
        cost, gradient, normal = float(rho.sum()), weighted.T @ misses, weighted.T @ slopes
        trust = np.diag(normal).copy()
        if prior is not None:
            apart, rows = prior.whitening @ (moved[0] - prior.mean), prior.whitening[:, free]
            cost += 0.5 * float(apart @ apart)
            gradient += rows.T @ apart
            normal += rows.T @ rows
        return Quadratic(cost, gradient, _full(len(free)).fill(places, normal), trust)

    found = minimise(expand, state[free], max_iterations=max_iterations, tolerance=tolerance)
    return Minimum(_with(state, free, found.x), found.quadratic, found.costs, found.iterations)


def fit_root(
    decoder: PoseDecoder,
    residual: ResidualFunction,
    loss: Loss,
    guesses: Sequence[FloatArray],
    widened: tuple[float, ...],
) -> Minimum:
    """The root of one frame, its joint angles kept: from that of the poses `guesses` (P,) that fits best at first.

    widened: factors of the loss's scale, one after the other.
    """
    wide = loss.wider(widened[0])
    pose = min(guesses, key=lambda guess: float(wide(residual(guess)[0])[0].sum())) if len(guesses) > 1 else guesses[0]
    for factor in widened:
        found = fit_frame(decoder, residual, loss.wider(factor), pose, free=np.arange(N_ROOT))
        pose = found.x
    return found


def global_motion(
    decoder: MotionDecoder, residuals: Sequence[ResidualFunction], loss: Loss, states: FloatArray
) -> FloatArray:
    """The roots of all frames, each from the frame before (paper D, section 4, eq. 10), in states (T, D).

    The coefficients and phases of `states` are kept, and the root of its first row is the start. Where two frames are
    known the next one may also start where their motion leads: at 14 Hz a runner's root moves 25 cm a frame.
    """
    free, angles = PoseDecoder(decoder.skeleton), decoder.poses(states)[:, N_ROOT:]
    roots = np.repeat(states[:1, -N_ROOT:], len(states), axis=0)
    for t in tqdm(range(len(states)), desc="global motion", unit="frame", disable=None, leave=False):
        guesses = [roots[max(t - 1, 0)]] + [2.0 * roots[t - 1] - roots[t - 2]] * (t > 1)
        poses = [np.concatenate([guess, angles[t]]) for guess in guesses]
        roots[t] = fit_root(free, residuals[t], loss, poses, WIDENED).x[:N_ROOT]
    return np.hstack([states[:, :-N_ROOT], roots])


def follow(
    decoder: MotionDecoder,
    residuals: Sequence[ResidualFunction],
    times_s: FloatArray,
    loss: Loss,
    known: FloatArray,
    smoothness: Smoothness,
) -> FloatArray:
    """States (T, D) of all frames, of which the first ones are `known` (F ≥ 2, D), and the next follow one by one.

    Each frame has root, phase and coefficients of its own under the batch's smoothness with the frames before held;
    the phase goes on at its mean speed of late, and the root is first found with a wide loss: what goes wrong here is
    hard to undo.
    """
    states, free, phase = list(known), PoseDecoder(decoder.skeleton), decoder.n_style
    gaps = PACE_HZ * np.diff(times_s)
    for t in tqdm(range(len(known), len(residuals)), desc="following", unit="frame", disable=None, leave=False):
        before, after = gaps[t - 2 : t]
        ahead = states[t - 1] + (states[t - 1] - states[t - 2]) * (after / before)
        ahead[: decoder.n_style] = states[t - 1][: decoder.n_style]
        first = max(t - 1 - STEADY_FRAMES, 0)
        speed = (states[t - 1][phase] - states[first][phase]) / gaps[first : t - 1].sum()
        ahead[phase] = states[t - 1][phase] + speed * after
        bend = after * np.sqrt(0.5 * (before + after)) * smoothness.second_differences
        deviations = np.concatenate(
            [np.full(decoder.n_style, min(1.0, STYLE_HELD * smoothness.style * np.sqrt(after))), bend]
        )
        near = fit_root(free, residuals[t], loss, [decoder.poses(ahead[None])[0]], WIDENED[:1])
        state = np.concatenate([ahead[:-N_ROOT], near.x[:N_ROOT]])
        prior = Gaussian.independent(ahead, deviations)
        states.append(fit_frame(decoder, residuals[t], loss, state, prior=prior).x)
    return np.array(states)


def track_poses(
    decoder: PoseDecoder,
    residuals: Sequence[ResidualFunction],
    loss: Loss,
    start: FloatArray,
    prior: Gaussian | None = None,
) -> tuple[FloatArray, FloatArray, list[Minimum]]:
    """No motion model: poses (T, P), their covariances (T, P, P) and the searches, each from the pose of the frame
    before (paper D, section 4.1), the first from `start` (P,), with a Gaussian `prior` over poses or without.

    A joint's angles come out within half a turn of the middle of their limits: a straight arm's twist, which no point
    tells, may have gone round. A covariance is the inverse of the Gauss–Newton matrix; what neither points nor prior
    tell has the deviation FLAT.
    """
    poses, covariances, searches, pose = [], [], [], start
    middle = decoder.skeleton.limits[N_ROOT:].mean(axis=1)
    for residual in tqdm(residuals, desc="frame by frame", unit="frame", disable=None, leave=False):
        searches.append(fit_frame(decoder, residual, loss, pose, prior=prior, max_iterations=40))
        found = searches[-1].x
        pose = nearest_turn(found, np.concatenate([pose[:N_ROOT], middle]))
        poses.append(pose)
        covariances.append(np.linalg.inv(searches[-1].quadratic.normal.dense() + np.eye(len(pose)) / FLAT**2))
    return np.array(poses), np.array(covariances), searches


def pose_prior(decoder: MotionDecoder) -> Gaussian:
    """The Gaussian of the poses a motion model makes: over all phases, and coefficients N(0, 1); the root is free.

    Angles the model does not speak of rest where they are, with its smallest deviation, PRIOR_RAD.
    """
    phases = np.arange(PRIOR_PHASES) / PRIOR_PHASES
    states = decoder.states(np.zeros(decoder.n_style), phases, np.zeros(N_ROOT))
    poses, by_style = decoder.poses(states), decoder.jacobian(states)[:, :, : decoder.n_style]
    mean = poses.mean(axis=0)
    spread = np.cov(poses.T, bias=True) + np.einsum("tpi,tqi->pq", by_style, by_style) / PRIOR_PHASES
    angles = spread[N_ROOT:, N_ROOT:] + PRIOR_RAD**2 * np.eye(len(mean) - N_ROOT)
    whitening = np.zeros((len(mean) - N_ROOT, len(mean)))
    whitening[:, N_ROOT:] = np.linalg.inv(np.linalg.cholesky(angles))
    return Gaussian(mean, whitening)


@lru_cache
def _full(n: int) -> Pattern:
    """The pattern of a dense matrix."""
    return Pattern(n_band=n, n_border=0, width=n - 1)


def _with(state: FloatArray, columns: IntArray, values: FloatArray) -> FloatArray:
    changed = state.copy()
    changed[columns] = values
    return changed
