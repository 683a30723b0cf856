"""Deterministic tracking: a pose and its uncertainty for every frame by least squares (paper D, section 4)."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np
from scipy.interpolate import make_interp_spline

from workbench.arrays import FloatArray, IntArray
from workbench.body.kinematics import forward
from workbench.body.limbs import Body
from workbench.body.skeleton import N_ROOT
from workbench.body.surface import KINDS, Kind, Surface, attach, person_surface, residual_jacobian, residuals
from workbench.datasets.frame import Frame
from workbench.errors import InputError
from workbench.inference.decoding import Decoder, MotionDecoder, MotionModel, PoseDecoder
from workbench.inference.frame_fit import PACE_HZ, Gaussian, Smoothness, follow, global_motion, pose_prior, track_poses
from workbench.inference.motion_fit import FitProblem, fit_motion, fit_problem
from workbench.inference.observed import UPRIGHT_SIGMA_RAD, Observed, kinds_seen, observe, views_residual
from workbench.inference.phase_grid import find_phase, roots_from_points
from workbench.inference.residuals import Loss, Residual, upright_residual
from workbench.inference.robust import LOSSES
from workbench.inference.smooth_fit import LEANING_SIGMA_RAD, first_poses, fit_smooth
from workbench.inference.start import KEYPOINT_LOSS, enough_keypoints, first_keypoints, likely_pose, likely_roots
from workbench.inference.step import Step
from workbench.learning.activities import ActivityModel
from workbench.learning.activity_classes import classify
from workbench.priors.state import StateSpace

STYLES = ("steady", "frame", "smooth", "none")
FREE_STYLES = ("smooth", "none")
"""Those without a motion model."""
START_POINTS = 150
"""Points a frame that the start looks at, taken evenly from all; more only make it slower."""
START_SIGMA_M = 0.02
START_LOSS = Loss("geman_mcclure", 1.5)
"""The start always looks at distances with this deviation and loss: the field says nothing far from the body."""
START_GAP_S = 1.0 / PACE_HZ
"""The start leaves out frames that are closer than this to one before, in which a person moves little."""
FEW_INLIERS = 0.3
"""Where fewer of a frame's points and keypoints are near the body, the step says so."""


@dataclass(frozen=True, eq=False)
class Fit:
    """T frames fitted. poses: (T, P). covariance: (T, P, P), marginal, of the poses by the Gauss–Newton matrix.

    space: names the D columns of `states` (T, D), {α, μ, root} with a motion model, else the pose. alpha (T, d) in
    standard deviations, mu (T,) in cycles, counted on; without a motion model d = 0 and μ is NaN.
    state_covariance: (T, D, D). pose_jacobian: (T, P, D) that takes one covariance to the other.
    inliers: (T,) part of the residuals within the loss's scale, NaN in a frame that shows nothing (0 in its step).
    iterations: evaluations of all frames together, or per frame without a motion model. costs: of the batch, at the
    start and after every accepted step; without a motion model every frame's last. timing_s: seconds per stage.
    """

    space: StateSpace
    poses: FloatArray
    covariance: FloatArray
    alpha: FloatArray
    mu: FloatArray
    states: FloatArray
    state_covariance: FloatArray
    pose_jacobian: FloatArray
    inliers: FloatArray
    iterations: float
    costs: tuple[float, ...]
    timing_s: Mapping[str, float] = field(default_factory=dict)


def fit_sequence(
    decoder: MotionDecoder,
    residuals: Sequence[Residual],
    times_s: FloatArray,
    loss: Loss,
    *,
    smoothness: Smoothness,
    frames_per_style: int,
    phases: tuple[float, float] | None,
    roots: FloatArray | None = None,
    coarse: tuple[Sequence[Residual], Loss] | None = None,
    max_iterations: int = 40,
    tolerance: float = 1e-4,
) -> Fit:
    """A motion model fitted to T frames at times (T,), s, whatever their residuals are made of.

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
    """All frames of a problem fitted at once from states (T, D) near enough."""
    states, covariances, found = fit_motion(problem, states, max_iterations=max_iterations, tolerance=tolerance)
    return _fit(problem.decoder, problem.residuals, problem.loss, states, covariances, found.iterations, found.costs)


def find_states(
    decoder: MotionDecoder,
    residuals: Sequence[Residual],
    times_s: FloatArray,
    loss: Loss,
    smoothness: Smoothness,
    roots: FloatArray,
) -> FloatArray:
    """States (T, D) to start from: found in frames that show something START_GAP_S apart, linear between and beyond."""
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


def fit_poses(
    decoder: PoseDecoder,
    residuals: Sequence[Residual],
    loss: Loss,
    start: FloatArray,
    prior: Gaussian | None = None,
) -> Fit:
    """The baseline without a motion model, frame by frame from a pose (P,), with a Gaussian prior over poses or not."""
    clock = perf_counter()
    poses, covariances, searches = track_poses(decoder, residuals, loss, start, prior)
    iterations = float(np.mean([search.iterations for search in searches]))
    costs = tuple(search.costs[-1] for search in searches)
    fit = _fit(decoder, residuals, loss, poses, covariances, iterations, costs)
    return replace(fit, timing_s={"least_squares": perf_counter() - clock})


def steps(fit: Fit, frames: Sequence[Frame], n_particles: int, rng: np.random.Generator) -> Iterator[Step]:
    """One step per frame: particles drawn from the Gaussian posterior of its state, with even weights.

    Poses are drawn by the same numbers through the derivative at the fit, so that theirs is the Gaussian of
    `Fit.covariance`. The expected pose is the fit. Frames are drawn independently of each other, so that an ancestor
    means nothing. Phases are shown from the cycle they are in.
    """
    even, ancestors = np.full(n_particles, -np.log(n_particles)), np.arange(n_particles)
    phase = fit.space.slices.get("phase", slice(0))
    for t, frame in enumerate(frames):
        draws = rng.standard_normal((n_particles, len(fit.space))) @ _root(fit.state_covariance[t]).T
        state = fit.states[t].copy()
        state[phase] %= 1.0
        diagnostics = {"inliers": float(np.nan_to_num(fit.inliers[t])), "iterations": fit.iterations}
        yield Step(
            frame=frame, space=fit.space, particles=state + draws,
            poses=fit.poses[t] + draws @ fit.pose_jacobian[t].T, log_weights=even, ancestors=ancestors,
            expected_pose=fit.poses[t], map_pose=fit.poses[t], ess=float(n_particles), log_evidence=0.0,
            diagnostics=diagnostics, evaluations=fit.iterations,
            timing_s={stage: s / len(frames) for stage, s in fit.timing_s.items()},
        )  # fmt: skip


class LeastSquares:
    """Fits a person to points on the surface, to 2-D keypoints or to both, all frames at once: an inference that yields
    its steps after solving.

    style: "steady", one α for all frames (D, section 4.2), "frame", one for every `frames_per_style` frames (section
    4.3), "smooth", no motion model, all frames at once with smooth angles within limits (see `smooth_fit`), or "none",
    no motion model, frame by frame (section 4.1), with `pose_prior` under the Gaussian of the model's poses. kind: of
    the residual of points, "distance" (m) or the paper's "field"; sigma: its standard deviation, in the same unit.
    sigma_px: that of a keypoint, px of the image it was seen in. loss: "squared", "huber" or "geman_mcclure", which
    bends at `scale`, in the unit of sigma, and for keypoints at as many deviations. phases: (μ₁, μ_T), cycles, or None
    to take phase_ends, what the dataset offers, or without those to find them. sigma_style, sigma_phase,
    sigma_position, sigma_rotation, sigma_angle: see `frame_fit.Smoothness`. ground_m: height of a standing person's
    ankles in the world, m, to which style "smooth" ties the lower foot; None: to none. most_points: a frame's points
    beyond are thinned at random. n_particles: drawn per step. surface: of the body, by default `person_surface(body)`.

    Raises InputError for numbers out of range and a style that needs a model where there is none.

    Deviations. D minimises the plain sum of squares of f − C: here "field" with "squared"; by default residuals are
    distances in metres under a loss that redescends, and the start's always are. D sets the first pose and the phases'
    ends by hand. D has no regularisation.
    """

    def __init__(
        self,
        body: Body,
        model: MotionModel | None = None,
        phase_ends: tuple[float, float] | None = None,
        *,
        style: str = "frame",
        kind: Kind = "distance",
        loss: str = "geman_mcclure",
        scale: float = 0.03,
        sigma: float = 0.02,
        sigma_px: float = 4.0,
        frames_per_style: int = 1,
        phases: tuple[float, float] | None = None,
        pose_prior: bool = False,
        sigma_style: float = 0.3,
        sigma_phase: float = 0.02,
        sigma_position: float = 0.03,
        sigma_rotation: float = 0.03,
        sigma_angle: float = 0.2,
        ground_m: float | None = None,
        most_points: int = 1000,
        max_iterations: int = 40,
        n_particles: int = 500,
        surface: Surface | None = None,
    ) -> None:
        for name, given, known in (("style", style, STYLES), ("loss", loss, tuple(LOSSES)), ("kind", kind, KINDS)):
            if given not in known:
                raise InputError(f"inference: {name} must be one of {', '.join(known)}, found {given!r}")
        positive = {
            "scale": scale, "sigma": sigma, "sigma_px": sigma_px, "frames_per_style": frames_per_style,
            "sigma_style": sigma_style, "sigma_phase": sigma_phase, "sigma_position": sigma_position,
            "sigma_rotation": sigma_rotation, "sigma_angle": sigma_angle, "most_points": most_points,
            "max_iterations": max_iterations, "n_particles": n_particles,
        }  # fmt: skip
        for name, value in positive.items():
            if not 0.0 < value < np.inf:
                raise InputError(f"inference: {name} must be above zero, found {value}")
        if model is None and (style not in FREE_STYLES or pose_prior):
            raise InputError("inference: expected a motion model; only style=none and style=smooth do without")
        self.skeleton, self.model = body.skeleton, model
        self.surface = person_surface(body) if surface is None else surface
        self.style, self.kind, self.sigma, self.sigma_px = style, kind, sigma, sigma_px
        self.loss = Loss(loss, scale / sigma)
        self.frames_per_style, self.pose_prior = frames_per_style, pose_prior
        self.phases = phase_ends if phases is None else phases
        self.smoothness = Smoothness(sigma_style, sigma_phase, sigma_position, sigma_rotation, sigma_angle)
        self.ground_m = ground_m
        self.most_points, self.max_iterations, self.n_particles = most_points, max_iterations, n_particles

    @property
    def space(self) -> StateSpace:
        """Of the particles: {α, μ, root}, or without a motion model the pose."""
        if self.style in FREE_STYLES or self.model is None:
            return PoseDecoder(self.skeleton).space
        return MotionDecoder(self.skeleton, self.model, np.zeros(len(self.skeleton.dof_names))).space

    def run(
        self, frames: Iterable[Frame], start: FloatArray | None, rng_streams: Mapping[str, np.random.Generator]
    ) -> Iterator[Step]:
        """One step per frame once all are fitted, from about the pose `start` (P,), or None to find the person.

        rng_streams: generators named "start", which thins points, and "prior", which draws the particles. A frame that
        shows nothing is bridged by its neighbours, or without a motion model keeps the pose before, and says so.
        Raises InputError when there is nothing to fit.
        """
        frames = list(frames)
        fit, observed, warnings = self.fit_frames(frames, start, rng_streams["start"])
        drawn = steps(fit, frames, self.n_particles, rng_streams["prior"])
        for step, seen, said in zip(drawn, observed, warnings, strict=True):
            near, kinds = step.diagnostics["inliers"], " and ".join(kinds_seen([seen]))
            if kinds and near < FEW_INLIERS:
                said = (*said, f"frame {step.frame.index}: only {near:.0%} of the {kinds} lie near the body")
            parts = self._attachment(step)
            timing_s = {**step.timing_s, **self._one_evaluation(step.expected_pose, seen.points)}
            told, probabilities = self._told(step)
            diagnostics = {**step.diagnostics, **probabilities}
            yield replace(
                step, warnings=said, activity=told, attachment=parts, timing_s=timing_s, diagnostics=diagnostics
            )

    def _one_evaluation(self, pose: FloatArray, points: FloatArray) -> dict[str, float]:
        """Seconds that F, and F with its Jacobian, take with attachments fixed: paper D's measure of its cost."""
        if not len(points):
            return {}
        frames = forward(self.skeleton, pose[None])
        parts = attach(self.surface, frames, points, self.kind)
        arguments = (self.skeleton, self.surface, pose, points, self.kind, parts)
        residual_jacobian(*arguments)  # the first call compiles; the fit itself searches and differentiates at once
        began = perf_counter()
        residuals(*arguments)
        between = perf_counter()
        residual_jacobian(*arguments)
        return {"residual": between - began, "residual_jacobian": perf_counter() - between}

    def _told(self, step: Step) -> tuple[str | None, dict[str, float]]:
        """The activity of the step's coefficients among the model's, and the probability of each (paper D, section 5).

        Nothing where the model has one activity only.
        """
        model = None if self.style in FREE_STYLES else self.model
        if not isinstance(model, ActivityModel) or len(set(model.activities)) < 2:
            return None, {}
        coefficients = step.space.slices["coefficients"]
        told = classify(model, step.particles[:, coefficients].mean(axis=0))
        named = zip(told.activities, told.probabilities, strict=True)
        return str(told.labels), {f"probability_{name}": float(probability) for name, probability in named}

    def _attachment(self, step: Step) -> IntArray | None:
        """The part (K,) of each of the frame's points at the fit, -1 where none is within three deviations."""
        points = step.frame.points
        if points is None:
            return None
        parts, usable = np.full(len(points), -1), np.isfinite(points).all(axis=1)
        frames = forward(self.skeleton, step.expected_pose[None])
        near = attach(self.surface, frames, points[usable], self.kind)
        missed = residuals(self.skeleton, self.surface, step.expected_pose, points[usable], self.kind, near)
        parts[usable] = np.where(np.abs(missed) < 3.0 * self.sigma, near, -1)
        return parts

    def fit_frames(
        self, frames: Sequence[Frame], start: FloatArray | None, rng: np.random.Generator
    ) -> tuple[Fit, list[Observed], list[tuple[str, ...]]]:
        """The fit of all frames, with what was used of each and what there is to say about it.

        rng: thins points. Raises InputError when there is nothing to fit.
        """
        if not frames:
            raise InputError("least squares: expected at least one frame, found none")
        seen, warnings = observe(frames, self.skeleton, self.most_points, rng)
        if not kinds_seen(seen):
            raise InputError(f"least squares: expected points or keypoints to fit, found none in {len(frames)} frames")
        return self.fit(seen, np.array([frame.time_s for frame in frames]), start), seen, warnings

    def fit(self, seen: Sequence[Observed], times_s: FloatArray, start: FloatArray | None) -> Fit:
        """The fit of T frames at times (T,), s; `start` as for `run`."""
        residuals = self._residuals(seen)
        rest = np.zeros(len(self.skeleton.dof_names)) if start is None else start
        decoder = None if self.model is None else MotionDecoder(self.skeleton, self.model, rest)
        if decoder is None or self.style in FREE_STYLES:
            prior = pose_prior(decoder) if decoder is not None and self.pose_prior else None
            if self.style == "smooth":
                return self._fit_smooth(seen, residuals, times_s, start)
            start = self._first_pose(seen, times_s, prior) if start is None else start
            return fit_poses(PoseDecoder(self.skeleton), residuals, self.loss, start, prior)
        return fit_sequence(
            decoder, residuals, times_s, self.loss, coarse=self._coarse(seen), smoothness=self.smoothness,
            phases=self.phases, roots=self._first_roots(decoder, seen, times_s) if start is None else None,
            frames_per_style=len(residuals) if self.style == "steady" else self.frames_per_style,
            max_iterations=self.max_iterations,
        )  # fmt: skip

    def _fit_smooth(
        self, seen: Sequence[Observed], residuals: Sequence[Residual], times_s: FloatArray, start: FloatArray | None
    ) -> Fit:
        clock = perf_counter()
        if start is not None:
            starts = start[None]
        elif keypoints := first_keypoints(seen):
            starts = first_poses(self.skeleton, keypoints, self.sigma_px)
        else:
            starts = self._first_pose(seen, times_s, None)[None]
        cameras = {one.camera.name: one.camera for frame in seen for one in frame.keypoints}
        poses, covariances, found = fit_smooth(
            self.skeleton, residuals, times_s, self.loss, starts, self.smoothness, self.max_iterations,
            shown=[bool(kinds_seen([one])) for one in seen],
            camera=next(iter(cameras.values())) if len(cameras) == 1 and "points" not in kinds_seen(seen) else None,
            ground_m=self.ground_m,
        )  # fmt: skip
        decoder = PoseDecoder(self.skeleton)
        fit = _fit(decoder, residuals, self.loss, poses, covariances, found.iterations, found.costs)
        return replace(fit, timing_s={"least_squares": perf_counter() - clock})

    def _residuals(self, seen: Sequence[Observed]) -> list[Residual]:
        """Of every frame. Where keypoints are all there is, a person is upright in the frames between them too."""
        upright = LEANING_SIGMA_RAD if self.style == "smooth" else UPRIGHT_SIGMA_RAD
        own = (self.skeleton, self.surface, self.kind, self.sigma, self.sigma_px, upright)
        residuals = [one.residual(*own) for one in seen]
        if kinds_seen(seen) != ("keypoints",):
            return residuals
        alone = upright_residual(self.skeleton, upright)
        return [residual if one.keypoints else alone for one, residual in zip(seen, residuals, strict=True)]

    def _coarse(self, seen: Sequence[Observed]) -> tuple[list[Residual], Loss]:
        """What the start looks at, and with which loss: some of the points, and keypoints where there are enough."""
        thin = [Observed(one.points[:: max(1, len(one.points) // START_POINTS)], enough_keypoints(one)) for one in seen]
        far = [one.residual(self.skeleton, self.surface, "distance", START_SIGMA_M, self.sigma_px) for one in thin]
        return far, START_LOSS if "points" in kinds_seen(seen) else KEYPOINT_LOSS

    def _first_roots(self, decoder: MotionDecoder, seen: Sequence[Observed], times_s: FloatArray) -> FloatArray:
        """Where the person may be, (n, 6), in the first frame that shows enough: by its keypoints, else by points."""
        keypoints = first_keypoints(seen)
        if not keypoints:
            return roots_from_points(self.skeleton, [one.points for one in seen], times_s)
        return likely_roots(decoder, keypoints, views_residual(self.skeleton, keypoints, self.sigma_px))

    def _first_pose(self, seen: Sequence[Observed], times_s: FloatArray, prior: Gaussian | None) -> FloatArray:
        """The same without a motion: a pose (P,)."""
        keypoints = first_keypoints(seen)
        if not keypoints:
            roots = roots_from_points(self.skeleton, [one.points for one in seen], times_s)
            if len(roots) > 1:
                raise InputError("least squares: the person moves too little to tell where they face; give a start")
            return np.concatenate([roots[0], np.zeros(len(self.skeleton.dof_names) - N_ROOT)])
        return likely_pose(self.skeleton, keypoints, views_residual(self.skeleton, keypoints, self.sigma_px), prior)


def _fit(
    decoder: Decoder,
    residuals: Sequence[Residual],
    loss: Loss,
    states: FloatArray,
    covariances: FloatArray,
    iterations: float,
    costs: tuple[float, ...],
) -> Fit:
    poses, jacobian = decoder.poses(states), decoder.jacobian(states)
    near = [np.abs(residual(pose)[0]) < loss.scale for residual, pose in zip(residuals, poses, strict=True)]
    slices = decoder.space.slices
    phases = states[:, slices["phase"].start] if "phase" in slices else np.full(len(states), np.nan)
    return Fit(
        space=decoder.space, poses=poses, covariance=jacobian @ covariances @ jacobian.transpose(0, 2, 1),
        alpha=states[:, slices.get("coefficients", slice(0))], mu=phases, states=states,
        state_covariance=covariances, pose_jacobian=jacobian,
        inliers=np.array([hits.mean() if len(hits) else np.nan for hits in near]),
        iterations=iterations, costs=costs,
    )  # fmt: skip


def _root(covariance: FloatArray) -> FloatArray:
    """A with A Aᵀ the covariance (D, D), by eigenvalues, as it may be singular to rounding."""
    values, vectors = np.linalg.eigh(covariance)
    root: FloatArray = vectors * np.sqrt(values.clip(min=0.0))
    return root
