"""The problem of a motion model: its style and phase and the root in every frame (paper D, sections 4.2, 4.3)."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from workbench.body.skeleton import N_ROOT, Skeleton
from workbench.core.capabilities import MOTION, Traits, offering
from workbench.core.discrepancy import widening
from workbench.core.observations import observed_kinds
from workbench.core.prior import MotionModel
from workbench.core.side_information import PHASE_ENDS
from workbench.core.state_space import StateSpace
from workbench.inference.least_squares.all_frames import absorbed, fit_motion, fit_problem, misled
from workbench.inference.least_squares.hypotheses import coarse_data, first_roots
from workbench.inference.least_squares.phase_grid import find_phase
from workbench.inference.least_squares.residuals import UPRIGHT_SIGMA_RAD
from workbench.inference.least_squares.single_frame import FitData, MotionDecoder, follow, global_motion
from workbench.inference.least_squares.systematic_errors import Shared, effective_share, error_correlation
from workbench.inference.least_squares.task import Fit, Task, fit_of
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.timing import working_s


@dataclass(frozen=True)
class MotionFit:
    """Fit the prior's motion model, with a style α for every `frames_per_style` frames, or one for all where None.

    One for all frames is D's steady style (section 4.2), one for each its varying style (section 4.3). phases: of the
    first and the last frame, (μ₁, μ_T), cycles; None takes those that the task knows, or finds them. plain: minimise F
    alone, as D does, without regularisation. discrepancy: add to the poses' covariance what the model misses of people
    it was not learned from, where that is known (`core.discrepancy.widening`), and what points share
    (`systematic_errors.Shared`). rho: correlation of keypoints' errors from frame to frame, by which fewer frames count
    (`systematic_errors.effective_share`); None estimates it at a first fit. Raises InputError when frames_per_style is
    not positive, and for rho out of range.

    Deviations. D sets the first pose and the phases' ends by hand, and has no regularisation, see `fit_problem`. The
    global motion is found by distances, whatever the fit minimises: the field says nothing beyond a fraction of a
    limb's radius. A frame's root may start where the two frames before lead, see `global_motion`."""

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare the need of a motion model, and the phases of the ends, which are given or may be known."""
        known = {"known": PHASE_ENDS} if keys.get("phases") is None else {"given": PHASE_ENDS}
        return offering(prior=MOTION, **known)

    frames_per_style: int | None = 1
    phases: tuple[float, float] | None = None
    plain: bool = False
    discrepancy: bool = True
    rho: float | None = None

    def __post_init__(self) -> None:
        if self.frames_per_style is not None and self.frames_per_style < 1:
            raise InputError(f"inference: frames_per_style must be above zero, found {self.frames_per_style}")
        if self.rho is not None and not 0.0 <= self.rho < 1.0:
            raise InputError(f"inference: rho must lie between 0 and below 1, found {self.rho}")

    def space(self, skeleton: Skeleton, motion: MotionModel | None) -> StateSpace:
        """Name {α, μ, root}; raises InputError without a motion model."""
        return MotionDecoder(skeleton, needed(motion), np.zeros(len(skeleton.dof_names))).space

    def fit(self, task: Task, start: FloatArray | None) -> Fit:
        """Fit all frames at once; `start` as for `LeastSquares.run`."""
        rest = np.zeros(len(task.skeleton.dof_names)) if start is None else start
        decoder = MotionDecoder(task.skeleton, needed(task.motion), rest)
        frames_per_style = self.frames_per_style or len(task.seen)
        known = task.discrepancy if self.discrepancy else None
        missed = None if known is None else widening(known.n_people) * known.root(task.skeleton.dof_names)
        fit = fit_sequence(
            decoder, task.data(UPRIGHT_SIGMA_RAD), frames_per_style, coarse=coarse_data(task),
            phases=task.phase_ends if self.phases is None else self.phases,
            roots=first_roots(task, decoder) if start is None else None, max_iterations=task.max_iterations,
            plain=self.plain, missed=missed, shared=self._shared(task),
        )  # fmt: skip
        rho = self._correlation(task, fit)
        if rho > 0.0:
            again = fit_from(
                decoder, task.data(UPRIGHT_SIGMA_RAD), frames_per_style, fit.states, task.max_iterations,
                share=effective_share(rho), missed=missed, plain=self.plain,
            )  # fmt: skip
            spent = {stage: s + again.timing_s.get(stage, 0.0) for stage, s in fit.timing_s.items()}
            fit = replace(again, timing_s=spent)
        return fit

    def _shared(self, task: Task) -> Shared | None:
        sigma_m = task.likelihood.observables.common_bias_std_m
        if not self.discrepancy or sigma_m == 0.0 or observed_kinds(task.seen) != ("points",):
            return None
        return Shared.of_points(task.skeleton, task.surface, task.seen, sigma_m)

    def _correlation(self, task: Task, fit: Fit) -> float:
        if self.rho is not None or observed_kinds(task.seen) != ("keypoints",):
            return self.rho or 0.0
        return error_correlation(task.skeleton, task.seen, task.times_s, fit.poses, task.sigma_px)


def needed(motion: MotionModel | None) -> MotionModel:
    """Return the motion model; raises InputError without one."""
    if motion is None:
        raise InputError(
            "inference: the problem expected a motion model, which this prior lacks (prior=activity has one); the "
            "problems smooth and frame_by_frame do without"
        )
    return motion


def fit_sequence(
    decoder: MotionDecoder, data: FitData, frames_per_style: int, *, phases: tuple[float, float] | None = None,
    roots: FloatArray | None = None, coarse: FitData | None = None, max_iterations: int = 40,
    plain: bool = False, missed: FloatArray | None = None, shared: Shared | None = None,
) -> Fit:  # fmt: skip
    """Fit a motion model to frames, whatever their residuals are made of.

    roots: (n, 6) where the person may be in the first frame that shows something, by default the root of decoder.rest.
    coarse: data to start with, where others are faster to compute or see further. phases: those of the first and the
    last frame, cycles, between which they are linear at first (paper D, section 4); None finds them, see `phase_grid`.
    plain: see `fit_problem`. missed, shared: as for `fit_from`.
    """
    clock, far, times_s = working_s(), coarse or data, data.times_s
    roots = decoder.rest[None, :N_ROOT] if roots is None else roots
    if phases is None:
        states = find_states(decoder, far, roots)
    else:
        part = (times_s - times_s[0]) / max(times_s[-1] - times_s[0], 1e-9)
        mu = phases[0] + (phases[1] - phases[0]) * part
        states = global_motion(decoder, far, decoder.states(np.zeros(decoder.n_style), mu, roots[0]))
    started = working_s()
    fit = fit_from(decoder, data, frames_per_style, states, max_iterations, missed=missed, plain=plain, shared=shared)
    return replace(fit, timing_s={"start": started - clock, **fit.timing_s})


def fit_from(
    decoder: MotionDecoder, data: FitData, frames_per_style: int, states: FloatArray, max_iterations: int,
    *, share: float = 1.0, missed: FloatArray | None = None, plain: bool = False, shared: Shared | None = None,
) -> Fit:  # fmt: skip
    """Fit all frames at once from states (T, D) near enough. share: what part of the residuals counts. plain: see
    `fit_problem`.

    missed: (P, k), times k standard normal numbers what the motion model misses of a person in every frame. Poses are
    then unsure by that, less what the fit makes of it (`all_frames.absorbed`): a root and a style that are off for
    angles that the model does not have. shared: what observations are off by together, and poses with them
    (`all_frames.misled`)."""
    started = working_s()
    problem = fit_problem(decoder, data.weighing(share), frames_per_style, plain)
    states, covariances, search = fit_motion(problem, states, max_iterations=max_iterations)
    fit = fit_of(decoder, data, states, covariances, search.iterations, search.costs)
    causes = []
    if missed is not None:
        causes.append(missed - fit.pose_jacobian @ absorbed(problem, search, missed))
    if shared is not None:
        causes.append(fit.pose_jacobian @ misled(problem, search, shared))
    if causes:
        fit = fit.missing(np.concatenate(causes, axis=2))
    return replace(fit, timing_s={"least_squares": working_s() - started})


def find_states(decoder: MotionDecoder, data: FitData, roots: FloatArray) -> FloatArray:
    """Find states (T, D) to start from in frames that show something 1 / PACE_HZ apart, linear between and beyond."""
    far, times_s = data.spaced(len(residual(decoder.rest)[0]) > 0 for residual in data.residuals), data.times_s
    if not far.residuals:
        raise InputError(f"least squares: none of {len(times_s)} frames shows enough to start from; give the phases")
    states = follow(decoder, far, find_phase(decoder, far, roots))
    if len(states) == 1:
        return np.repeat(states, len(times_s), axis=0)
    return np.asarray(scipy.interpolate.make_interp_spline(far.times_s, states, k=1)(times_s))
