"""Simulation-based calibration (Talts, Betancourt, Simpson, Vehtari & Gelman 2018): truths drawn from a prior, data
drawn from a likelihood's own model, and where the truths lie in the posteriors that an inference makes of the data."""

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
from workbench.core.prior import REFERENCE_RATE_HZ, Smoothness
from workbench.evaluation.posterior_calibration import rank_histogram, ranks, weight_below
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.motion_fit import MotionFit
from workbench.inference.least_squares.residuals import UPRIGHT_SIGMA_RAD
from workbench.inference.least_squares.single_frame import MotionDecoder
from workbench.likelihoods.keypoints import DEGREES_OF_FREEDOM, KeypointLikelihood
from workbench.motion.models.walking import learn_walking
from workbench.motion.synthetic.gait import builtin_motions
from workbench.priors.cyclic import Cyclic
from workbench.priors.smooth import Smooth

RATE_HZ = 30.0
SIGMA_PX = 4.0
STUDENT = KeypointLikelihood(BODY, sigma_px=SIGMA_PX, likelihood_power=1.0)
"""Not tempered: to the power of 0.3 Student's distribution cannot be normalised, and nothing could be drawn from it."""
NORMAL = KeypointLikelihood(BODY, sigma_px=SIGMA_PX, loss="squared")
"""Least squares then takes errors for normal."""


@dataclass(frozen=True, eq=False)
class Simulated:
    """Where R truths lie in their posteriors. ranks: (R, T, Q), in 0..1, of Q numbers of T frames."""

    ranks: np.ndarray

    def coverage(self, level):
        """The part of truths in central bands of this level, over all replicates, numbers and frames but the first."""
        tail = 0.5 - 0.5 * level
        return float(((self.ranks[:, 1:] > tail) & (self.ranks[:, 1:] < 1.0 - tail)).mean())

    def p_values(self, n_bins=5):
        """(Q,) of χ² tests that the last frame's ranks, independent from replicate to replicate, are even."""
        return np.array([chisquare(rank_histogram(column, n_bins)).pvalue for column in self.ranks[:, -1].T])


@cache
def walking_prior():
    """The walking prior over generated walkers."""
    return Cyclic(learn_walking(builtin_motions(), variance=0.95, n_components=8, scaling="joints"))


@cache
def arm_prior():
    """The smooth prior of one arm."""
    return Smooth(parameters=["right_arm"])


def initial_pose():
    """A generated walker's pose in the middle of the camera's image."""
    pose = builtin_motions()[0].poses[0].copy()
    pose[:4] = 0.4, 0.0, 0.95, 0.3
    return pose


def filtered(infer, prior, n_frames, n_replicates, seed=0):
    """Simulate particles of `infer(prior, likelihood)`; ranks are of the pose's numbers that the prior moves."""
    pose, moving = initial_pose(), [k for k, name in enumerate(POSE_NAMES) if name in prior.parameters]
    found = []
    for replicate in range(n_replicates):
        rng = np.random.default_rng([seed, replicate])
        states = [prior.sample_initial(pose, 1, rng)]
        for _ in range(n_frames - 1):
            states.append(prior.sample_transition(states[-1], 1.0 / RATE_HZ, rng))
        truth = prior.pose(np.concatenate(states))
        steps = infer(prior, STUDENT).run(
            simulated_frames(truth, RATE_HZ, DEGREES_OF_FREEDOM, rng), pose, streams([seed, replicate, 1])
        )
        found.append(ranked(steps, truth, moving))
    return Simulated(np.array(found))


def fitted(frames_per_style, n_frames, n_replicates, seed=0, correlation=0.0, **options):
    """Simulate fits of a motion model of two legs to keypoints, whose regularisation is the prior. What it says nothing
    about, where the walk begins and how fast it goes, is the same in every replicate. correlation: of the errors from
    frame to frame. options: of the problem."""
    moving = [*range(6), *(POSE_NAMES.index(name) for name in SineModel.angles)]
    decoder, found = MotionDecoder(BODY.skeleton, SineModel(), np.zeros(len(POSE_NAMES))), []
    for replicate in range(n_replicates):
        rng = np.random.default_rng([seed, replicate])
        states = walk_of_a_fit(n_frames, frames_per_style, rng)
        truth, ends = decoder.poses(states), (states[0, 2], states[-1, 2])
        problem = MotionFit(frames_per_style, ends, **options)  # phases to begin the search with
        fit = LeastSquares(BODY, NORMAL, PriorStub(motion=SineModel()), problem=problem)
        seen = simulated_frames(truth, REFERENCE_RATE_HZ, np.inf, rng, correlation)
        steps = fit.run(seen, truth[0], streams([seed, replicate, 1]))
        found.append(ranked(steps, truth, moving))
    return Simulated(np.array(found))


def ranked(steps, truth, moving):
    """Ranks (T, Q) of the numbers `moving` of true poses (T, P) in a run's steps."""
    return np.array(
        [
            ranks(weight_below(step.poses[:, moving], np.exp(step.log_weights), truth[t, moving]))
            for t, step in enumerate(steps)
        ]
    )


def simulated_frames(poses, rate_hz, nu, rng, correlation=0.0):
    """Frames with keypoints of poses (T, P), drawn from Student's distribution in the plane with ν degrees of freedom,
    the normal one where they are infinite; there, errors may be an autoregression with a correlation."""
    pixels = CAMERA.project(joints(BODY.skeleton, poses))
    noise = rng.standard_normal(pixels.shape)
    for t in range(1, len(noise)):
        noise[t] = correlation * noise[t - 1] + np.sqrt(1.0 - correlation**2) * noise[t]
    if np.isfinite(nu):
        noise *= np.sqrt(nu / rng.chisquare(nu, (*pixels.shape[:2], 1)))
    seen = np.concatenate([pixels + SIGMA_PX * noise, np.ones((*pixels.shape[:2], 1))], axis=2)
    image = np.zeros((4, 4), np.uint8)
    return [Frame(t, t / rate_hz, (View(CAMERA, image, rows),)) for t, rows in enumerate(seen)]


def walk_of_a_fit(n_frames, frames_per_style, rng):
    """States (T, 9), {α, μ, root}, at PACE_HZ from the prior that `fit_problem` and an upright person stand for."""
    smoothness, styles = Smoothness(), [rng.standard_normal(2)]
    for _ in range(-(-n_frames // frames_per_style) - 1):
        kept = np.sqrt(1.0 - smoothness.style**2) ** frames_per_style
        styles.append(kept * styles[-1] + np.sqrt(1.0 - kept**2) * rng.standard_normal(2))
    alpha = np.repeat(styles, frames_per_style, axis=0)[:n_frames]
    time = np.arange(n_frames)[:, None]
    level, slope = np.array([0.3, 0.4, 0.0, 0.95, 0.3, 0.0, 0.0]), np.array([0.08, 0.08, 0.03, 0.0, 0.02, 0.0, 0.0])
    bends = np.diff(np.eye(n_frames), 2, axis=0)
    walked = level + slope * (time - time.mean() * (np.arange(7) > 0))
    for k, deviation in enumerate(smoothness.second_differences):
        if k < 5:
            walked[2:, k] += np.cumsum(np.cumsum(deviation * rng.standard_normal(n_frames - 2)))
        else:  # pitch and roll
            precision = bends.T @ bends / deviation**2 + np.eye(n_frames) / UPRIGHT_SIGMA_RAD**2
            walked[:, k] = np.linalg.solve(np.linalg.cholesky(precision).T, rng.standard_normal(n_frames))
    return np.hstack([alpha, walked])
