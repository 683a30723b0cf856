"""Least-squares problem of a motion model: its style, phase and root in every frame (paper D, sections 4.2, 4.3)."""

from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np
import scipy

from workbench.body.skeleton import N_ROOT, Skeleton
from workbench.core.capabilities import MOTION, Traits, component_traits
from workbench.core.discrepancy import small_sample_inflation
from workbench.core.observations import observed_kinds
from workbench.core.prior import MotionModel
from workbench.core.side_information import PHASE_ENDS
from workbench.core.state_space import StateSpace
from workbench.inference.least_squares.motion.all_frames import (
    bias_sensitivity,
    discrepancy_sensitivity,
    fit_motion,
    fit_problem,
)
from workbench.inference.least_squares.motion.first_frame import coarse_data, first_roots
from workbench.inference.least_squares.motion.motion_decoder import MotionDecoder, follow, global_motion
from workbench.inference.least_squares.motion.phase_grid import N_FRAMES, find_phase
from workbench.inference.least_squares.motion.shared_errors import SharedErrors
from workbench.inference.least_squares.motion.task import Fit, Task, fit_of
from workbench.inference.least_squares.solver.residuals import UPRIGHT_SIGMA_RAD
from workbench.inference.least_squares.solver.single_frame import FitData
from workbench.inference.least_squares.video.hypotheses import MIN_KEYPOINTS
from workbench.inference.least_squares.video.systematic_errors import effective_fraction, error_correlation
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.timing import working_s

N_RESTARTS = 3
RESTART_FACTOR = 1.25
"""The mean cost of eight frames of some hundred points varies by a few percent in a right fit. The factor only avoids
time for a search without effect, since a restart is taken only where it lowers the cost of the whole fit."""


@dataclass(frozen=True)
class MotionFit:
    """Fit the prior's motion model, with a style α for every `frames_per_style` frames, or one for all if None.

    One style for all frames is D's steady style (section 4.2), one per frame its varying style (section 4.3). plain:
    minimise F alone, as D does, without regularisation. discrepancy: include the model discrepancy for new people, if
    the prior has one (`core.discrepancy.small_sample_inflation`), and the shared errors of points
    (`shared_errors.SharedErrors`) in the covariance of the poses. rho: correlation of keypoint errors between frames,
    which reduces the weight of the frames (`systematic_errors.effective_fraction`); None estimates it in a first fit.
    Raises InputError for frames_per_style below one and rho outside [0, 1).

    Deviations. D sets the first pose and the phases' ends by hand, and has no regularisation, see `fit_problem`. The
    global motion is fitted by distances for every residual kind, because the field vanishes beyond a fraction of a
    limb's radius. A frame's root may start from the linear extrapolation of the two previous ones, see `global_motion`.
    Unless `plain`, frames with a worse fit than others are searched again, see `restart`.
    """

    traits: ClassVar[Traits] = component_traits(prior=MOTION, optional_assumptions=PHASE_ENDS)

    frames_per_style: int | None = 1
    plain: bool = False
    discrepancy: bool = True
    rho: float | None = None

    def __post_init__(self) -> None:
        if self.frames_per_style is not None and self.frames_per_style < 1:
            raise InputError(f"inference: frames_per_style must be above zero, found {self.frames_per_style}")
        if self.rho is not None and not 0.0 <= self.rho < 1.0:
            raise InputError(f"inference: rho must lie between 0 and below 1, found {self.rho}")

    def space(self, skeleton: Skeleton, motion: MotionModel | None) -> StateSpace:
        """Return the names of {α, μ, root}; raises InputError without a motion model."""
        return MotionDecoder(skeleton, required_motion(motion), np.zeros(len(skeleton.dof_names))).space

    def fit(self, task: Task, start: FloatArray | None) -> Fit:
        """Return the fit of all frames at once; `start` as for `LeastSquares.run`."""
        rest = np.zeros(len(task.skeleton.dof_names)) if start is None else start
        decoder = MotionDecoder(task.skeleton, required_motion(task.motion), rest)
        frames_per_style = self.frames_per_style or len(task.observations)
        model = task.discrepancy if self.discrepancy else None
        discrepancy = (
            None
            if model is None
            else small_sample_inflation(model.n_subjects) * model.covariance_root(task.skeleton.dof_names)
        )
        fit = fit_sequence(
            decoder, task.data(UPRIGHT_SIGMA_RAD), frames_per_style, coarse=coarse_data(task),
            phases=task.phase_ends,
            roots=first_roots(task, decoder) if start is None else None, max_iterations=task.max_iterations,
            plain=self.plain, discrepancy=discrepancy, shared=self._shared(task),
        )  # fmt: skip
        rho = self._correlation(task, fit)
        if rho > 0.0:
            refit = fit_from(
                decoder, task.data(UPRIGHT_SIGMA_RAD), frames_per_style, fit.states, task.max_iterations,
                weight=effective_fraction(rho), discrepancy=discrepancy, plain=self.plain,
            )  # fmt: skip
            timing_s = {stage: s + refit.timing_s.get(stage, 0.0) for stage, s in fit.timing_s.items()}
            fit = replace(refit, timing_s=timing_s)
        return fit

    def _shared(self, task: Task) -> SharedErrors | None:
        sigma_m = task.likelihood.observables.common_bias_std_m
        if not self.discrepancy or sigma_m == 0.0 or observed_kinds(task.observations) != ("points",):
            return None
        return SharedErrors.of_points(task.skeleton, task.surface, task.observations, sigma_m)

    def _correlation(self, task: Task, fit: Fit) -> float:
        if self.rho is not None or observed_kinds(task.observations) != ("keypoints",):
            return self.rho or 0.0
        return error_correlation(task.skeleton, task.observations, task.times_s, fit.poses, task.sigma_px)


def required_motion(motion: MotionModel | None) -> MotionModel:
    """Return the motion model; raises InputError if there is none."""
    if motion is None:
        raise InputError(
            "inference: the problem needs a motion model, which this prior does not have; choose a prior with one, "
            "such as prior=activity, or the problem SmoothFit or FrameByFrame"
        )
    return motion


def fit_sequence(
    decoder: MotionDecoder, data: FitData, frames_per_style: int, *, phases: tuple[float, float] | None = None,
    roots: FloatArray | None = None, coarse: FitData | None = None, max_iterations: int = 40,
    plain: bool = False, discrepancy: FloatArray | None = None, shared: SharedErrors | None = None,
) -> Fit:  # fmt: skip
    """Return the fit of a motion model to all frames.

    Parameters
    ----------
    phases : of the first and the last frame, cycles, initially linear in between (paper D, section 4); None estimates
        them, see `phase_grid`.
    roots : (n, 6) candidates in the first frame with observations, by default the root of decoder.rest.
    coarse : data of the initial search, with faster residuals or a larger basin of attraction.
    plain : see `fit_problem`.
    discrepancy, shared : as for `fit_from`.
    """
    clock, coarse, times_s = working_s(), coarse or data, data.times_s
    roots = decoder.rest[None, :N_ROOT] if roots is None else roots
    if phases is None:
        states = find_states(decoder, coarse, roots)
    else:
        fraction = (times_s - times_s[0]) / max(times_s[-1] - times_s[0], 1e-9)
        mu = phases[0] + (phases[1] - phases[0]) * fraction
        states = global_motion(decoder, coarse, decoder.states(np.zeros(decoder.n_style), mu, roots[0]))
    started = working_s()
    complete = partial(
        fit_from, decoder, data, frames_per_style, max_iterations=max_iterations, discrepancy=discrepancy, plain=plain,
        shared=shared,
    )  # fmt: skip
    fit = complete(states)
    for _ in range(0 if plain else N_RESTARTS):
        if (restarted := restart(decoder, data, coarse, fit.states)) is None:
            break
        if (again := complete(restarted)).costs[-1] >= fit.costs[-1]:
            break
        fit = again
    return replace(fit, timing_s={"start": started - clock, "least_squares": working_s() - started})


def restart(decoder: MotionDecoder, data: FitData, coarse: FitData, states: FloatArray) -> FloatArray | None:
    """Return states with a new search from the frames of the worst fit on, (T, D), or None where all frames fit alike.

    In a walk that becomes a run, for example, the sequential fit can stay in the walk's phase; these frames then cost
    more than the others. The caller decides by the cost of the whole fit whether the new states are better.

    Parameters
    ----------
    data, coarse : as for `fit_sequence`.
    states : (T, D) of a fit. The worst N_FRAMES successive frames are those of the largest mean cost of a residual;
        all frames fit alike if this cost is below RESTART_FACTOR times the smallest one.
    """
    costs, counts = np.array([_cost(decoder, data, t, state) for t, state in enumerate(states)]).T
    block = np.ones(min(N_FRAMES, len(states)))
    totals, numbers = np.convolve(costs, block, "valid"), np.convolve(counts, block, "valid")
    means = np.where(numbers > 0, totals / np.maximum(numbers, 1), np.nan)
    if not np.nanmax(means) > RESTART_FACTOR * np.nanmin(means):
        return None
    first = int(np.nanargmax(means))
    last_frames = coarse.select_frames(np.arange(first, len(states)))
    rest = find_states(decoder, last_frames, states[first : first + 1, -N_ROOT:])
    phase = decoder.n_style
    rest[:, phase] += np.round(states[first, phase] - rest[0, phase])
    return np.vstack([states[:first], rest])


def _cost(decoder: MotionDecoder, data: FitData, t: int, state: FloatArray) -> tuple[float, int]:
    """Return the cost of frame t without regularisation, and the number of its residuals."""
    residuals, _ = data.residuals[t](decoder.poses(state[None])[0])
    return float(data.loss(residuals)[0].sum()), len(residuals)


def fit_from(
    decoder: MotionDecoder, data: FitData, frames_per_style: int, states: FloatArray, max_iterations: int,
    *, weight: float = 1.0, discrepancy: FloatArray | None = None, plain: bool = False,
    shared: SharedErrors | None = None,
) -> Fit:  # fmt: skip
    """Return the fit of all frames at once from states (T, D) in the basin of attraction.

    Parameters
    ----------
    weight : factor of the terms of the cost.
    discrepancy : (P, k) A, the model discrepancy of a pose being A z, z ~ N(0, I), in every frame. The poses'
        covariance then includes its part that the fitted states do not absorb (`all_frames.discrepancy_sensitivity`).
    plain : see `fit_problem`.
    shared : errors shared by observations, included in the poses' covariance (`all_frames.bias_sensitivity`).
    """
    started = working_s()
    problem = fit_problem(decoder, data.downweighted(weight), frames_per_style, plain)
    states, covariances, search = fit_motion(problem, states, max_iterations=max_iterations)
    fit = fit_of(decoder, data, states, covariances, search.iterations, search.costs)
    causes = []
    if discrepancy is not None:
        causes.append(discrepancy - fit.pose_jacobian @ discrepancy_sensitivity(problem, search, discrepancy))
    if shared is not None:
        causes.append(fit.pose_jacobian @ bias_sensitivity(problem, search, shared))
    if causes:
        fit = fit.with_discrepancy(np.concatenate(causes, axis=2))
    return replace(fit, timing_s={"least_squares": working_s() - started})


def find_states(decoder: MotionDecoder, data: FitData, roots: FloatArray) -> FloatArray:
    """Return initial states (T, D): fitted in frames with observations 1 / REFERENCE_RATE_HZ apart, linear between and
    beyond."""
    times_s, observed = data.times_s, (len(residual(decoder.rest)[0]) > 0 for residual in data.residuals)
    coarse = data.select_spaced(observed)
    if not coarse.residuals:
        raise InputError(
            f"least squares: expected points or {MIN_KEYPOINTS} keypoints of one view in some of {len(times_s)} frames "
            "to start from, found fewer"
        )
    states = follow(decoder, coarse, find_phase(decoder, coarse, roots))
    if len(states) == 1:
        return np.repeat(states, len(times_s), axis=0)
    return np.asarray(scipy.interpolate.make_interp_spline(coarse.times_s, states, k=1)(times_s))
