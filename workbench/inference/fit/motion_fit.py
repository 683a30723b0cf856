"""The problem of a motion model: its style and phase and the root in every frame (paper D, sections 4.2, 4.3)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import ClassVar

import numpy as np
from scipy.interpolate import make_interp_spline

from workbench.arrays import FloatArray
from workbench.body.skeleton import N_ROOT, Skeleton
from workbench.core.motion_model import MotionModel
from workbench.core.residual import Loss, ResidualFunction
from workbench.core.smoothness import Smoothness
from workbench.core.state_space import StateSpace
from workbench.core.traits import MOTION, Traits, offering
from workbench.errors import InputError
from workbench.inference.fit.decoding import MotionDecoder
from workbench.inference.fit.first_guess import START_GAP_S, coarse_residuals, first_roots
from workbench.inference.fit.frame import follow, global_motion
from workbench.inference.fit.motion import FitProblem, fit_motion, fit_problem
from workbench.inference.fit.phase_grid import find_phase
from workbench.inference.fit.residuals import UPRIGHT_SIGMA_RAD
from workbench.inference.fit.task import Fit, Task, fit_of


@dataclass(frozen=True)
class MotionFit:
    """Fit the prior's motion model, with a style α for every `frames_per_style` frames, or one for all where None.

    One for all frames is D's steady style (section 4.2), one for each its varying style (section 4.3). phases: of the
    first and the last frame, (μ₁, μ_T), cycles; None takes those that the task knows, or finds them.
    Raises InputError when frames_per_style is not positive.

    Deviations. D sets the first pose and the phases' ends by hand. D has no regularisation, see `fit_problem`.
    """

    traits: ClassVar[Traits] = offering(prior=MOTION)

    frames_per_style: int | None = 1
    phases: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.frames_per_style is not None and self.frames_per_style < 1:
            raise InputError(f"inference: frames_per_style must be above zero, found {self.frames_per_style}")

    def space(self, skeleton: Skeleton, motion: MotionModel | None) -> StateSpace:
        """Name {α, μ, root}; raises InputError without a motion model."""
        return MotionDecoder(skeleton, needed(motion), np.zeros(len(skeleton.dof_names))).space

    def fit(self, task: Task, start: FloatArray | None) -> Fit:
        """Fit all frames at once; `start` as for `LeastSquares.run`."""
        rest = np.zeros(len(task.skeleton.dof_names)) if start is None else start
        decoder = MotionDecoder(task.skeleton, needed(task.motion), rest)
        residuals = task.residuals(UPRIGHT_SIGMA_RAD)
        return fit_sequence(
            decoder, residuals, task.times_s, task.loss, coarse=coarse_residuals(task), smoothness=task.smoothness,
            phases=task.phase_ends if self.phases is None else self.phases,
            roots=first_roots(task, decoder) if start is None else None,
            frames_per_style=len(residuals) if self.frames_per_style is None else self.frames_per_style,
            max_iterations=task.max_iterations,
        )  # fmt: skip


def needed(motion: MotionModel | None) -> MotionModel:
    """Return the motion model; raises InputError without one."""
    if motion is None:
        raise InputError(
            "inference: the problem expected a motion model, which this prior lacks (prior=activity has one); the "
            "problems smooth and frame_by_frame do without"
        )
    return motion


def fit_sequence(
    decoder: MotionDecoder,
    residuals: Sequence[ResidualFunction],
    times_s: FloatArray,
    loss: Loss,
    *,
    smoothness: Smoothness,
    frames_per_style: int,
    phases: tuple[float, float] | None,
    roots: FloatArray | None = None,
    coarse: tuple[Sequence[ResidualFunction], Loss] | None = None,
    max_iterations: int = 40,
    tolerance: float = 1e-4,
) -> Fit:
    """Fit a motion model to T frames at times (T,), s, whatever their residuals are made of.

    roots: (n, 6) where the person may be in the first frame that shows something, by default the root of decoder.rest.
    coarse: residuals and loss to start with, where others are faster to compute or see further. phases: those of the
    first and the last frame, cycles, between which they are linear at first (paper D, section 4); None finds them, see
    `phase_grid`.
    """
    clock = perf_counter()
    roots = decoder.rest[None, :N_ROOT] if roots is None else roots
    far, wide = (residuals, loss) if coarse is None else coarse
    if phases is None:
        states = find_states(decoder, far, times_s, wide, smoothness, roots)
    else:
        part = (times_s - times_s[0]) / max(times_s[-1] - times_s[0], 1e-9)
        mu = phases[0] + (phases[1] - phases[0]) * part
        states = global_motion(decoder, far, wide, decoder.states(np.zeros(decoder.n_style), mu, roots[0]))
    started = perf_counter()
    problem = fit_problem(decoder, residuals, times_s, loss, smoothness, frames_per_style)
    fit = fit_batch(problem, states, max_iterations=max_iterations, tolerance=tolerance)
    return replace(fit, timing_s={"start": started - clock, "least_squares": perf_counter() - started})


def fit_batch(problem: FitProblem, states: FloatArray, *, max_iterations: int = 40, tolerance: float = 1e-4) -> Fit:
    """Fit all frames of a problem at once from states (T, D) near enough."""
    states, covariances, found = fit_motion(problem, states, max_iterations=max_iterations, tolerance=tolerance)
    return fit_of(problem.decoder, problem.residuals, problem.loss, states, covariances, found.iterations, found.costs)


def find_states(
    decoder: MotionDecoder,
    residuals: Sequence[ResidualFunction],
    times_s: FloatArray,
    loss: Loss,
    smoothness: Smoothness,
    roots: FloatArray,
) -> FloatArray:
    """Find states (T, D) to start from in frames that show something START_GAP_S apart, linear between and beyond."""
    shown: list[int] = []
    for t, residual in enumerate(residuals):
        apart = not shown or times_s[t] - times_s[shown[-1]] > 0.99 * START_GAP_S
        if apart and len(residual(decoder.rest)[0]):
            shown.append(t)
    if not shown:
        raise InputError(f"least squares: none of {len(times_s)} frames shows enough to start from; give the phases")
    far, times = [residuals[t] for t in shown], times_s[shown]
    known = find_phase(decoder, far, times, loss, smoothness, roots)
    states = follow(decoder, far, times, loss, known, smoothness)
    if len(states) == 1:
        return np.repeat(states, len(times_s), axis=0)
    return np.asarray(make_interp_spline(times, states, k=1)(times_s))
