"""Deterministic tracking: a pose and its covariance for every frame by least squares (paper D, section 4)."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from workbench.body.kinematics import forward
from workbench.body.limbs import Body
from workbench.body.surface import attach, person_surface, residual_jacobian, residuals
from workbench.core.capabilities import FIT, RESIDUALS, UNIFORM_WEIGHTS, Traits, combined_requirements, component_traits
from workbench.core.checks import POSITIVE, check
from workbench.core.frame import Frame, repeatable
from workbench.core.frame_cache import without_images
from workbench.core.observations import Observed, observe, observed_kinds
from workbench.core.prior import Prior, PriorCapabilities, Smoothness
from workbench.core.residual import ResidualLikelihood
from workbench.core.side_information import PHASE_ENDS
from workbench.core.state_space import StateSpace
from workbench.core.step import Step
from workbench.inference.least_squares.motion.motion_fit import MotionFit
from workbench.inference.least_squares.motion.smooth_fit import SmoothFit
from workbench.inference.least_squares.motion.task import Fit, Problem, Task
from workbench.inference.least_squares.solver.motion_posterior import N_DRAWS
from workbench.inference.least_squares.video.systematic_errors import default_length_uncertainty
from workbench.motion.models.activities import classify
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.parallel import ahead
from workbench.utils.timing import working_s

MIN_INLIER_FRACTION = 0.3
"""Below this fraction of a frame's points and keypoints near the body, the step has a warning."""
_LAST_STEPS = 10
"""Steps over which the decrease of the cost of a fit that did not converge is reported."""
_BLOCK = 256
"""Covariances decomposed together, which bounds the memory."""


class LeastSquares:
    """Fit a person to all frames; an inference that yields its steps after solving.

    likelihood: provides the residuals and their loss: points on the surface, 2-D keypoints, or their product. prior:
    its motion model, smoothness and pose prior are the regularisation; None: `Smoothness()` alone. phase_ends: of a
    cyclic motion, cycles, in the first and the last frame, if the dataset provides them. problem: `MotionFit`,
    `SmoothFit` or `FrameByFrame`; None: the first if the prior has a motion model, else the second. max_points: points
    per frame; more are thinned at random. max_iterations: of the search over all frames. n_particles: per step. Raises
    InputError for numbers out of range, and a problem without its motion model.

    Deviation. D minimises the plain sum of squares of f − C, kind "field" and loss "squared" of the surface points; by
    default residuals are distances in metres under a redescending loss, and the initial search always uses distances.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare uniform weights about one fit, and the requirements of residuals and of the problem; the default
        problem optionally uses the phases of the ends."""
        fit, problem = (
            component_traits(likelihood=RESIDUALS),
            keys["problem"] or component_traits(optional_assumptions=PHASE_ENDS),
        )
        return Traits(frozenset({UNIFORM_WEIGHTS, FIT}), combined_requirements({"fit": fit, "problem": problem}))

    def __init__(
        self, body: Body, likelihood: ResidualLikelihood, prior: Prior | None = None,
        phase_ends: tuple[float, float] | None = None, *, problem: Problem | None = None,
        max_points: int = 1000, max_iterations: int = 40, n_particles: int = 500,
    ) -> None:  # fmt: skip
        capabilities = PriorCapabilities() if prior is None else prior.capabilities
        self.likelihood, self.observables = likelihood, likelihood.observables
        self.skeleton, self.surface = body.skeleton, person_surface(body, self.observables.sharpness)
        self.length_uncertainty = (
            default_length_uncertainty(body.skeleton) if body.limb_length_std is None else body.limb_length_std
        )
        self.motion, self.smoothness = capabilities.motion, capabilities.smoothness or Smoothness()
        self.discrepancy, self.pose_prior = capabilities.discrepancy, capabilities.pose_prior
        self.problem: Problem = problem or (SmoothFit() if capabilities.motion is None else MotionFit())
        self.space: StateSpace = self.problem.space(self.skeleton, self.motion)
        self.phase_ends, self.finds_start = phase_ends, True
        self.max_points, self.max_iterations, self.n_particles = max_points, max_iterations, n_particles
        check("inference", self, max_points=POSITIVE, max_iterations=POSITIVE, n_particles=POSITIVE)

    def run(
        self, frames: Iterable[Frame], start: FloatArray | None, rng_streams: Mapping[str, np.random.Generator]
    ) -> Iterator[Step]:
        """Yield one step per frame once all are fitted, from about the pose `start` (P,), or None to search for the
        person. Images are not kept: the frames are iterated over again for the steps.

        rng_streams: generators named "start", which thins points, "prior", which draws the particles, and "draws",
        which draws the motions of a fit of smooth poses; none are drawn without it. A frame without observations is
        interpolated by the smoothness, or keeps the previous pose frame by frame, with a warning. Raises InputError
        without observations.
        """
        frames = repeatable(frames)
        fit, observations, warnings = self.fit_frames(list(without_images(frames)), start, rng_streams["start"])
        draws = None
        if fit.posterior is not None and "draws" in rng_streams:
            draws = fit.posterior.draws(N_DRAWS, rng_streams["draws"])
        fit = replace(fit, posterior=None)  # large
        samples = steps(fit, frames, self.n_particles, rng_streams["prior"], draws)
        for step, observed, messages in zip(samples, observations, warnings, strict=True):
            inliers, kinds = step.diagnostics.get("inlier_fraction", 0.0), " and ".join(observed_kinds([observed]))
            if kinds and inliers < MIN_INLIER_FRACTION:
                message = f"frame {step.frame.index}: only {inliers:.0%} of the {kinds} lie near the body"
                messages = (*messages, message)
            activity, probabilities = self._activity(step)
            yield replace(
                step, warnings=messages, activity=activity, attachment=self._attachment(step),
                timing_s={**step.timing_s, **self._one_evaluation(step.expected_pose, observed.points)},
                diagnostics={**step.diagnostics, **probabilities, **self._decrease(fit)},
            )  # fmt: skip

    def fit_frames(
        self, frames: Sequence[Frame], start: FloatArray | None, rng: np.random.Generator
    ) -> tuple[Fit, list[Observed], list[tuple[str, ...]]]:
        """Return the fit of all frames, the observations used and the warnings of each. rng: thins points. Raises
        InputError without observations."""
        if not frames:
            raise InputError("least squares: expected at least one frame, found none")
        observations, warnings = observe(frames, self.skeleton, self.max_points, rng, self.observables)
        if not observed_kinds(observations):
            expected = " or ".join(self.observables.kinds) or "points or keypoints"
            raise InputError(f"least squares: expected {expected} to fit, found none in {len(frames)} frames")
        task = Task(
            self.skeleton, self.surface, self.likelihood, observations, np.array([frame.time_s for frame in frames]),
            self.motion, self.smoothness, self.phase_ends, self.max_iterations, self.discrepancy, self.pose_prior,
            self.length_uncertainty,
        )  # fmt: skip
        return self.problem.fit(task, start), observations, warnings

    def _decrease(self, fit: Fit) -> dict[str, float]:
        """Return the relative decrease of the cost in the last steps of a fit that used all its iterations; empty for
        one that converged."""
        if fit.iterations < self.max_iterations:
            return {}
        return {"cost_decrease": fit.costs[max(-_LAST_STEPS - 1, -len(fit.costs))] / fit.costs[-1] - 1.0}

    def _one_evaluation(self, pose: FloatArray, points: FloatArray) -> dict[str, float]:
        """Return the time, s, of one evaluation of F, and of F with its Jacobian, at fixed attachments: paper D's
        measure of its cost."""
        if not len(points):
            return {}
        frames, kind = forward(self.skeleton, pose[None]), self.observables.residual
        arguments = (self.skeleton, self.surface, pose, points, kind, attach(self.surface, frames, points, kind))
        residual_jacobian(*arguments)  # the first call compiles; the fit itself searches and differentiates at once
        started = working_s()
        residuals(*arguments)
        between = working_s()
        residual_jacobian(*arguments)
        return {"residual": between - started, "residual_jacobian": working_s() - between}

    def _activity(self, step: Step) -> tuple[str | None, dict[str, float]]:
        """Return the activity of the step's coefficients among the model's, and the probability of each (paper D,
        section 5); nothing if the model has a single activity."""
        coefficients = step.space.slices.get("coefficients")
        if coefficients is None or self.motion is None or len(set(self.motion.activities)) < 2:
            return None, {}
        classes = classify(self.motion, step.particles[:, coefficients].mean(axis=0))
        pairs = zip(classes.activities, classes.probabilities, strict=True)
        return str(classes.labels), {f"probability_{name}": float(probability) for name, probability in pairs}

    def _attachment(self, step: Step) -> IntArray | None:
        """Return the body part (K,) of each of the frame's points at the fit, -1 if none is within three standard
        deviations."""
        points, sigma, kind = step.frame.points, self.observables.sigma, self.observables.residual
        if points is None or sigma is None:
            return None
        body_parts, usable = np.full(len(points), -1), np.isfinite(points).all(axis=1)
        frames = forward(self.skeleton, step.expected_pose[None])
        nearest = attach(self.surface, frames, points[usable], kind)
        distances = residuals(self.skeleton, self.surface, step.expected_pose, points[usable], kind, nearest)
        body_parts[usable] = np.where(np.abs(distances) < 3.0 * sigma, nearest, -1)
        return body_parts


def steps(
    fit: Fit, frames: Iterable[Frame], n_particles: int, rng: np.random.Generator, draws: FloatArray | None = None
) -> Iterator[Step]:
    """Yield one step per frame: particles sampled from the Gaussian posterior of its state, with uniform weights.

    Poses are samples of the same numbers mapped by the Jacobian at the fit, plus samples of the model discrepancy, so
    that their distribution is the Gaussian of `Fit.covariance`. The expected pose is the fit. Frames are sampled
    independently, so that ancestors have no meaning. Phases are reported modulo one cycle. draws: (S, T, P), motions.
    """
    log_weights, ancestors = np.full(n_particles, -np.log(n_particles)), np.arange(n_particles)
    phase = fit.space.slices.get("phase", slice(0))
    # a frame is decoded while the caller records the one before it
    for t, (frame, root) in enumerate(zip(ahead(frames), _roots(fit.state_covariance), strict=True)):
        deviations = rng.standard_normal((n_particles, len(fit.space))) @ root.T
        pose = fit.poses[t]
        poses = pose + deviations @ fit.pose_jacobian[t].T
        if fit.discrepancy_root is not None:
            poses += rng.standard_normal((n_particles, fit.discrepancy_root.shape[2])) @ fit.discrepancy_root[t].T
        state = fit.states[t].copy()
        state[phase] %= 1.0
        inliers = {"inlier_fraction": float(fit.inliers[t])} if np.isfinite(fit.inliers[t]) else {}
        diagnostics = {**inliers, "iterations": fit.iterations}
        yield Step(
            frame=frame, space=fit.space, particles=state + deviations,
            poses=poses, log_weights=log_weights, ancestors=ancestors,
            expected_pose=pose, map_pose=pose, ess=float(n_particles), log_evidence=np.nan,
            diagnostics=diagnostics, evaluations=fit.iterations,
            timing_s={stage: s / len(fit.poses) for stage, s in fit.timing_s.items()},
            draws=None if draws is None else draws[:, t],
        )  # fmt: skip


def _roots(covariances: FloatArray) -> Iterator[FloatArray]:
    """Yield a root A (D, D), A Aᵀ = covariance, of each of covariances (T, D, D), decomposed in blocks."""
    for first in range(0, len(covariances), _BLOCK):
        values, vectors = np.linalg.eigh(covariances[first : first + _BLOCK])  # not Cholesky: may be singular
        yield from vectors * np.sqrt(values.clip(min=0.0))[:, None, :]
