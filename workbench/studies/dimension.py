"""Number of particles that a filter needs against the number of joint angles: paper C's N ∝ 1/α^d (section 6)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from tqdm import tqdm

from workbench.body.kinematics import joints
from workbench.body.shape import from_height
from workbench.body.skeleton import PARTS, POSE_NAMES, person_skeleton
from workbench.cameras.camera import plain_camera
from workbench.core.gaussian import condition, predict
from workbench.core.study import Curves, StudyResult
from workbench.evaluation.uncertainty.intervals import bootstrap_interval
from workbench.priors.smooth import Smooth
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

ANGLES = (*PARTS["right_arm"], *PARTS["left_arm"], *sorted(PARTS["lower_body"], reverse=True))
"""The angles in the order in which they are added, limb by limb."""
INDEPENDENT, BODY = "independent, one survives", "body, one survives"
EXACT, ONE_FRAME, NEEDED = "independent, exact", "near exact after a frame", "near exact after all frames"
MIN_ESS = 300.0
"""Minimum effective sample size for a survival rate. With fewer particles the largest weights, which dominate it, are
rarely sampled, and the estimate is biased upwards: 0.027 instead of 0.016 for 2^13 particles and 8 angles."""
PAPER_PARTICLES = {8: 3.0e3, 50: 1.0e16}
"""Number of particles stated by C for an arm and a person, by number of parameters: angles and their velocities."""
RATE_HZ = 30.0
TRANSITION = np.array([[1.0, 1.0], [0.0, 1.0]])
"""Transition of an angle and its velocity, per frame."""


@dataclass(frozen=True)
class IndependentAngles:
    """A tracking problem of d independent angles of constant velocity, each observed, in which the law is exact.

    States are (n, 2 d): angles and velocities; the ground truth and the particles have the same distribution. Units are
    the observation's standard deviation and a frame. jerk: standard deviation of a velocity's change per frame.
    """

    d: int
    jerk: float = 0.3

    @cached_property
    def noise(self) -> FloatArray:
        """Return the covariance (2, 2) of the process noise of an angle and its velocity."""
        return self.jerk**2 * np.array([[0.25, 0.5], [0.5, 1.0]])

    @cached_property
    def predicted(self) -> FloatArray:
        """Return the steady-state covariance (2, 2) of an angle and its velocity before the observation."""
        return scipy.linalg.solve_discrete_are(TRANSITION.T, np.array([[1.0], [0.0]]), self.noise, np.eye(1))

    @cached_property
    def filtered(self) -> FloatArray:
        """Return the steady-state covariance (2, 2) after the observation, by the Kalman filter."""
        return self._condition(np.zeros((2, 1)), self.predicted, np.zeros(1))[1]

    @staticmethod
    def _condition(means: FloatArray, covariance: FloatArray, observed: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Condition d angles and velocities (2, d), of the same covariance (2, 2), on the angles observed (d,)."""
        residual = observed[None] - means[:1]
        return condition(means, covariance, covariance[:, :1], covariance[:1, :1] + 1.0, residual)

    @property
    def log_alpha(self) -> float:
        """Return the mean of log (E[w]² / E[w²]) for one angle, with w the likelihood of a predicted sample."""
        s2 = self.predicted[0, 0]
        first_moment = -np.log(s2 + 1.0) - 1.0
        second_moment = -0.5 * np.log(2.0 * s2 + 1.0) - (s2 + 1.0) / (2.0 * s2 + 1.0)
        return float(first_moment - second_moment)

    def exact(self, observed: FloatArray) -> FloatArray:
        """Return the expected angles (F, d) of observations (F, d), by the Kalman filter started at zero."""
        means, covariance = np.zeros((2, self.d)), self.filtered
        expected = np.empty_like(observed)
        for t, observation in enumerate(observed):
            means, covariance = self._condition(*predict(means, covariance, TRANSITION, self.noise), observation)
            expected[t] = means[0]
        return expected

    def sample_initial(self, n: int, rng: np.random.Generator) -> FloatArray:
        """Sample states (n, 2 d) from the steady-state posterior about zero."""
        pairs = rng.multivariate_normal(np.zeros(2), self.filtered, size=(n, self.d))
        return np.concatenate([pairs[..., 0], pairs[..., 1]], axis=1)

    def sample_transition(self, state: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Sample states one frame later: constant acceleration with the standard deviation of the jerk."""
        angles, velocities = state[:, : self.d], state[:, self.d :]
        changes = self.jerk * rng.standard_normal(angles.shape)
        return np.concatenate([angles + velocities + 0.5 * changes, velocities + changes], axis=1)

    def angles(self, state: FloatArray) -> FloatArray:
        """Return the angles (n, d)."""
        return state[:, : self.d]

    observed = angles
    """Return the noise-free observations (n, d) of states, in units of their noise."""


class BodyAngles:
    """The first d of ANGLES of a standing person under the smooth prior (A, section 6.1), observed as joints in pixels.

    sigma_px: noise of every joint, for a person of 175 px viewed from the right front.
    """

    def __init__(self, d: int, sigma_px: float) -> None:
        self.prior, self.sigma_px = Smooth(parameters=ANGLES[:d]), sigma_px
        self.skeleton = person_skeleton(from_height(1.75))
        self.camera = plain_camera(640, 480, 400.0, (2.8, -2.8, 1.0), (0.0, 0.0, 0.9))
        self.pose = np.zeros(len(POSE_NAMES))
        values = {"root_z": 0.9} | {name: 0.4 for name in ANGLES if "elbow" in name or "knee" in name}
        for name, value in values.items():
            self.pose[POSE_NAMES.index(name)] = value
        self._columns = [POSE_NAMES.index(name) for name in ANGLES[:d]]

    def sample_initial(self, n: int, rng: np.random.Generator) -> FloatArray:
        """Sample states (n, D) about the standing pose."""
        return self.prior.sample_initial(self.pose, n, rng)

    def sample_transition(self, state: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Sample states one frame later from the smooth prior."""
        return self.prior.sample_transition(state, 1.0 / RATE_HZ, rng)

    def angles(self, state: FloatArray) -> FloatArray:
        """Return the angles (n, d), rad."""
        return self.prior.pose(state)[:, self._columns]

    def observed(self, state: FloatArray) -> FloatArray:
        """Return the joints' pixels, in units of their noise, (n, 2 J)."""
        pixels = self.camera.project(joints(self.skeleton, self.prior.pose(state)))
        return pixels.reshape(len(state), -1) / self.sigma_px


DimensionProblem = IndependentAngles | BodyAngles


@dataclass(frozen=True, eq=False)
class _DimensionRun:
    """A run of F frames. survival: (F,), effective sample size over number of particles. expected: (F, d), angles.
    observed: (F, k), in units of its noise."""

    survival: FloatArray
    expected: FloatArray
    observed: FloatArray


@dataclass(frozen=True)
class ParticlesByDimension:
    """Survival rates and required numbers of particles against the number of joint angles d (C, section 6).

    The survival rate is the effective sample size over the number of particles (MacCormick & Isard 2000, whom C cites
    for N ∝ 1/α^d): a filter that retains D of its particles needs N = D / α^d. It is measured with max_particles
    particles for `IndependentAngles`, where the law is exact and α known, and for `BodyAngles`. For the first, the
    study also reports the smallest number of particles, a power of two up to max_particles, whose estimate is within
    tolerance_std posterior standard deviations of the Kalman filter (root mean square over angles) after one frame, and
    after n_frames, each of which starts from the last one's error.

    dims, dims_body: numbers of angles. n_frames, n_seeds: of every run, each seed with another ground truth.

    Metrics: alpha_independent, alpha_body, alpha_one_frame and alpha_error (of the particles needed to approach the
    Kalman filter after one frame and after all), with _low and _high, the 95 % bootstrap interval over seeds;
    alpha_exact, known. All are per angle, which C counts as two parameters, as is alpha_paper, from C's numbers.
    alpha_body_arms, alpha_body_legs: from 1 to 8 angles and from 8 on.
    """

    dims: Sequence[int] = (1, 2, 3, 4, 5, 6)
    dims_body: Sequence[int] = (1, 2, 4, 6, 8, 12, 16)
    max_particles: int = 1 << 14
    n_frames: int = 10
    n_seeds: int = 10
    tolerance_std: float = 0.5
    sigma_px: float = 8.0

    def __post_init__(self) -> None:
        sizes = self.max_particles, self.n_frames, self.n_seeds, *self.dims, *self.dims_body
        if min(sizes) < 1 or not self.tolerance_std > 0.0:
            raise InputError("study: expected sizes from 1 on and tolerance_std above 0")
        if max(self.dims_body) > len(ANGLES) or min(len(set(self.dims)), len(set(self.dims_body))) < 2:
            raise InputError(f"study: expected two numbers of angles or more, dims_body up to {len(ANGLES)}")

    def run(self, rng: np.random.Generator) -> StudyResult:
        """Run filters for every number of angles and every seed, and fit α."""
        x = np.union1d(self.dims, self.dims_body).astype(np.float64)
        log_n = {
            INDEPENDENT: self._survival(IndependentAngles, self.dims, x, rng),
            BODY: self._survival(lambda d: BodyAngles(d, self.sigma_px), self.dims_body, x, rng),
            ONE_FRAME: self._needed(1, x, rng),
            NEEDED: self._needed(self.n_frames, x, rng),
        }
        exact = IndependentAngles(1).log_alpha
        metrics = {"alpha_exact": float(np.exp(exact)), "alpha_paper": paper_alpha(), **self._alphas(x, log_n, rng)}
        curves = {name: each.mean(axis=0) for name, each in log_n.items()}  # NaN unless every seed has a value
        curves[EXACT] = -exact * x / np.log(10.0)
        faint = {f"{name}, seed {k}": row for name, each in log_n.items() for k, row in enumerate(each)}
        needed = Curves("particles/needed", x, curves, "joint angles d", "log₁₀ N", {}, faint)
        return StudyResult(metrics, (needed,), _note(metrics, self))

    def _survival(
        self, problem: Callable[[int], DimensionProblem], dims: Sequence[int], x: FloatArray, rng: np.random.Generator
    ) -> FloatArray:
        """Return log₁₀ of the number of particles per survivor (n_seeds, len(x)), mean over frames; NaN elsewhere."""
        log_n = np.full((self.n_seeds, len(x)), np.nan)
        for d in tqdm(dims, desc="survival", unit="d", disable=None):
            for seed in range(self.n_seeds):
                rate = np.exp(np.log(run_filter(problem(d), self.max_particles, self.n_frames, rng).survival).mean())
                if rate * self.max_particles >= MIN_ESS:
                    log_n[seed, np.searchsorted(x, d)] = -np.log10(rate)
        return log_n

    def _needed(self, n_frames: int, x: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Return log₁₀ of the fewest particles (n_seeds, len(x)) within tolerance in the last frame; NaN if none."""
        log_n = np.full((self.n_seeds, len(x)), np.nan)
        for d in tqdm(self.dims, desc="particles", unit="d", disable=None):
            problem = IndependentAngles(d)
            for seed in range(self.n_seeds):
                for power in range(1, int(np.log2(self.max_particles)) + 1):
                    run = run_filter(problem, 1 << power, n_frames, rng)
                    error = (run.expected - problem.exact(run.observed))[-1] ** 2 / problem.filtered[0, 0]
                    if error.mean() <= self.tolerance_std**2:
                        log_n[seed, np.searchsorted(x, d)] = power * np.log10(2.0)
                        break
        return log_n

    def _alphas(self, x: FloatArray, log_n: Mapping[str, FloatArray], rng: np.random.Generator) -> dict[str, float]:
        """Return means and intervals of α fitted to every seed, where every seed has a value."""
        complete = {name: np.where(np.isfinite(rows.mean(axis=0)), rows, np.nan) for name, rows in log_n.items()}
        body, metrics = complete[BODY], dict[str, float]()
        parts = {
            "independent": complete[INDEPENDENT], "one_frame": complete[ONE_FRAME], "error": complete[NEEDED],
            "body": body, "body_arms": np.where(x <= 8, body, np.nan), "body_legs": np.where(x >= 8, body, np.nan),
        }  # fmt: skip
        for name, rows in parts.items():
            alphas = np.array([fitted_alpha(x, row) for row in rows])
            alphas = alphas[np.isfinite(alphas)]
            low, high = bootstrap_interval(alphas, rng)
            mean = alphas.mean() if len(alphas) else np.nan
            interval = {f"alpha_{name}_low": float(low), f"alpha_{name}_high": float(high)}
            metrics |= {f"alpha_{name}": float(mean), **interval}
        return metrics


def run_filter(problem: DimensionProblem, n: int, n_frames: int, rng: np.random.Generator) -> _DimensionRun:
    """Track a sampled ground truth with n particles: bootstrap filter, systematic resampling in every frame."""
    truth, state = problem.sample_initial(1, rng), problem.sample_initial(n, rng)
    survival, expected, observed = [], [], []
    for _ in range(n_frames):
        truth, state = problem.sample_transition(truth, rng), problem.sample_transition(state, rng)
        clean = problem.observed(truth)
        observed.append(clean[0] + rng.standard_normal(clean.shape[1]))
        log_weights = -0.5 * ((problem.observed(state) - observed[-1]) ** 2).sum(axis=1)
        weights = np.exp(log_weights - log_weights.max())
        weights /= weights.sum()
        survival.append(1.0 / ((weights**2).sum() * n))
        expected.append(weights @ problem.angles(state))
        ancestors = np.searchsorted(weights.cumsum(), (np.arange(n) + rng.random()) / n)
        state = state[ancestors.clip(max=n - 1)]
    return _DimensionRun(np.array(survival), np.array(expected), np.array(observed))


def fitted_alpha(x: FloatArray, log10_n: FloatArray) -> float:
    """Return α of log N = c − d log α, fitted by least squares to finite values; NaN for fewer than two."""
    finite = np.isfinite(log10_n)
    return float(10.0 ** -np.polyfit(x[finite], log10_n[finite], 1)[0]) if finite.sum() > 1 else np.nan


def paper_alpha() -> float:
    """Return the α per angle implied by C's two numbers of particles, two parameters each."""
    (few, n_few), (many, n_many) = PAPER_PARTICLES.items()
    return float((n_few / n_many) ** (2.0 / (many - few)))


def _note(metrics: Mapping[str, float], study: ParticlesByDimension) -> str:
    return (
        "**Paper C, section 6.** A particle filter needs N ∝ 1/α^d particles for d dimensions. The curves: particles "
        f"per particle that survives the resampling of a frame, measured with {study.max_particles}; and the fewest "
        f"particles whose estimate is within {study.tolerance_std:g} standard deviations of the Kalman filter's, after "
        f"one frame and after {study.n_frames}; grey: each of {study.n_seeds} seeds. For independent angles α is "
        f"{metrics['alpha_independent']:.2f} as measured, {metrics['alpha_exact']:.2f} exactly, and "
        f"{metrics['alpha_one_frame']:.2f} and {metrics['alpha_error']:.2f} by the comparison with the Kalman filter; "
        f"for the angles of a body it is {metrics['alpha_body']:.2f}. The paper's 3000 particles for 8 parameters and "
        f"10¹⁶ for 50 imply {metrics['alpha_paper']:.2f}."
    )
