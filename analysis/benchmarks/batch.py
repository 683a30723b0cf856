"""Paper D's batch fit: its time per frame, and that of `scipy.optimize.least_squares` from the same initial states.

28 frames of 400 points, a style for every frame: roots, phases and coefficients of all frames are the unknowns. With
the recordings of $WORKBENCH_DATA the body is a recorded skeleton with every joint, as in
conf/experiment/points_full.yaml; without them it is the person of 25 degrees of freedom, and a generated walk.
Processor time, which other load on the machine changes little, with one BLAS thread.

scipy has the same residuals, made robust one by one, their derivatives as one dense Jacobian, and the same relative
tolerance of the cost. Values that it requests twice are computed once, and it computes no covariances.
"""

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from analysis.benchmarks.figure import Figure
from analysis.benchmarks.measuring import fastest_s
from workbench.body.surface import Surface, person_surface
from workbench.core.losses import POINT_LOSS, Loss
from workbench.core.prior import Smoothness
from workbench.core.residual import ResidualFunction, robust, surface_residual
from workbench.datasets.person import of_dataset
from workbench.datasets.points import Points
from workbench.inference.least_squares.motion.all_frames import FitProblem, fit_motion, fit_problem
from workbench.inference.least_squares.motion.first_frame import START_POINTS, roots_from_points
from workbench.inference.least_squares.motion.motion_decoder import MotionDecoder
from workbench.inference.least_squares.motion.motion_fit import find_states
from workbench.inference.least_squares.motion.task import Fit, fit_of
from workbench.inference.least_squares.solver.single_frame import FitData
from workbench.priors.from_motions import activity
from workbench.utils.arrays import FloatArray
from workbench.utils.parallel import single_blas_thread

CLIP, N_COMPONENTS = "dataset-2_walk_normal_001", 30
SIGMA_M, LOSS, SMOOTHNESS = 0.02, Loss("geman_mcclure", 1.5), Smoothness()
TOLERANCE = 1e-4
"""Of the cost, relative: the fit's default, and scipy's ftol."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Data and models of the fit. points: (K, 3), m, of each of T frames; times_s: (T,)."""

    what: str
    decoder: MotionDecoder
    surface: Surface
    points: Sequence[FloatArray]
    times_s: FloatArray

    def residuals(self, every: int = 1) -> list[ResidualFunction]:
        """Return the residuals of all frames, of every `every`th point."""
        skeleton = self.decoder.skeleton
        return [surface_residual(skeleton, self.surface, cloud[::every], "distance", SIGMA_M) for cloud in self.points]

    def start(self) -> FloatArray:
        """Return initial states (T, D) fitted to a subset of the points, as in `LeastSquares`."""
        roots = roots_from_points(self.decoder.skeleton, self.points, self.times_s)
        some = self.residuals(every=max(1, len(self.points[0]) // START_POINTS))
        return find_states(self.decoder, FitData(some, self.times_s, POINT_LOSS, SMOOTHNESS), roots)

    def problem(self) -> FitProblem:
        """Return the problem with a style for every frame."""
        return fit_problem(self.decoder, self.data(), frames_per_style=1)

    def data(self) -> FitData:
        """Return the residuals of all points."""
        return FitData(self.residuals(), self.times_s, LOSS, SMOOTHNESS)

    def fit(self, states: FloatArray) -> Fit:
        """Return poses with their covariances, searched from states (T, D)."""
        states, covariances, search = fit_motion(self.problem(), states, tolerance=TOLERANCE)
        return fit_of(self.decoder, self.data(), states, covariances, search.iterations, search.costs)


def figures() -> list[Figure]:
    """Return milliseconds a frame, and how many times as long scipy takes."""
    with single_blas_thread():
        scene = _scene()
        states = scene.start()
        fit = scene.fit(states)
        ours, start = fastest_s([partial(scene.fit, states), scene.start], clock=time.thread_time)
        problem = scene.problem()
        started = time.thread_time()
        result = by_scipy(problem, states)
        theirs = time.thread_time() - started
    per_frame = 1e3 / len(states)
    reached = problem.expand(result.x).cost
    n_dofs, n_points = len(scene.decoder.rest), round(np.mean([len(cloud) for cloud in scene.points]))
    return [
        Figure(
            "batch_ms_per_frame", per_frame * ours, "ms a frame", 30.0, "lower",
            f"{scene.what}; {len(states)} frames, {n_points} points, {n_dofs} dof, {result.x.size} unknowns, "
            f"{fit.iterations:.0f} iterations; finding the start {per_frame * start:.1f} ms a frame more; one thread",
        ),
        Figure(
            "batch_vs_scipy", theirs / ours, "× faster", 5.0, "higher",
            f"scipy's least_squares: {theirs:.1f} s, {result.njev} Jacobians, from cost {fit.costs[0]:.1f} to "
            f"{reached:.1f}, ours {fit.costs[-1]:.1f}; both to {TOLERANCE:g} of the cost",
        ),
    ]  # fmt: skip


def by_scipy(problem: FitProblem, states: FloatArray) -> OptimizeResult:
    """Return the same minimum by scipy, from states (T, D)."""
    dense = Dense(problem)
    return least_squares(
        dense.residuals, problem.unknowns(states), dense.jacobian, ftol=TOLERANCE, xtol=None, gtol=None
    )


class Dense:
    """A problem's cost as ½ |r|², with r (m,) and its Jacobian (m, n) as dense arrays, cached for the last x."""

    def __init__(self, problem: FitProblem) -> None:
        self.problem, self.penalty = problem, problem.penalty.toarray()
        self.robust = [robust(residual, problem.loss) for residual in problem.residuals]
        self.x = np.full(self.penalty.shape[1], np.nan)

    def residuals(self, x: FloatArray) -> FloatArray:
        """Return r (m,) at x (n,)."""
        self._evaluate(x)
        return self._residuals

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Return the Jacobian (m, n) of r."""
        self._evaluate(x)
        return self._jacobian

    def _evaluate(self, x: FloatArray) -> None:
        if np.array_equal(x, self.x):
            return
        states, decoder, columns = x[self.problem.columns], self.problem.decoder, self.problem.columns
        rows, residuals, decoding = [], [], decoder.jacobian(states)
        for t, pose in enumerate(decoder.poses(states)):
            values, by_pose = self.robust[t](pose)
            block = np.zeros((len(values), len(x)))
            block[:, columns[t]] = by_pose @ decoding[t]
            rows.append(block)
            residuals.append(values)
        self.x = x.copy()
        self._residuals = np.concatenate([*residuals, self.penalty @ x])
        self._jacobian = np.concatenate([*rows, self.penalty])


def _scene() -> Scene:
    data, cache = os.environ.get("WORKBENCH_DATA"), os.environ.get("WORKBENCH_CACHE", "~/.cache/workbench")
    if data:
        dataset = Points(motion=CLIP, data=data, first_frame=10, skeleton="full", perturb=False)
        prior = activity(
            motions="bandai", data=data, cache=cache, n_components=N_COMPONENTS, skeleton="full", exclude=[CLIP]
        )
    else:
        dataset = Points(first_frame=10, perturb=False)
        prior = activity(motions="builtin", data=None, cache=cache, n_components=N_COMPONENTS)
    body = of_dataset(dataset.info)
    frames = list(dataset.frames())
    return Scene(
        what="a recorded walk with every joint" if data else "a generated walk",
        decoder=MotionDecoder(body.skeleton, prior.model, np.zeros(len(body.skeleton.dof_names))),
        surface=person_surface(body),
        points=[frame.points for frame in frames if frame.points is not None],
        times_s=np.array([frame.time_s for frame in frames]),
    )
