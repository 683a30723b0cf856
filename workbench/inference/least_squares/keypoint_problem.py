"""All frames' poses from 2-D joints under a smoothness prior, evaluated by one kernel: the fit of a video.

It is the problem of `smooth_fit.smooth_problem` for frames of which nothing but keypoints is seen.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from workbench.body.kinematics import descendants, joint_jacobian, joints, length_jacobian
from workbench.body.skeleton import JOINT_NAMES, N_ROOT, Skeleton
from workbench.core.observations import Observed
from workbench.core.prior import REFERENCE_RATE_HZ, Smoothness
from workbench.core.residual import Loss
from workbench.inference.least_squares import pose_kernels as kernels
from workbench.inference.least_squares.foot_contact import ANKLES, DRIFT_LOSS, DRIFT_M
from workbench.inference.least_squares.residuals import (
    BALANCE_M,
    BALANCE_SIGMA_M,
    GROUND_SIGMA_M,
    centre_of_mass,
    posture_prior,
)
from workbench.inference.least_squares.solver import Arrowhead, Factor, Pattern, Quadratic
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

LIMIT_SIGMA_RAD = 0.05
FOLLOW_SIGMA = 0.5
"""m and rad at PACE_HZ: how far from the frame before a pose is looked for at first."""
_LOSSES = {"squared": kernels.SQUARED, "huber": kernels.HUBER, "geman_mcclure": kernels.GEMAN_MCCLURE}
_HELD = 1e12
"""One over the variance, 1/rad², of what is not free."""


@dataclass(frozen=True, eq=False)
class KeypointArrays:
    """Keypoints of T frames. first: (T + 1,) the first of each frame. joints, cameras: (K,). pixels: (K, 2), px.
    whitening: (K,) one over deviations, 1/px. rows: (C, 23), `Camera.row` of each camera."""

    first: IntArray
    joints: IntArray
    cameras: IntArray
    pixels: FloatArray
    whitening: FloatArray
    rows: FloatArray

    @staticmethod
    def of(seen: Sequence[Observed], whitening: Callable[[FloatArray], FloatArray]) -> "KeypointArrays":
        """Gather the keypoints of T frames. whitening: takes weights (M,) to one over deviations (M,), 1/px."""
        views = [view for frame in seen for view in frame.keypoints]
        rows = {id(view.camera): view.camera.row for view in views}
        number, sizes = {camera: k for k, camera in enumerate(rows)}, [len(view.joints) for view in views]
        marks = np.concatenate([np.empty((0, 3)), *(view.marks for view in views)])
        ends = np.cumsum([sum(len(view.joints) for view in frame.keypoints) for frame in seen])
        return KeypointArrays(
            first=np.concatenate([[0], ends]).astype(np.int64),
            joints=np.concatenate([np.empty(0, np.int64), *(view.joints for view in views)]),
            cameras=np.repeat(np.array([number[id(view.camera)] for view in views], dtype=np.int64), sizes),
            pixels=np.ascontiguousarray(marks[:, :2]),
            whitening=np.ascontiguousarray(whitening(marks[:, 2])),
            rows=np.array([*rows.values()]).reshape(-1, 23),
        )

    def some(self, frames: IntArray) -> "KeypointArrays":
        """Return the keypoints of the frames of these indices."""
        own = [np.arange(self.first[t], self.first[t + 1]) for t in frames]
        k = np.concatenate([np.empty(0, np.int64), *own])
        first = np.concatenate([[0], np.cumsum([len(each) for each in own])]).astype(np.int64)
        return KeypointArrays(first, self.joints[k], self.cameras[k], self.pixels[k], self.whitening[k], self.rows)

    @property
    def arrays(self) -> tuple[IntArray | FloatArray, ...]:
        """Return what kernels take."""
        return self.first, self.joints, self.cameras, self.pixels, self.whitening, self.rows


@dataclass(frozen=True, eq=False)
class KeypointProblem:
    """F = Σ_t Σ_k ρ(r_tk) + limits + habits + smoothness over the poses of T frames, see `smooth_fit.bounded`.

    marks: keypoints, under `loss`. times_s: (T,), rising. stand: (T, 2) which ankles stand. ground_m: height of a
    standing person's ankles, m, None where it is not known. usual: means (T, P) and precisions (T, P, P) of the
    postures that poses are drawn to, None for each angle's usual values.
    """

    skeleton: Skeleton
    marks: KeypointArrays
    times_s: FloatArray
    loss: Loss
    smoothness: Smoothness
    stand: BoolArray
    ground_m: float | None = None
    usual: tuple[FloatArray, FloatArray] | None = None

    @property
    def n_frames(self) -> int:
        """Return T."""
        return len(self.times_s)

    def some(self, frames: IntArray) -> "KeypointProblem":
        """Return the problem of the frames of these indices."""
        return replace(self, marks=self.marks.some(frames), times_s=self.times_s[frames], stand=self.stand[frames])

    def expand(self, x: FloatArray) -> Quadratic:
        """Return the cost at poses x (T P,) and its Gauss–Newton model."""
        return self.expand_frames(x.reshape(self.n_frames, -1), 0, self.n_frames)

    def expand_frames(self, poses: FloatArray, first: int, last: int) -> Quadratic:
        """Return the cost, and its model in the frames from `first` to before `last`, at poses (T, P).

        Of the other frames it has what changes with these.
        """
        n_dofs, low, high = poses.shape[1], max(first - 1, 0), min(last + 1, self.n_frames)
        here, own = self._evaluated(poses, low, high), slice(first - low, last - low)
        trust = np.diagonal(here.blocks[own], axis1=1, axis2=2).ravel()
        bent, pull = self._bent(poses, first, last)
        cells = np.empty(((last - first) * n_dofs, 2 * n_dofs + 1)).T  # column by column, as LAPACK takes it
        kernels.fill_band(here.blocks[own], here.between[own], self._bends[first:last], self._weights, cells)
        pattern = Pattern(n_band=cells.shape[1], n_border=0, width=2 * n_dofs)
        return Quadratic(here.cost + bent, (here.gradients[own] + pull).ravel(), Arrowhead(pattern, cells), trust)

    def cost_of_frames(self, poses: FloatArray, first: int, last: int) -> float:
        """Return the cost as `expand_frames` does."""
        here = self._evaluated(poses, max(first - 1, 0), min(last + 1, self.n_frames))
        return here.cost + self._bent(poses, first, last)[0]

    def followed(self, start: FloatArray) -> FloatArray:
        """Return poses (T, P), each fitted near the one before, the first near `start` (P,)."""
        poses = np.empty((self.n_frames, len(start)))
        poses[0] = start
        gaps = np.diff(self.times_s, prepend=self.times_s[0] - 1.0 / REFERENCE_RATE_HZ)
        pulls = np.repeat(1.0 / (FOLLOW_SIGMA**2 * REFERENCE_RATE_HZ * gaps)[:, None], len(start), axis=1)
        kernels.fit_frames(poses, True, pulls, self._terms, 20, 1e-3, np.empty(len(poses)))
        return poses

    def each(self, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Fit every frame by itself from poses (T, P); returns poses and costs (T,)."""
        fitted, costs = poses.copy(), np.empty(len(poses))
        kernels.fit_frames(fitted, False, np.zeros_like(poses), self._terms, 20, 1e-3, costs)
        return fitted, costs

    def misled(self, factor: Factor, poses: FloatArray, by_length: FloatArray) -> FloatArray:
        """Return how far fitted poses (T, P) are off, (T, P, G), for one deviation of each cause of wrong limb lengths.

        H⁻¹ Σ_t Σ_j D_jᵀ M_j L_j with L the joints' derivative by the lengths; up to the sign. Deviation: balance and
        the height of the floor shift, too, which is left out: the feet give the floor.

        Parameters
        ----------
        factor
            Of the Gauss–Newton matrix H at the poses.
        by_length : (J, 3, G) array
            See `Body.limb_length_std`, m.
        """
        stiffness = self._evaluated(poses, 0, self.n_frames).stiffness
        moved = length_jacobian(self.skeleton, by_length, poses)
        right = np.einsum("tjxp,tjxy,tjyg->tpg", joint_jacobian(self.skeleton, poses), stiffness, moved, optimize=True)
        return factor.solve(right.reshape(-1, moved.shape[3])).reshape(right.shape)

    def inliers(self, poses: FloatArray) -> FloatArray:
        """Return the part (T,) of the residuals within the loss's scale; NaN in a frame without keypoints."""
        misses = np.empty_like(self.marks.pixels)
        kernels.keypoint_misses(joints(self.skeleton, poses), self.marks.arrays, misses)
        near, sizes = (np.abs(misses) < self.loss.scale).mean(axis=1), np.diff(self.marks.first)
        hits = np.bincount(np.repeat(np.arange(len(sizes)), sizes), near, minlength=len(sizes))
        return np.divide(hits, sizes, out=np.full(len(sizes), np.nan), where=sizes > 0)

    def _evaluated(self, poses: FloatArray, low: int, high: int) -> "_Evaluation":
        """Evaluate the frames from `low` to before `high` and the ties between them, of poses (T, P)."""
        here = _Evaluation.of(high - low, len(self.skeleton.names), poses.shape[1])
        places = (here.positions, here.axes)
        derivatives = (here.gradients, here.blocks)
        own = np.ascontiguousarray(poses[low:high])
        cost = kernels.expand_frames(own, low, self._terms, *places, here.stiffness, *derivatives)
        ties = slice(*np.searchsorted(self._ties[0], [low, high - 1]))
        frames, ankles, whitening = (each[ties] for each in self._ties)
        cost += kernels.add_ties(
            low, frames, ankles, whitening, DRIFT_LOSS.scale, self._terms[0], *places, *derivatives, here.between
        )
        return replace(here, cost=cost)

    def _bent(self, poses: FloatArray, first: int, last: int) -> tuple[float, FloatArray]:
        """Return the cost of the second differences that the frames from `first` to before `last` are in, and its
        derivative by these frames (n, P)."""
        low, high = max(first - 2, 0), min(last + 2, self.n_frames)
        pull = np.zeros((high - low, poses.shape[1]))
        if high - low < 3:
            return 0.0, pull[first - low : last - low]
        rows = self._rows[low : high - 2]
        rough = sum(rows[:, k, None] * poses[low + k : high - 2 + k] for k in range(3))
        weighted = rough * self._weights
        for k in range(3):
            pull[k : len(pull) - 2 + k] += rows[:, k, None] * weighted
        return 0.5 * float((rough * weighted).sum()), pull[first - low : last - low]

    @cached_property
    def _rows(self) -> FloatArray:
        """The second differences (T − 2, 3), see `motion.second_differences`."""
        if self.n_frames < 3:
            return np.zeros((0, 3))
        before, after = (1.0 / np.diff(REFERENCE_RATE_HZ * self.times_s)[k : self.n_frames - 2 + k] for k in range(2))
        walked = np.sqrt(0.5 * REFERENCE_RATE_HZ * (self.times_s[2:] - self.times_s[:-2]))
        return np.stack([before, -before - after, after], axis=1) / walked[:, None]

    @cached_property
    def _bends(self) -> FloatArray:
        """How each frame meets itself, the next and the one after in the second differences, (T, 3)."""
        bends, (a, b, c) = np.zeros((self.n_frames, 3)), self._rows.T
        n = len(a)
        for k, value in enumerate((a, b, c)):
            bends[k : n + k, 0] += value**2
        bends[:n, 1] += a * b
        bends[1 : n + 1, 1] += b * c
        bends[:n, 2] = a * c
        return bends

    @cached_property
    def _weights(self) -> FloatArray:
        """One over the variances (P,) of second differences."""
        deviations = np.full(len(self.skeleton.dof_names), self.smoothness.angle)
        deviations[:N_ROOT] = self.smoothness.second_differences[1:]
        return deviations**-2.0

    @cached_property
    def _ties(self) -> tuple[IntArray, IntArray, FloatArray]:
        """Frames (K,) from which an ankle stands to the next, ankles (K,), and one over deviations (K,), 1/m."""
        frames, feet = np.argwhere(self.stand[:-1] & self.stand[1:]).T
        ankles = np.array([self.skeleton.joint(name) for name in ANKLES]) if len(frames) else np.zeros(2, np.int64)
        return frames, ankles[feet], 1.0 / (DRIFT_M * np.sqrt(np.diff(self.times_s)[frames]))

    @cached_property
    def _terms(self) -> tuple[Any, ...]:
        """What kernels take from `chain` to `stance`."""
        loss = (_LOSSES[self.loss.name], float(self.loss.scale))
        return chain(self.skeleton), self.marks.arrays, loss, NO_AIMS, self._prior, self._stance

    @cached_property
    def _prior(self) -> tuple[FloatArray, ...]:
        if self.usual is not None:
            return limits(self.skeleton, *self.usual)
        usual = posture_prior(self.skeleton)
        return limits(self.skeleton, usual.mean[None], (usual.whitening.T @ usual.whitening)[None])

    @cached_property
    def _stance(self) -> tuple[FloatArray | IntArray, ...]:
        if not set(JOINT_NAMES) <= set(self.skeleton.names):
            return NO_STANCE
        height = np.nan if self.ground_m is None else self.ground_m
        return (
            centre_of_mass(self.skeleton), np.array([self.skeleton.joint(name) for name in ANKLES]),
            np.array([*BALANCE_M, 1.0 / BALANCE_SIGMA_M]), np.array([height, 1.0 / GROUND_SIGMA_M]),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Evaluation:
    """What kernels write of n frames, see `pose_kernels`, and the cost."""

    positions: FloatArray
    axes: FloatArray
    stiffness: FloatArray
    gradients: FloatArray
    blocks: FloatArray
    between: FloatArray
    cost: float = 0.0

    @staticmethod
    def of(n: int, n_joints: int, n_dofs: int) -> "_Evaluation":
        """Make room for n frames."""
        return _Evaluation(
            np.empty((n, n_joints, 3)), np.empty((n, n_dofs, 3)), np.empty((n, n_joints, 3, 3)),
            np.empty((n, n_dofs)), np.empty((n, n_dofs, n_dofs)), np.zeros((n, n_dofs, n_dofs)),
        )  # fmt: skip


NO_AIMS = (np.empty(0, np.int64), np.empty((0, 0, 3)), np.zeros(1))
NO_STANCE = (np.empty(0), np.array([-1, -1]), np.zeros(3), np.zeros(2))


def chain(skeleton: Skeleton) -> tuple[FloatArray | IntArray, ...]:
    """Return the skeleton as kernels take it, see `pose_kernels`."""
    below = descendants(skeleton)[skeleton.dof_joints].T
    below[:, :3] = True
    movers, n_movers = np.zeros(below.shape, dtype=np.int64), below.sum(axis=1)
    for j, own in enumerate(below):
        movers[j, : n_movers[j]] = np.flatnonzero(own)
    return skeleton.parents, skeleton.offsets, skeleton.dof_joints, skeleton.dof_axes, movers, n_movers


def limits(skeleton: Skeleton, mean: FloatArray, precision: FloatArray) -> tuple[FloatArray, ...]:
    """Return the limits, and a Gaussian of poses, mean (n, P) and precision (n, P, P), as kernels take them."""
    low, high = (np.ascontiguousarray(side) for side in skeleton.limits.T)
    return low, high, np.array([LIMIT_SIGMA_RAD**-2.0]), np.ascontiguousarray(mean), np.ascontiguousarray(precision)


def reaching(skeleton: Skeleton, poses: FloatArray, limb: IntArray, aims: FloatArray, sigma_m: float) -> FloatArray:
    """Return poses (n, P) whose limb reaches for aims, as far as its limits allow.

    Parameters
    ----------
    limb : (3,) array
        Its first, middle and last joint; the first two's angles move.
    aims : (n, 2, 3) array
        Of the middle and the last joint, m.
    sigma_m
        How near they come, against the limits.
    """
    n_dofs, reached = poses.shape[1], poses.copy()
    own = np.isin(skeleton.dof_joints, limb[:2])
    marks = KeypointArrays.of([Observed(np.empty((0, 3)))] * len(poses), lambda weights: weights)
    pulls = np.repeat(np.where(own, 0.0, _HELD)[None], len(poses), axis=0)
    targets = (np.asarray(limb[1:]), np.ascontiguousarray(aims), np.array([sigma_m**-2.0]))
    prior = limits(skeleton, np.zeros((1, n_dofs)), np.zeros((1, n_dofs, n_dofs)))
    terms = (chain(skeleton), marks.arrays, (kernels.SQUARED, 1.0), targets, prior, NO_STANCE)
    kernels.fit_frames(reached, False, pulls, terms, 8, 1e-2, np.empty(len(poses)))
    reached[:, ~own] = poses[:, ~own]
    return reached
