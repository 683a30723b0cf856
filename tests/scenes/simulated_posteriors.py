"""Simulation-based calibration (Talts, Betancourt, Simpson, Vehtari & Gelman 2018).

Truths are drawn from a prior and data from the likelihood's model; the ranks of the truths in the posteriors are
uniform if the inference is exact.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from keypoint_scenes import BODY, CAMERA
from least_squares_scenes import PriorStub, SineModel
from linear_gaussian import streams
from scipy.stats import chisquare

from workbench.body.kinematics import joints
from workbench.body.skeleton import POSE_NAMES
from workbench.core.frame import Frame, View
from workbench.core.losses import DEGREES_OF_FREEDOM
from workbench.core.prior import REFERENCE_RATE_HZ, Smoothness
from workbench.evaluation.uncertainty.posterior_calibration import ranks, weight_below
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.motion.motion_decoder import MotionDecoder
from workbench.inference.least_squares.motion.motion_fit import MotionFit
from workbench.inference.least_squares.solver.residuals import UPRIGHT_SIGMA_RAD
from workbench.likelihoods.keypoints import KeypointLikelihood
from workbench.motion.models.walking import learn_walking
from workbench.motion.synthetic.gait import builtin_motions
from workbench.priors.cyclic import Cyclic
from workbench.priors.smooth import Smooth

RATE_HZ = 30.0
SIGMA_PX = 4.0
STUDENT = KeypointLikelihood(BODY, sigma_px=SIGMA_PX, likelihood_power=1.0)
"""Without tempering, because Student's distribution to the power of 0.3 cannot be normalised and sampled."""
NORMAL = KeypointLikelihood(BODY, sigma_px=SIGMA_PX, loss="squared")
"""The likelihood for which least squares assumes normal errors."""


@dataclass(frozen=True, eq=False)
class Simulated:
    """Ranks (R, T, Q), 0..1, of R truths in their posteriors, for Q parameters in T frames."""

    ranks: np.ndarray

    def coverage(self, level):
        """Return the fraction of truths in central intervals of this level, over all frames but the first."""
        tail = 0.5 - 0.5 * level
        return float(((self.ranks[:, 1:] > tail) & (self.ranks[:, 1:] < 1.0 - tail)).mean())

    def p_values(self, n_bins=5):
        """Return p-values (Q,) of χ² tests that the last frame's ranks, independent between replicates, are uniform."""
        return np.array(
            [chisquare(np.histogram(column, n_bins, (0.0, 1.0))[0]).pvalue for column in self.ranks[:, -1].T]
        )


@cache
def walking_prior():
    """Return the walking prior of generated walkers."""
    return Cyclic(learn_walking(builtin_motions(), variance=0.95, n_components=8, scaling="joints"))


@cache
def arm_prior():
    """Return the smooth prior of one arm."""
    return Smooth(parameters=["right_arm"])


def initial_pose():
    """Return a generated walker's pose at the centre of the camera's image."""
    pose = builtin_motions()[0].poses[0].copy()
    pose[:4] = 0.4, 0.0, 0.95, 0.3
    return pose


def filtered(infer, prior, n_frames, n_replicates, seed=0):
    """Simulate runs of `infer(prior, likelihood)`; ranks are of the pose parameters that the prior moves."""
    pose, moving = initial_pose(), [k for k, name in enumerate(POSE_NAMES) if name in prior.parameters]
    replicate_ranks = []
    for replicate in range(n_replicates):
        rng = np.random.default_rng([seed, replicate])
        states = [prior.sample_initial(pose, 1, rng)]
        for _ in range(n_frames - 1):
            states.append(prior.sample_transition(states[-1], 1.0 / RATE_HZ, rng))
        truth = prior.pose(np.concatenate(states))
        steps = infer(prior, STUDENT).run(
            simulated_frames(truth, RATE_HZ, DEGREES_OF_FREEDOM, rng), pose, streams([seed, replicate, 1])
        )
        replicate_ranks.append(ranked(steps, truth, moving))
    return Simulated(np.array(replicate_ranks))


def fitted(frames_per_style, n_frames, n_replicates, seed=0, correlation=0.0, **options):
    """Simulate fits of a motion model of two legs to keypoints, whose regularisation is the prior.

    The start and the speed of the walk, on which there is no prior, are the same in every replicate. correlation: of
    the errors between successive frames. options: of the problem.
    """
    moving = [*range(6), *(POSE_NAMES.index(name) for name in SineModel.angles)]
    decoder, replicate_ranks = MotionDecoder(BODY.skeleton, SineModel(), np.zeros(len(POSE_NAMES))), []
    for replicate in range(n_replicates):
        rng = np.random.default_rng([seed, replicate])
        states = walk_of_a_fit(n_frames, frames_per_style, rng)
        truth, ends = decoder.poses(states), (states[0, 2], states[-1, 2])
        problem = MotionFit(frames_per_style, **options)
        fit = LeastSquares(BODY, NORMAL, PriorStub(motion=SineModel()), phase_ends=ends, problem=problem)
        frames = simulated_frames(truth, REFERENCE_RATE_HZ, np.inf, rng, correlation)
        steps = fit.run(frames, truth[0], streams([seed, replicate, 1]))
        replicate_ranks.append(ranked(steps, truth, moving))
    return Simulated(np.array(replicate_ranks))


def ranked(steps, truth, moving):
    """Return ranks (T, Q) of the parameters `moving` of true poses (T, P) in a run's steps."""
    return np.array(
        [
            ranks(weight_below(step.poses[:, moving], np.exp(step.log_weights), truth[t, moving]))
            for t, step in enumerate(steps)
        ]
    )


def simulated_frames(poses, rate_hz, nu, rng, correlation=0.0):
    """Return frames with keypoints of poses (T, P) drawn from Student's distribution in 2-D with ν degrees of freedom.

    Infinite ν gives the normal distribution, whose errors may be an autoregression with a correlation.
    """
    pixels = CAMERA.project(joints(BODY.skeleton, poses))
    noise = rng.standard_normal(pixels.shape)
    for t in range(1, len(noise)):
        noise[t] = correlation * noise[t - 1] + np.sqrt(1.0 - correlation**2) * noise[t]
    if np.isfinite(nu):
        noise *= np.sqrt(nu / rng.chisquare(nu, (*pixels.shape[:2], 1)))
    keypoints = np.concatenate([pixels + SIGMA_PX * noise, np.ones((*pixels.shape[:2], 1))], axis=2)
    image = np.zeros((4, 4), np.uint8)
    return [Frame(t, t / rate_hz, (View(CAMERA, image, rows),)) for t, rows in enumerate(keypoints)]


def walk_of_a_fit(n_frames, frames_per_style, rng):
    """Return states (T, 9), {α, μ, root}, at the reference rate from the prior of a fit and an upright torso."""
    smoothness, styles = Smoothness(), [rng.standard_normal(2)]
    for _ in range(-(-n_frames // frames_per_style) - 1):
        ar_coefficient = np.sqrt(1.0 - smoothness.style**2) ** frames_per_style
        styles.append(ar_coefficient * styles[-1] + np.sqrt(1.0 - ar_coefficient**2) * rng.standard_normal(2))
    alpha = np.repeat(styles, frames_per_style, axis=0)[:n_frames]
    time = np.arange(n_frames)[:, None]
    level, slope = np.array([0.3, 0.4, 0.0, 0.95, 0.3, 0.0, 0.0]), np.array([0.08, 0.08, 0.03, 0.0, 0.02, 0.0, 0.0])
    bends = np.diff(np.eye(n_frames), 2, axis=0)
    trajectories = level + slope * (time - time.mean() * (np.arange(7) > 0))
    for k, deviation in enumerate(smoothness.second_differences):
        if k < 5:
            trajectories[2:, k] += np.cumsum(np.cumsum(deviation * rng.standard_normal(n_frames - 2)))
        else:  # pitch and roll
            precision = bends.T @ bends / deviation**2 + np.eye(n_frames) / UPRIGHT_SIGMA_RAD**2
            trajectories[:, k] = np.linalg.solve(np.linalg.cholesky(precision).T, rng.standard_normal(n_frames))
    return np.hstack([alpha, trajectories])
