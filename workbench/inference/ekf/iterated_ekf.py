"""The iterated extended Kalman filter (Bell & Cathey 1993) and the smoother of Rauch, Tung & Striebel (1965)."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar, TypeAlias

import numpy as np

from workbench.body.limbs import Body
from workbench.body.skeleton import POSE_NAMES
from workbench.core.capabilities import DERIVATIVES, GAUSSIAN, START, UNIFORM_WEIGHTS, Traits, offering
from workbench.core.checks import INSIDE_UNIT, POSITIVE, UNIT, at_least, check
from workbench.core.filter_state import Memory, Past, recalled, streams_now
from workbench.core.frame import Frame
from workbench.core.gaussian import condition_block
from workbench.core.likelihood import DenseLikelihood, DifferentiableLikelihood, Likelihood, Refittable
from workbench.core.prior import Prior
from workbench.core.state_space import StateSpace
from workbench.core.step import Step
from workbench.inference.ekf.dense_refinement import settle
from workbench.inference.ekf.gaussian_state import GaussianState, gaussian_of, of_both, predict, shares, smoothed
from workbench.inference.ekf.levenberg_marquardt import Peak, climb, peak_at, tails
from workbench.inference.ekf.limb_reinitialization import is_better, leap
from workbench.inference.smc.move import Streams
from workbench.inference.smc.target import Stopwatch
from workbench.inference.smc.weights import even_log_weights
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.errors import InputError

LEAPT_RAD, LEAPT_RAD_S = 0.2, 3.0
"""How far angles and their speeds may be off where a limb is found anew."""
BASE_DOUBT = 0.3
"""By how much wider the draws are told at a perfect fit, before `widen`; by this and the misfit elsewhere."""


Filtered: TypeAlias = tuple[Frame, GaussianState, dict[str, Any]]
"""A frame, what is believed of it, and what else its step tells."""


@dataclass(frozen=True, eq=False)
class Kalman:
    """Approximate each frame's posterior by a Gaussian at its mode (Laplace) and report it as samples.

    The prior leads the Gaussian of the frame before on to N(m, P), by its mean's derivatives and its noise. The mode of
    N(pose; m, P), with heavier tails, times p(frame | pose) is found from m by the likelihood's derivatives (`climb`),
    and P is narrowed by its curvature there. A likelihood that can also tell apart poses that are far from each other
    is asked whether an arm or a leg is somewhere else (`leap`), and climbed on by all its pixels (`settle`).

    n_particles: samples, with even weights. sudden: probability that a limb moves as m does not predict. flatten: power
    of the likelihood that narrows P: below 1, bands are wider, and the next frame's search goes farther. widen: factor
    of the samples' deviations, for what model and cues have in common from frame to frame; it is multiplied, joint by
    joint, by BASE_DOUBT plus the likelihood's misfit: curvature alone does not know a loss. postures: power of the
    prior's density of postures, where it has one, which draws the reported Gaussian, but not the tracking, to what
    people do. second_pass: after the last frame smooth backwards; before that, a likelihood that learns from tracked
    clips (`Refittable`) is filtered by again, and both passes are fused (`pass_fusion`). Else every frame is reported
    as soon as it is filtered. Raises InputError for a prior without Gaussian noise, a likelihood without derivatives
    and numbers out of range.
    """

    traits: ClassVar[Traits] = offering(UNIFORM_WEIGHTS, dataset=START, prior=GAUSSIAN, likelihood=DERIVATIVES)

    prior: Prior
    likelihood: Likelihood
    body: Body
    _: KW_ONLY
    n_particles: int = 500
    sudden: float = 0.05
    flatten: float = 0.05
    widen: float = 1.0
    postures: float = 0.0
    second_pass: bool = True

    finds_start: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check("inference", self, n_particles=at_least(2), flatten=UNIT, sudden=INSIDE_UNIT)
        check("inference", self, widen=POSITIVE, postures=UNIT)

    @property
    def space(self) -> StateSpace:
        """Return the prior's."""
        return self.prior.space

    @property
    def resumable(self) -> bool:
        """Whether it goes on from a `Past`: without a second pass, which needs all frames."""
        return not self.second_pass

    def run(self, frames: Iterable[Frame], start: FloatArray | Past | None, rng_streams: Streams) -> Iterator[Step]:
        """Yield one step per frame, after the last frame where there is a second pass; the first gives the start
        distribution around the pose `start` (P,) or, of several (n, P), around the first; or the steps of the frames
        after a `Past`. Raises InputError without a start, and for a past where there is a second pass."""
        if start is None:
            raise InputError("inference: a Kalman filter needs a pose to start from, found none")
        if not self.second_pass:
            for frame, belief, extra in self._filtered(self.likelihood, frames, start, rng_streams):
                step = self._step(frame, [belief], rng_streams["prior"], extra)
                log_evidence = np.array([step.log_evidence])
                arrays = {"mean": belief.mean, "covariance": belief.covariance, "log_evidence": log_evidence}
                yield replace(step, memory=Memory(arrays, step.expected_pose, streams_now(rng_streams)))
            return
        if isinstance(start, Past):
            raise InputError("inference: a Kalman filter goes on from a frame with second_pass=false alone")
        seen = list(self._filtered(self.likelihood, frames, start, rng_streams))
        frame_likelihoods = [smoothed([belief for _, belief, _ in seen])]
        if isinstance(self.likelihood, Refittable):
            seen = self._again(self.likelihood, seen, frame_likelihoods[0], start, rng_streams)
            frame_likelihoods.append(smoothed([belief for _, belief, _ in seen]))
        for (frame, _, extra), *beliefs in zip(seen, *frame_likelihoods, strict=True):
            yield self._step(frame, beliefs, rng_streams["prior"], extra)

    def _again(
        self, likelihood: Refittable, seen: list[Filtered], beliefs: list[GaussianState], start: FloatArray,
        rng_streams: Streams,
    ) -> list[Filtered]:  # fmt: skip
        """Look at all frames again, knowing more, and where the person was believed to be; each tells what both looks
        took, the first frame the learning."""
        clock, frames = Stopwatch(), [frame for frame, _, _ in seen]
        poses = self.prior.pose(np.stack([belief.mean for belief in beliefs]))
        found = {frame.index: pose for frame, pose in zip(frames, poses, strict=True)}
        refitted = likelihood.refitted(frames[0], found)
        clock.lap("likelihood")
        again = list(self._filtered(refitted, frames, start, rng_streams, found))
        for (_, _, before), (_, _, now) in zip(seen, again, strict=True):
            spent = before["timing_s"], now["timing_s"], clock.laps
            now["timing_s"] = {stage: sum(laps.get(stage, 0.0) for laps in spent) for stage in {**spent[0], **spent[1]}}
            now["evaluations"] += before["evaluations"]
            clock.laps.clear()
        return again

    def _filtered(
        self, likelihood: Likelihood, frames: Iterable[Frame], start: FloatArray | Past, rng_streams: Streams,
        found: Mapping[int, FloatArray] = MappingProxyType({}),
    ) -> Iterator[Filtered]:  # fmt: skip
        """Filter frame by frame; found: poses (P,) of an earlier look, by the frame's index."""
        model, previous, log_evidence, frames = gaussian_of(self.prior), None, 0.0, iter(frames)
        if isinstance(start, Past):
            likelihood, previous = recalled(likelihood, frames, start.expected)
            start.memory.restore(rng_streams)
            size, (log_evidence,) = len(self.space), start.memory.array("log_evidence", 1)
            mean, covariance = start.memory.array("mean", size), start.memory.array("covariance", size, size)
        else:
            mean, covariance = model.start_moments(np.atleast_2d(start)[0])
        belief = GaussianState(mean, covariance, mean, covariance, np.eye(len(mean)), np.ones(len(POSE_NAMES)))
        for frame in frames:
            clock, evaluations = Stopwatch(), 0.0
            frame_likelihood = likelihood.prepare(previous, frame)
            if not isinstance(frame_likelihood, DifferentiableLikelihood):
                name = type(self.likelihood).__name__
                raise InputError(f"inference: a Kalman filter needs a likelihood with {DERIVATIVES}, found {name}")
            if previous is not None or frame_likelihood.informative:
                before = self.prior.pose(belief.mean[None])
                predicted = belief if previous is None else predict(model, belief, frame.time_s - previous.time_s)
                clock.lap("prior")
                leaps = previous is not None  # not from a given start
                belief, peak = self._updated(predicted, frame_likelihood, before, leaps, rng_streams["resampling"])
                if frame.index in found and isinstance(frame_likelihood, DenseLikelihood):
                    weighed = shares(frame_likelihood, self.body.skeleton, self._leaping, peak.pose, found[frame.index])
                    belief = replace(belief, shares=weighed)
                log_evidence, evaluations = log_evidence + peak.log_evidence, float(peak.evaluations)
            likelihood = frame_likelihood.update(self.prior.pose(belief.mean[None])[0])
            clock.lap("likelihood")
            yield frame, belief, {
                "log_evidence": log_evidence, "timing_s": clock.laps, "warnings": tuple(frame_likelihood.notes),
                "diagnostics": frame_likelihood.diagnostics, "evaluations": evaluations,
            }  # fmt: skip
            previous = frame

    def _updated(
        self,
        belief: GaussianState,
        frame_likelihood: DifferentiableLikelihood,
        before: FloatArray,
        leaps: bool,
        rng: np.random.Generator,
    ) -> tuple[GaussianState, Peak]:
        """Take in what a frame shows; the person was in the pose `before` (1, P). leaps: whether a limb may leap."""
        peak = self._climbed(frame_likelihood, belief, belief.mean[: before.shape[1]])
        if isinstance(frame_likelihood, DenseLikelihood):
            if leaps:
                belief, peak = self._leapt(frame_likelihood, belief, peak, before[0], rng)
            peak = self._settled(frame_likelihood, belief, peak)
        doubt = BASE_DOUBT + frame_likelihood.mean_loss(peak.pose)[self.body.skeleton.dof_joints]
        mean, covariance = condition_block(belief.mean, belief.covariance, peak.pose, peak.covariance)
        return replace(belief, mean=mean, covariance=covariance, doubt=doubt), peak

    def _climbed(self, frame_likelihood: DifferentiableLikelihood, belief: GaussianState, start: FloatArray) -> Peak:
        """Climb from a pose (P,) to the peak of a likelihood that knows its derivatives."""
        n = len(start)
        return climb(
            frame_likelihood, belief.mean[:n], belief.covariance[:n, :n], self.body.skeleton.limits, start=start,
            limbs=self._limbs, sudden=self.sudden, flatten=self.flatten,
        )  # fmt: skip

    def _leapt(
        self,
        frame_likelihood: DenseLikelihood,
        belief: GaussianState,
        peak: Peak,
        before: FloatArray,
        rng: np.random.Generator,
    ) -> tuple[GaussianState, Peak]:
        """Look for each arm and leg elsewhere; who leaps is where they are now, at no known speed."""
        skeleton = self.body.skeleton
        for limb in self._leaping:
            found = leap(frame_likelihood, skeleton, limb, peak.pose, before, rng)
            if found is None:
                continue
            released = belief.released(*self._anew(limb, found))
            again = self._climbed(frame_likelihood, released, found)
            if is_better(frame_likelihood, len(skeleton.names), peak.pose, again.pose, limb, before):
                belief, peak = released, again
        return belief, peak

    def _settled(self, frame_likelihood: DenseLikelihood, belief: GaussianState, peak: Peak) -> Peak:
        """Climb on by all pixels of the frame."""
        n, skeleton = len(peak.pose), self.body.skeleton
        prior = tails(belief.mean[:n], belief.covariance[:n, :n], self._limbs, self.sudden)
        pose, slope, count = settle(frame_likelihood, prior, peak.pose, peak.slope, skeleton.limits, self._everything)
        return peak_at(prior, pose, slope, self.flatten, peak.evaluations + count)

    def _anew(self, limb: IntArray, pose: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
        """What is believed of a limb that leapt to where it is in a pose (P,): the columns of its angles and of their
        speeds where the prior has these, what is expected of them, and how far they may be off."""
        names, dofs = list(self.space.names), self.body.skeleton.dof_names
        speeds = [names.index(name) for k in limb if (name := f"{dofs[k]}_velocity") in names]
        columns = np.array([*limb, *speeds], dtype=np.int64)
        expected = np.append(pose[limb], np.zeros(len(speeds)))
        return columns, expected, np.repeat([LEAPT_RAD, LEAPT_RAD_S], [len(limb), len(speeds)])

    @cached_property
    def _everything(self) -> BoolArray:
        """All joints (J,)."""
        return np.ones(len(self.body.skeleton.names), dtype=np.bool_)

    @cached_property
    def _limbs(self) -> IntArray:
        """Which limb each of a pose's numbers (P,) moves: 0 for the root, and one for all that hangs on each of its
        joints."""
        parents, limb = self.body.skeleton.parents, np.zeros(len(self.body.skeleton.parents), dtype=np.int64)
        for joint, parent in enumerate(parents):
            if parent >= 0:
                limb[joint] = limb[parent] if parents[parent] >= 0 else limb.max() + 1
        return np.asarray(limb[self.body.skeleton.dof_joints])

    @cached_property
    def _leaping(self) -> list[IntArray]:
        """The columns of each arm's and each leg's angles."""
        joints, limbs = self.body.skeleton.dof_joints, self._limbs
        columns = [np.flatnonzero(limbs == k) for k in range(1, int(limbs.max()) + 1)]
        return [own for own in columns if len(np.unique(joints[own])) > 1]

    def _step(
        self, frame: Frame, beliefs: Sequence[GaussianState], rng: np.random.Generator, extra: Mapping[str, Any]
    ) -> Step:
        """Return what one look at the clip, or two, made of a frame."""
        belief = beliefs[-1]
        widths = self.widen * np.append(belief.doubt, np.ones(len(belief.mean) - len(belief.doubt)))
        mean, covariance = belief.mean, widths[:, None] * belief.covariance * widths
        if len(beliefs) > 1:
            mean, covariance = of_both(beliefs[0].mean, mean, covariance, belief.shares)
        if self.postures > 0.0 and self.prior.capabilities.postures is not None:
            n = len(belief.doubt)
            drawn = self.prior.capabilities.postures.drawn(mean[:n], covariance[:n, :n], self.postures)
            mean, covariance = condition_block(mean, covariance, *drawn)
        values, vectors = np.linalg.eigh(covariance)
        half = rng.standard_normal((self.n_particles // 2, len(values)))  # in pairs, whose mean is the Gaussian's
        white = np.concatenate([half, -half, np.zeros((self.n_particles % 2, len(values)))])
        state = mean + (white * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
        nearest = int(np.argmin((white**2).sum(axis=1)))
        poses, expected = self.prior.pose(state), self.prior.pose(mean[None])[0]
        return Step(
            frame=frame, space=self.space, particles=state, poses=poses,
            log_weights=even_log_weights(self.n_particles), ancestors=np.arange(self.n_particles),
            expected_pose=expected, map_pose=poses[nearest], ess=float(self.n_particles), **extra,
        )  # fmt: skip
