"""How many particles a filter needs as joint angles are added: paper C's N ∝ 1/α^d (C, section 6), measured."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from tqdm import tqdm

from workbench.body.camera import plain_camera
from workbench.body.kinematics import joints
from workbench.body.shape import from_height
from workbench.body.skeleton import PARTS, POSE_NAMES, person_skeleton
from workbench.core.gaussian import condition, predict
from workbench.core.study import Curves, StudyResult
from workbench.evaluation.intervals import bootstrap_interval
from workbench.priors.smooth import Smooth
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

ANGLES = (*PARTS["right_arm"], *PARTS["left_arm"], *sorted(PARTS["lower_body"], reverse=True))
"""The angles in which joints are added, limb after limb."""
INDEPENDENT, BODY = "independent, one survives", "body, one survives"
EXACT, ONE_FRAME, NEEDED = "independent, exact", "near exact after a frame", "near exact after all frames"
LEAST_ESS = 300.0
"""A survival rate is measured where this many particles survive. With fewer the largest weights, which decide it, are
rarely drawn, and it comes out too high: of 2^13 particles and 8 angles 0.027 instead of 0.016."""
PAPERS = {8: 3.0e3, 50: 1.0e16}
"""Particles by the number of parameters, angles and their velocities, that C states for an arm and for a person."""
RATE_HZ = 30.0
TRANSITION = np.array([[1.0, 1.0], [0.0, 1.0]])
"""Of an angle and its velocity, in units of a frame."""


@dataclass(frozen=True)
class IndependentAngles:
    """A tracking problem of d angles of constant velocity, each observed by itself, in which the law is exact.

    States are (n, 2 d): angles and velocities; a truth and its particles are drawn alike.

    Units are the observation's deviation and a frame. jerk: deviation of the change of a velocity in a frame.
    """

    d: int
    jerk: float = 0.3

    @cached_property
    def noise(self) -> FloatArray:
        """Covariance (2, 2) of what a frame adds to an angle and its velocity."""
        return self.jerk**2 * np.array([[0.25, 0.5], [0.5, 1.0]])

    @cached_property
    def predicted(self) -> FloatArray:
        """Covariance (2, 2) of an angle and its velocity before it is observed, in the steady state."""
        return scipy.linalg.solve_discrete_are(TRANSITION.T, np.array([[1.0], [0.0]]), self.noise, np.eye(1))

    @cached_property
    def filtered(self) -> FloatArray:
        """The same after it is observed, by the Kalman filter."""
        return self._condition(np.zeros((2, 1)), self.predicted, np.zeros(1))[1]

    @staticmethod
    def _condition(means: FloatArray, covariance: FloatArray, observed: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Condition d angles and velocities (2, d), of the same covariance (2, 2), on the angles observed (d,)."""
        residual = observed[None] - means[:1]
        return condition(means, covariance, covariance[:, :1], covariance[:1, :1] + 1.0, residual)

    @property
    def log_alpha(self) -> float:
        """The mean of log (E[w]² / E[w²]) for one angle: w the likelihood of a draw from the prediction."""
        s2 = self.predicted[0, 0]
        once = -np.log(s2 + 1.0) - 1.0
        squared = -0.5 * np.log(2.0 * s2 + 1.0) - (s2 + 1.0) / (2.0 * s2 + 1.0)
        return float(once - squared)

    def exact(self, observed: FloatArray) -> FloatArray:
        """Compute the expected angles (F, d) given what was observed (F, d), by the Kalman filter from zero on."""
        means, covariance = np.zeros((2, self.d)), self.filtered
        expected = np.empty_like(observed)
        for t, seen in enumerate(observed):
            means, covariance = self._condition(*predict(means, covariance, TRANSITION, self.noise), seen)
            expected[t] = means[0]
        return expected

    def start(self, n: int, rng: np.random.Generator) -> FloatArray:
        """Draw states (n, 2 d) from the steady state's posterior about zero."""
        pairs = rng.multivariate_normal(np.zeros(2), self.filtered, size=(n, self.d))
        return np.concatenate([pairs[..., 0], pairs[..., 1]], axis=1)

    def step(self, state: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Draw states a frame later: a constant acceleration with the deviation of the jerk."""
        angles, velocities = state[:, : self.d], state[:, self.d :]
        changes = self.jerk * rng.standard_normal(angles.shape)
        return np.concatenate([angles + velocities + 0.5 * changes, velocities + changes], axis=1)

    def angles(self, state: FloatArray) -> FloatArray:
        """Return the angles (n, d)."""
        return state[:, : self.d]

    observed = angles
    """What is observed of states, in units of its noise, (n, d)."""


class BodyAngles:
    """The first d of ANGLES of a person who stands, under the smooth prior (A, section 6.1), seen as joints' pixels.

    sigma_px: of what is observed of every joint, for a person of 175 px, seen from the right and ahead.
    """

    def __init__(self, d: int, sigma_px: float) -> None:
        self.prior, self.sigma_px = Smooth(parameters=ANGLES[:d]), sigma_px
        self.skeleton = person_skeleton(from_height(1.75))
        self.camera = plain_camera(640, 480, 400.0, (2.8, -2.8, 1.0), (0.0, 0.0, 0.9))
        self.pose = np.zeros(len(POSE_NAMES))
        bent = {"root_z": 0.9} | {name: 0.4 for name in ANGLES if "elbow" in name or "knee" in name}
        for name, value in bent.items():
            self.pose[POSE_NAMES.index(name)] = value
        self._columns = [POSE_NAMES.index(name) for name in ANGLES[:d]]

    def start(self, n: int, rng: np.random.Generator) -> FloatArray:
        """Draw states (n, D) around the standing pose."""
        return self.prior.sample_initial(self.pose, n, rng)

    def step(self, state: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Draw states a frame later from the smooth prior."""
        return self.prior.sample_transition(state, 1.0 / RATE_HZ, rng)

    def angles(self, state: FloatArray) -> FloatArray:
        """Return the moving angles (n, d), rad."""
        return self.prior.pose(state)[:, self._columns]

    def observed(self, state: FloatArray) -> FloatArray:
        """Return the joints' pixels, in units of their noise, (n, 2 J)."""
        pixels = self.camera.project(joints(self.skeleton, self.prior.pose(state)))
        return pixels.reshape(len(state), -1) / self.sigma_px


DimensionProblem = IndependentAngles | BodyAngles


@dataclass(frozen=True, eq=False)
class _DimensionRun:
    """F frames. survival: (F,), effective sample size over particles. expected: (F, d), angles. observed: (F, k), in
    units of its noise."""

    survival: FloatArray
    expected: FloatArray
    observed: FloatArray


@dataclass(frozen=True)
class ParticlesByDimension:
    """Survival rates and particles needed against the number of joint angles d (C, section 6).

    The survival rate is the effective sample size over the number of particles (MacCormick & Isard 2000, to whom C
    refers for N ∝ 1/α^d): a filter that is to keep D of its particles needs N = D / α^d. It is measured with
    max_particles particles of `IndependentAngles`, where the law is exact and α known, and of `BodyAngles`. Of the
    first, particles are counted, too, by powers of two up to max_particles, that are within `tolerance_std` standard
    deviations of the Kalman filter (root mean square over angles) after one frame, and after n_frames, each of which
    starts from the last one's error.

    dims, dims_body: numbers of angles. n_frames, n_seeds: of every run, each seed with a truth of its own.

    Metrics: alpha_independent, alpha_body, alpha_one_frame and alpha_error (of the particles that are near the Kalman
    filter after one frame and after all), with _low and _high, the 95 % bootstrap interval over seeds; alpha_exact,
    known. All are per angle, which C counts as two parameters, as is alpha_paper, of C's numbers. alpha_body_arms,
    alpha_body_legs: from 1 to 8 angles and from 8 on.
    """

    dims: Sequence[int] = (1, 2, 3, 4, 5, 6)
    dims_body: Sequence[int] = (1, 2, 4, 6, 8, 12, 16)
    max_particles: int = 1 << 14
    n_frames: int = 10
    n_seeds: int = 10
    tolerance_std: float = 0.5
    sigma_px: float = 8.0

    def __post_init__(self) -> None:
        if (
            min(self.max_particles, self.n_frames, self.n_seeds, *self.dims, *self.dims_body) < 1
            or not self.tolerance_std > 0.0
        ):
            raise InputError("study: expected sizes from 1 on and tolerance_std above 0")
        if max(self.dims_body) > len(ANGLES) or min(len(set(self.dims)), len(set(self.dims_body))) < 2:
            raise InputError(f"study: expected two numbers of angles or more, dims_body up to {len(ANGLES)}")

    def run(self, rng: np.random.Generator) -> StudyResult:
        """Track with every number of angles and every seed, and fit α."""
        x = np.union1d(self.dims, self.dims_body).astype(np.float64)
        log_n = {
            INDEPENDENT: self._survival(IndependentAngles, self.dims, x, rng),
            BODY: self._survival(lambda d: BodyAngles(d, self.sigma_px), self.dims_body, x, rng),
            ONE_FRAME: self._needed(1, x, rng),
            NEEDED: self._needed(self.n_frames, x, rng),
        }
        exact = IndependentAngles(1).log_alpha
        metrics = {"alpha_exact": float(np.exp(exact)), "alpha_paper": paper_alpha(), **self._alphas(x, log_n, rng)}
        curves = {name: each.mean(axis=0) for name, each in log_n.items()}  # known where every seed is
        curves[EXACT] = -exact * x / np.log(10.0)
        faint = {f"{name}, seed {k}": row for name, each in log_n.items() for k, row in enumerate(each)}
        needed = Curves("particles/needed", x, curves, "joint angles d", "log₁₀ N", {}, faint)
        return StudyResult(metrics, (needed,), _note(metrics, self))

    def _survival(
        self,
        problem: Callable[[int], DimensionProblem],
        dims: Sequence[int],
        x: FloatArray,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Measure log₁₀ of the particles (n_seeds, len(x)) of which one survives, means over frames; NaN elsewhere."""
        found = np.full((self.n_seeds, len(x)), np.nan)
        for d in tqdm(dims, desc="survival", unit="d", disable=None):
            for seed in range(self.n_seeds):
                rate = np.exp(np.log(run_filter(problem(d), self.max_particles, self.n_frames, rng).survival).mean())
                if rate * self.max_particles >= LEAST_ESS:
                    found[seed, np.searchsorted(x, d)] = -np.log10(rate)
        return found

    def _needed(self, n_frames: int, x: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Find log₁₀ of the fewest particles (n_seeds, len(x)) within `tolerance_std` in the last frame; NaN for over
        max_particles."""
        found = np.full((self.n_seeds, len(x)), np.nan)
        for d in tqdm(self.dims, desc="particles", unit="d", disable=None):
            problem = IndependentAngles(d)
            for seed in range(self.n_seeds):
                for power in range(1, int(np.log2(self.max_particles)) + 1):
                    run = run_filter(problem, 1 << power, n_frames, rng)
                    away = (run.expected - problem.exact(run.observed))[-1] ** 2 / problem.filtered[0, 0]
                    if away.mean() <= self.tolerance_std**2:
                        found[seed, np.searchsorted(x, d)] = power * np.log10(2.0)
                        break
        return found

    def _alphas(self, x: FloatArray, log_n: Mapping[str, FloatArray], rng: np.random.Generator) -> dict[str, float]:
        """Fit α to every seed, where every seed is known: means and intervals."""
        known = {name: np.where(np.isfinite(rows.mean(axis=0)), rows, np.nan) for name, rows in log_n.items()}
        body, found = known[BODY], dict[str, float]()
        parts = {
            "independent": known[INDEPENDENT], "one_frame": known[ONE_FRAME], "error": known[NEEDED], "body": body,
            "body_arms": np.where(x <= 8, body, np.nan), "body_legs": np.where(x >= 8, body, np.nan),
        }  # fmt: skip
        for name, rows in parts.items():
            alphas = np.array([fitted_alpha(x, row) for row in rows])
            alphas = alphas[np.isfinite(alphas)]
            low, high = bootstrap_interval(alphas, rng)
            mean = alphas.mean() if len(alphas) else np.nan
            found |= {f"alpha_{name}": float(mean), f"alpha_{name}_low": float(low), f"alpha_{name}_high": float(high)}
        return found


def run_filter(problem: DimensionProblem, n: int, n_frames: int, rng: np.random.Generator) -> _DimensionRun:
    """Track a truth drawn from the problem by n particles, bootstrap, systematic resampling in every frame."""
    truth, state = problem.start(1, rng), problem.start(n, rng)
    survival, expected, observed = [], [], []
    for _ in range(n_frames):
        truth, state = problem.step(truth, rng), problem.step(state, rng)
        clean = problem.observed(truth)
        observed.append(clean[0] + rng.standard_normal(clean.shape[1]))
        log_weights = -0.5 * ((problem.observed(state) - observed[-1]) ** 2).sum(axis=1)
        weights = np.exp(log_weights - log_weights.max())
        weights /= weights.sum()
        survival.append(1.0 / ((weights**2).sum() * n))
        expected.append(weights @ problem.angles(state))
        places = np.searchsorted(weights.cumsum(), (np.arange(n) + rng.random()) / n)
        state = state[places.clip(max=n - 1)]
    return _DimensionRun(np.array(survival), np.array(expected), np.array(observed))


def fitted_alpha(x: FloatArray, log10_n: FloatArray) -> float:
    """Fit log N = c − d log α by least squares over the d that are known; NaN where these are fewer than two."""
    known = np.isfinite(log10_n)
    return float(10.0 ** -np.polyfit(x[known], log10_n[known], 1)[0]) if known.sum() > 1 else np.nan


def paper_alpha() -> float:
    """Compute the α per angle that C's two numbers of particles lie on, two parameters each."""
    (few, n_few), (many, n_many) = PAPERS.items()
    return float((n_few / n_many) ** (2.0 / (many - few)))


def _note(metrics: Mapping[str, float], study: ParticlesByDimension) -> str:
    return (
        f"Paper C, section 6: N ∝ 1/α^d. Particles of which one survives a frame, measured with {study.max_particles}, "
        f"and the fewest within {study.tolerance_std:g} standard deviations of the Kalman filter after one frame and "
        f"after {study.n_frames}; grey: each of {study.n_seeds} seeds. Independent angles: α = "
        f"{metrics['alpha_independent']:.2f} an angle measured, {metrics['alpha_exact']:.2f} exact, "
        f"{metrics['alpha_one_frame']:.2f} and {metrics['alpha_error']:.2f} near the Kalman filter; a body's: "
        f"{metrics['alpha_body']:.2f}. C's 3000 particles for 8 parameters and 10¹⁶ for 50 lie on "
        f"{metrics['alpha_paper']:.2f}."
    )
