"""Deterministic tracking: a pose and its uncertainty for every frame by least squares (paper D, section 4)."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from workbench.body.kinematics import forward
from workbench.body.limbs import Body
from workbench.body.surface import attach, person_surface, residual_jacobian, residuals
from workbench.core.capabilities import FIT, RESIDUALS, UNIFORM_WEIGHTS, Traits, needs_of_all, offering
from workbench.core.checks import POSITIVE, check
from workbench.core.frame import Frame
from workbench.core.keys import records_arguments
from workbench.core.likelihood import Likelihood
from workbench.core.observations import Observed, kinds_seen, observe
from workbench.core.prior import Prior, PriorCapabilities, Smoothness
from workbench.core.residual import ResidualLikelihood
from workbench.core.side_information import PHASE_ENDS
from workbench.core.state_space import StateSpace
from workbench.core.step import Step
from workbench.inference.least_squares.motion_fit import MotionFit
from workbench.inference.least_squares.smooth_fit import SmoothFit
from workbench.inference.least_squares.systematic_errors import told_doubt
from workbench.inference.least_squares.task import Fit, Problem, Task
from workbench.motion.models.activities import classify
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.timing import working_s

FEW_INLIERS = 0.3
"""Where fewer of a frame's points and keypoints are near the body, the step says so."""


@records_arguments
class LeastSquares:
    """Fit a person to all frames: an inference that yields its steps after solving.

    likelihood: whose residuals are minimised, under its loss: points on the surface, 2-D keypoints, or their product.
    prior: its motion model, its smoothness and its density of postures regularise; None: `Smoothness()` alone.
    phase_ends: of a cyclic motion, cycles, in the first and the last frame, where the dataset knows them. problem:
    `MotionFit`, `SmoothFit` or `FrameByFrame`; None: the first where the prior has a motion model, else the second.
    most_points: a frame's points beyond are thinned at random. max_iterations: of the search over all frames.
    n_particles: per step. Raises InputError for numbers out of range, a likelihood without residuals, and a problem
    without its motion model.

    Deviation. D minimises the plain sum of squares of f − C, kind "field" and loss "squared" of the surface points; by
    default residuals are distances in metres under a redescending loss, and the start's always are.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare even weights about one fit, the need of residuals, and what the problem needs: by itself it may take
        the phases of the ends."""
        fit, problem = offering(likelihood=RESIDUALS), keys["problem"] or offering(known=PHASE_ENDS)
        return Traits(frozenset({UNIFORM_WEIGHTS, FIT}), needs_of_all({"fit": fit, "problem": problem}))

    def __init__(
        self, body: Body, likelihood: Likelihood | ResidualLikelihood, prior: Prior | None = None,
        phase_ends: tuple[float, float] | None = None, *, problem: Problem | None = None,
        most_points: int = 1000, max_iterations: int = 40, n_particles: int = 500,
    ) -> None:  # fmt: skip
        if not isinstance(likelihood, ResidualLikelihood):
            raise InputError(
                "inference: least squares expected a likelihood with residuals, such as surface_points or keypoints, "
                f"found {type(likelihood).__name__}"
            )
        capabilities = PriorCapabilities() if prior is None else prior.capabilities
        self.likelihood, self.observables = likelihood, likelihood.observables
        self.skeleton, self.surface = body.skeleton, person_surface(body)
        self.length_doubt = told_doubt(body.skeleton) if body.length_doubt is None else body.length_doubt
        self.motion, self.smoothness = capabilities.motion, capabilities.smoothness or Smoothness()
        self.discrepancy, self.postures = capabilities.discrepancy, capabilities.postures
        self.problem: Problem = problem or (SmoothFit() if capabilities.motion is None else MotionFit())
        self.space: StateSpace = self.problem.space(self.skeleton, self.motion)
        self.phase_ends, self.finds_start = phase_ends, True
        self.most_points, self.max_iterations, self.n_particles = most_points, max_iterations, n_particles
        check("inference", self, most_points=POSITIVE, max_iterations=POSITIVE, n_particles=POSITIVE)

    def run(
        self, frames: Iterable[Frame], start: FloatArray | None, rng_streams: Mapping[str, np.random.Generator]
    ) -> Iterator[Step]:
        """Yield one step per frame once all are fitted, from about the pose `start` (P,), or None to find the person.

        rng_streams: generators named "start", which thins points, and "prior", which draws the particles. A frame that
        shows nothing is bridged by its neighbours, or frame by frame keeps the pose before, and says so.
        Raises InputError when there is nothing to fit.
        """
        frames = list(frames)
        fit, observed, warnings = self.fit_frames(frames, start, rng_streams["start"])
        drawn = steps(fit, frames, self.n_particles, rng_streams["prior"])
        for step, seen, sentences in zip(drawn, observed, warnings, strict=True):
            near, kinds = step.diagnostics["inlier_fraction"], " and ".join(kinds_seen([seen]))
            if kinds and near < FEW_INLIERS:
                sentences = (*sentences, f"frame {step.frame.index}: only {near:.0%} of the {kinds} lie near the body")
            activity, probabilities = self._activity(step)
            yield replace(
                step, warnings=sentences, activity=activity, attachment=self._attachment(step),
                timing_s={**step.timing_s, **self._one_evaluation(step.expected_pose, seen.points)},
                diagnostics={**step.diagnostics, **probabilities},
            )  # fmt: skip

    def fit_frames(
        self, frames: Sequence[Frame], start: FloatArray | None, rng: np.random.Generator
    ) -> tuple[Fit, list[Observed], list[tuple[str, ...]]]:
        """Fit all frames; returns the fit with what was used of each and what there is to say about it. rng: thins
        points. Raises InputError when there is nothing to fit."""
        if not frames:
            raise InputError("least squares: expected at least one frame, found none")
        seen, warnings = observe(frames, self.skeleton, self.most_points, rng, self.observables)
        if not kinds_seen(seen):
            expected = " or ".join(self.observables.kinds) or "points or keypoints"
            raise InputError(f"least squares: expected {expected} to fit, found none in {len(frames)} frames")
        task = Task(
            self.skeleton, self.surface, self.likelihood, seen, np.array([frame.time_s for frame in frames]),
            self.motion, self.smoothness, self.phase_ends, self.max_iterations, self.discrepancy, self.postures,
            self.length_doubt,
        )  # fmt: skip
        return self.problem.fit(task, start), seen, warnings

    def _one_evaluation(self, pose: FloatArray, points: FloatArray) -> dict[str, float]:
        """Time how long F, and F with its Jacobian, take, s, with attachments fixed: paper D's measure of its cost."""
        if not len(points):
            return {}
        frames, kind = forward(self.skeleton, pose[None]), self.observables.kind
        arguments = (self.skeleton, self.surface, pose, points, kind, attach(self.surface, frames, points, kind))
        residual_jacobian(*arguments)  # the first call compiles; the fit itself searches and differentiates at once
        began = working_s()
        residuals(*arguments)
        between = working_s()
        residual_jacobian(*arguments)
        return {"residual": between - began, "residual_jacobian": working_s() - between}

    def _activity(self, step: Step) -> tuple[str | None, dict[str, float]]:
        """Tell the activity of the step's coefficients among the model's, and the probability of each. Paper D, section
        5. Nothing where the model has one activity only."""
        coefficients = step.space.slices.get("coefficients")
        if coefficients is None or self.motion is None or len(set(self.motion.activities)) < 2:
            return None, {}
        classes = classify(self.motion, step.particles[:, coefficients].mean(axis=0))
        named = zip(classes.activities, classes.probabilities, strict=True)
        return str(classes.labels), {f"probability_{name}": float(probability) for name, probability in named}

    def _attachment(self, step: Step) -> IntArray | None:
        """Find the part (K,) of each of the frame's points at the fit, -1 where none is within three deviations."""
        points, sigma, kind = step.frame.points, self.observables.sigma, self.observables.kind
        if points is None or sigma is None:
            return None
        parts, usable = np.full(len(points), -1), np.isfinite(points).all(axis=1)
        frames = forward(self.skeleton, step.expected_pose[None])
        near = attach(self.surface, frames, points[usable], kind)
        missed = residuals(self.skeleton, self.surface, step.expected_pose, points[usable], kind, near)
        parts[usable] = np.where(np.abs(missed) < 3.0 * sigma, near, -1)
        return parts


def steps(fit: Fit, frames: Sequence[Frame], n_particles: int, rng: np.random.Generator) -> Iterator[Step]:
    """Yield one step per frame: particles drawn from the Gaussian posterior of its state, with even weights.

    Poses are drawn by the same numbers through the derivative at the fit, and what the motion model misses by others,
    so that theirs is the Gaussian of `Fit.covariance`. The expected pose is the fit. Frames are drawn independently of
    each other, so that an ancestor means nothing. Phases are shown from the cycle they are in.
    """
    even, ancestors = np.full(n_particles, -np.log(n_particles)), np.arange(n_particles)
    phase = fit.space.slices.get("phase", slice(0))
    for t, frame in enumerate(frames):
        values, vectors = np.linalg.eigh(fit.state_covariance[t])  # not Cholesky: it may be singular to rounding
        draws = rng.standard_normal((n_particles, len(fit.space))) @ (vectors * np.sqrt(values.clip(min=0.0))).T
        poses = fit.poses[t] + draws @ fit.pose_jacobian[t].T
        if fit.missed is not None:
            poses += rng.standard_normal((n_particles, fit.missed.shape[2])) @ fit.missed[t].T
        state = fit.states[t].copy()
        state[phase] %= 1.0
        diagnostics = {"inlier_fraction": float(np.nan_to_num(fit.inliers[t])), "iterations": fit.iterations}
        yield Step(
            frame=frame, space=fit.space, particles=state + draws,
            poses=poses, log_weights=even, ancestors=ancestors,
            expected_pose=fit.poses[t], map_pose=fit.poses[t], ess=float(n_particles), log_evidence=np.nan,
            diagnostics=diagnostics, evaluations=fit.iterations,
            timing_s={stage: s / len(frames) for stage, s in fit.timing_s.items()},
        )  # fmt: skip
