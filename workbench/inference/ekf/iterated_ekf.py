"""The iterated extended Kalman filter (Bell & Cathey 1993) and the smoother of Rauch, Tung & Striebel (1965)."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar, TypeAlias

import numpy as np

from workbench.body.limbs import Body
from workbench.body.skeleton import POSE_NAMES
from workbench.core.capabilities import DERIVATIVES, GAUSSIAN, START, UNIFORM_WEIGHTS, Traits, component_traits
from workbench.core.checks import INSIDE_UNIT, POSITIVE, UNIT, at_least, check
from workbench.core.frame import Frame
from workbench.core.gaussian import condition_block
from workbench.core.likelihood import DenseLikelihood, DifferentiableLikelihood, Likelihood, Refittable
from workbench.core.prior import Prior
from workbench.core.state_space import StateSpace
from workbench.core.step import Step
from workbench.inference.ekf import gaussian_state, levenberg_marquardt
from workbench.inference.ekf.dense_refinement import refine_pose
from workbench.inference.ekf.gaussian_state import GaussianState
from workbench.inference.ekf.levenberg_marquardt import LaplaceApproximation
from workbench.inference.ekf.limb_reinitialization import is_better, reinitialize_limb
from workbench.inference.smc.move import Streams
from workbench.inference.smc.target import Stopwatch
from workbench.inference.smc.weights import uniform_log_weights
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.errors import InputError

REINITIALIZED_STD_RAD, REINITIALIZED_STD_RAD_S = 0.2, 3.0
"""Standard deviations of the angles of a reinitialized limb, and of their speeds."""
BASE_INFLATION = 0.3
"""Factor of the samples' standard deviations at a perfect fit, before `std_inflation`; the misfit is added to it."""


FilteredFrame: TypeAlias = tuple[Frame, GaussianState, dict[str, Any]]
"""A frame, its Gaussian state, and further fields of its step."""


@dataclass(frozen=True, eq=False)
class IteratedEkf:
    """Approximate each frame's posterior by a Gaussian at its mode (Laplace) and report it as samples.

    The prior predicts N(m, P) from the previous frame's Gaussian, by the derivatives of its mean and its noise. The
    search for the mode of N(pose; m, P), with heavier tails, times p(frame | pose) starts at m and uses the
    likelihood's derivatives (`levenberg_marquardt`); the curvature at the mode reduces P. If the likelihood can also
    compare distant poses (`DenseLikelihood`), arms and legs are reinitialized where that is better
    (`reinitialize_limb`), and all pixels refine the pose (`refine_pose`).

    n_particles: samples, of equal weight. outlier_motion_probability: probability that a limb moves as m does not
    predict. curvature_weight: weight of the likelihood's curvature in the covariance; lower values give wider credible
    intervals and a wider search in the next frame. std_inflation: factor of the samples' standard deviations, for model
    errors and errors of cues that are correlated between frames; for each joint it is multiplied by BASE_INFLATION plus
    the likelihood's misfit, as curvature alone does not indicate a lost track. pose_prior_power: power of the prior's
    density of poses, if it has one; it affects the reported Gaussian, but not the tracking. second_pass: smooth
    backwards after the last frame; a likelihood that learns from tracked clips (`Refittable`) is first refitted and
    filtered a second time, and both passes are fused (`fuse_passes`). Otherwise every frame is reported as soon as it
    is filtered. Raises InputError for a prior without Gaussian noise, a likelihood without derivatives and numbers out
    of range.
    """

    traits: ClassVar[Traits] = component_traits(UNIFORM_WEIGHTS, dataset=START, prior=GAUSSIAN, likelihood=DERIVATIVES)

    prior: Prior
    likelihood: Likelihood
    body: Body
    _: KW_ONLY
    n_particles: int = 500
    outlier_motion_probability: float = 0.05
    curvature_weight: float = 0.05
    std_inflation: float = 1.0
    pose_prior_power: float = 0.0
    second_pass: bool = True

    finds_start: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check("inference", self, n_particles=at_least(2), curvature_weight=UNIT, outlier_motion_probability=INSIDE_UNIT)
        check("inference", self, std_inflation=POSITIVE, pose_prior_power=UNIT)

    @property
    def space(self) -> StateSpace:
        """Return the prior's state space."""
        return self.prior.space

    def run(self, frames: Iterable[Frame], start: FloatArray | None, rng_streams: Streams) -> Iterator[Step]:
        """Yield one step per frame; with a second pass, after the last frame.

        Parameters
        ----------
        frames : of the sequence.
        start : (P,) or (n, P), the initial pose, of several the first.
        rng_streams : generators named "prior" and "resampling".

        Raises
        ------
        InputError : there is no start.
        """
        if start is None:
            raise InputError("inference: a Kalman filter needs a pose to start from, found none")
        if not self.second_pass:
            for frame, state, fields in self._filter(self.likelihood, frames, start, rng_streams):
                yield self._step(frame, [state], rng_streams["prior"], fields)
            return
        filtered = list(self._filter(self.likelihood, frames, start, rng_streams))
        passes = [gaussian_state.smooth_backward([state for _, state, _ in filtered])]
        if isinstance(self.likelihood, Refittable):
            filtered = self._filter_again(self.likelihood, filtered, passes[0], start, rng_streams)
            passes.append(gaussian_state.smooth_backward([state for _, state, _ in filtered]))
        for (frame, _, fields), *states in zip(filtered, *passes, strict=True):
            yield self._step(frame, states, rng_streams["prior"], fields)

    def _filter_again(
        self, likelihood: Refittable, filtered: list[FilteredFrame], states: list[GaussianState], start: FloatArray,
        rng_streams: Streams,
    ) -> list[FilteredFrame]:  # fmt: skip
        """Filter all frames with the likelihood refitted at the first pass's poses.

        Each frame's time and evaluations are the sums of both passes; the first frame's include the refit.
        """
        clock, frames = Stopwatch(), [frame for frame, _, _ in filtered]
        poses = self.prior.pose(np.stack([state.mean for state in states]))
        first_poses = {frame.index: pose for frame, pose in zip(frames, poses, strict=True)}
        refitted = likelihood.refitted(frames[0], first_poses)
        clock.lap("likelihood")
        second = list(self._filter(refitted, frames, start, rng_streams, first_poses))
        for (_, _, earlier), (_, _, fields) in zip(filtered, second, strict=True):
            spent = earlier["timing_s"], fields["timing_s"], clock.laps
            stages = {**spent[0], **spent[1]}
            fields["timing_s"] = {stage: sum(laps.get(stage, 0.0) for laps in spent) for stage in stages}
            fields["evaluations"] += earlier["evaluations"]
            clock.laps.clear()
        return second

    def _filter(
        self, likelihood: Likelihood, frames: Iterable[Frame], start: FloatArray, rng_streams: Streams,
        first_poses: Mapping[int, FloatArray] = MappingProxyType({}),
    ) -> Iterator[FilteredFrame]:  # fmt: skip
        """Filter frame by frame; first_poses: poses (P,) of the first pass by frame index."""
        model, previous, log_evidence = gaussian_state.gaussian_density(self.prior), None, 0.0
        mean, covariance = model.initial_moments(np.atleast_2d(start)[0])
        state = GaussianState(mean, covariance, mean, covariance, np.eye(len(mean)), np.ones(len(POSE_NAMES)))
        for frame in frames:
            clock, evaluations = Stopwatch(), 0.0
            frame_likelihood = likelihood.prepare(previous, frame)
            if not isinstance(frame_likelihood, DifferentiableLikelihood):
                name = type(self.likelihood).__name__
                raise InputError(f"inference: a Kalman filter needs a likelihood with {DERIVATIVES}, found {name}")
            if previous is not None or frame_likelihood.informative:
                pose = self.prior.pose(state.mean[None])
                if previous is not None:
                    state = gaussian_state.predict(model, state, frame.time_s - previous.time_s)
                clock.lap("prior")
                reinitialize = previous is not None  # not the initial pose
                state, mode = self._update(state, frame_likelihood, pose, reinitialize, rng_streams["resampling"])
                if frame.index in first_poses and isinstance(frame_likelihood, DenseLikelihood):
                    weights = gaussian_state.first_pass_weights(
                        frame_likelihood, self.body.skeleton, self._limb_columns, mode.pose, first_poses[frame.index]
                    )
                    state = replace(state, first_pass_weights=weights)
                log_evidence, evaluations = log_evidence + mode.log_evidence, float(mode.evaluations)
            likelihood = frame_likelihood.update(self.prior.pose(state.mean[None])[0])
            clock.lap("likelihood")
            yield frame, state, {
                "log_evidence": log_evidence, "timing_s": clock.laps, "warnings": tuple(frame_likelihood.notes),
                "diagnostics": frame_likelihood.diagnostics, "evaluations": evaluations,
            }  # fmt: skip
            previous = frame

    def _update(
        self, state: GaussianState, frame_likelihood: DifferentiableLikelihood, previous_pose: FloatArray,
        reinitialize: bool, rng: np.random.Generator,
    ) -> tuple[GaussianState, LaplaceApproximation]:  # fmt: skip
        """Condition the predicted state on a frame; previous_pose: (1, P). reinitialize: whether limbs may be."""
        mode = self._find_mode(frame_likelihood, state, state.mean[: previous_pose.shape[1]])
        if isinstance(frame_likelihood, DenseLikelihood):
            if reinitialize:
                state, mode = self._reinitialize_limbs(frame_likelihood, state, mode, previous_pose[0], rng)
            mode = self._refine(frame_likelihood, state, mode)
        inflation = BASE_INFLATION + frame_likelihood.mean_loss(mode.pose)[self.body.skeleton.dof_joints]
        mean, covariance = condition_block(state.mean, state.covariance, mode.pose, mode.covariance)
        return replace(state, mean=mean, covariance=covariance, std_inflation=inflation), mode

    def _find_mode(
        self, frame_likelihood: DifferentiableLikelihood, state: GaussianState, start: FloatArray
    ) -> LaplaceApproximation:
        """Return the posterior's mode from a pose (P,)."""
        n = len(start)
        return levenberg_marquardt.find_mode(
            frame_likelihood, state.mean[:n], state.covariance[:n, :n], self.body.skeleton.limits, start=start,
            limbs=self._limb_of_parameter, outlier_motion_probability=self.outlier_motion_probability,
            curvature_weight=self.curvature_weight,
        )  # fmt: skip

    def _reinitialize_limbs(
        self, frame_likelihood: DenseLikelihood, state: GaussianState, mode: LaplaceApproximation,
        previous_pose: FloatArray, rng: np.random.Generator,
    ) -> tuple[GaussianState, LaplaceApproximation]:  # fmt: skip
        """Reinitialize each arm and leg where that is better; its predicted speed is then zero."""
        skeleton = self.body.skeleton
        for limb in self._limb_columns:
            pose = reinitialize_limb(frame_likelihood, skeleton, limb, mode.pose, previous_pose, rng)
            if pose is None:
                continue
            decoupled = state.decoupled(*self._reinitialized_columns(limb, pose))
            candidate = self._find_mode(frame_likelihood, decoupled, pose)
            if is_better(frame_likelihood, len(skeleton.names), mode.pose, candidate.pose, limb, previous_pose):
                state, mode = decoupled, candidate
        return state, mode

    def _refine(
        self, frame_likelihood: DenseLikelihood, state: GaussianState, mode: LaplaceApproximation
    ) -> LaplaceApproximation:
        """Return the mode refined by all pixels of the frame."""
        n, limits = len(mode.pose), self.body.skeleton.limits
        prior = levenberg_marquardt.heavy_tailed_prior(
            state.mean[:n], state.covariance[:n, :n], self._limb_of_parameter, self.outlier_motion_probability
        )
        pose, slope, count = refine_pose(frame_likelihood, prior, mode.pose, mode.slope, limits, self._all_joints)
        n_evaluations = mode.evaluations + count
        return levenberg_marquardt.laplace_approximation(prior, pose, slope, self.curvature_weight, n_evaluations)

    def _reinitialized_columns(self, limb: IntArray, pose: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return the state's columns of a limb reinitialized at a pose (P,), their means and standard deviations.

        These are the columns of its angles, and of their speeds if the state has them.
        """
        names, dofs = list(self.space.names), self.body.skeleton.dof_names
        speeds = [names.index(name) for k in limb if (name := f"{dofs[k]}_velocity") in names]
        columns = np.array([*limb, *speeds], dtype=np.int64)
        means = np.append(pose[limb], np.zeros(len(speeds)))
        return columns, means, np.repeat([REINITIALIZED_STD_RAD, REINITIALIZED_STD_RAD_S], [len(limb), len(speeds)])

    @cached_property
    def _all_joints(self) -> BoolArray:
        """Return True for all joints (J,)."""
        return np.ones(len(self.body.skeleton.names), dtype=np.bool_)

    @cached_property
    def _limb_of_parameter(self) -> IntArray:
        """Return the limb that each pose parameter (P,) moves: 0 for the root, and one for each subtree below it."""
        parents, limb = self.body.skeleton.parents, np.zeros(len(self.body.skeleton.parents), dtype=np.int64)
        for joint, parent in enumerate(parents):
            if parent >= 0:
                limb[joint] = limb[parent] if parents[parent] >= 0 else limb.max() + 1
        return np.asarray(limb[self.body.skeleton.dof_joints])

    @cached_property
    def _limb_columns(self) -> list[IntArray]:
        """Return the columns of the angles of each arm and each leg."""
        joints, limbs = self.body.skeleton.dof_joints, self._limb_of_parameter
        columns = [np.flatnonzero(limbs == k) for k in range(1, int(limbs.max()) + 1)]
        return [limb for limb in columns if len(np.unique(joints[limb])) > 1]

    def _step(
        self, frame: Frame, states: Sequence[GaussianState], rng: np.random.Generator, fields: Mapping[str, Any]
    ) -> Step:
        """Return the step of a frame from its states of one pass or two."""
        state = states[-1]
        n = len(state.std_inflation)
        inflation = self.std_inflation * np.append(state.std_inflation, np.ones(len(state.mean) - n))
        mean, covariance = state.mean, inflation[:, None] * state.covariance * inflation
        if len(states) > 1:
            mean, covariance = gaussian_state.fuse_passes(states[0].mean, mean, covariance, state.first_pass_weights)
        if self.pose_prior_power > 0.0 and self.prior.capabilities.pose_prior is not None:
            drawn = self.prior.capabilities.pose_prior.geometric_product(
                mean[:n], covariance[:n, :n], self.pose_prior_power
            )
            mean, covariance = condition_block(mean, covariance, *drawn)
        values, vectors = np.linalg.eigh(covariance)
        half = rng.standard_normal((self.n_particles // 2, len(values)))  # antithetic pairs have the Gaussian's mean
        white = np.concatenate([half, -half, np.zeros((self.n_particles % 2, len(values)))])
        samples = mean + (white * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
        nearest = int(np.argmin((white**2).sum(axis=1)))
        poses, expected = self.prior.pose(samples), self.prior.pose(mean[None])[0]
        return Step(
            frame=frame, space=self.space, particles=samples, poses=poses,
            log_weights=uniform_log_weights(self.n_particles), ancestors=np.arange(self.n_particles),
            expected_pose=expected, map_pose=poses[nearest], ess=float(self.n_particles), **fields,
        )  # fmt: skip
