"""The problem of smooth poses of all frames, which a video's joints, or points, determine within the body's limits.

Joints and all prior knowledge about poses are evaluated by compiled kernels; other observations add residual functions.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from tqdm import tqdm

from workbench.body.centre_of_mass import centre_of_mass
from workbench.body.kinematics import descendants, joint_jacobian, joints, length_jacobian
from workbench.body.skeleton import FOOT_POINTS, JOINT_NAMES, N_ROOT, POSE_NAMES, Skeleton
from workbench.core.losses import LOSSES, SQUARED, Loss
from workbench.core.observations import Observed
from workbench.core.prior import REFERENCE_RATE_HZ, Smoothness
from workbench.core.residual import ResidualFunction, robust
from workbench.inference.least_squares.solver import pose_kernels as kernels
from workbench.inference.least_squares.solver.residuals import (
    BALANCE_M,
    BALANCE_SIGMA_M,
    GROUND_SIGMA_M,
    nominal_pose_prior,
)
from workbench.inference.least_squares.solver.single_frame import inlier_fractions
from workbench.inference.least_squares.solver.sparse_solver import Arrowhead, Factor, Pattern, Quadratic, minimise
from workbench.inference.least_squares.video.foot_contact import ANKLES, DRIFT_M, contact_pairs
from workbench.inference.least_squares.video.landmark_depths import DepthArrays
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

LIMIT_SIGMA_RAD = 0.05
FOLLOW_SIGMA = 0.5
"""m and rad at REFERENCE_RATE_HZ: standard deviation of a pose from the previous one in the sequential fit."""
_FIXED_PRECISION = 1e12
"""Precision, 1/rad², of fixed parameters."""


@dataclass(frozen=True, eq=False)
class KeypointArrays:
    """Keypoints of T frames. first: (T + 1,) index of each frame's first one. joints, cameras: (K,). pixels: (K, 2),
    px. whitening: (K,) inverse standard deviations, 1/px. rows: (C, 23), `Camera.row` of each camera; one that turns
    has a row for each frame. views: (K,) numbers of the cameras by name."""

    first: IntArray
    joints: IntArray
    cameras: IntArray
    pixels: FloatArray
    whitening: FloatArray
    rows: FloatArray
    views: IntArray

    @staticmethod
    def of(observations: Sequence[Observed], whitening: Callable[[FloatArray], FloatArray]) -> "KeypointArrays":
        """Return the keypoints of T frames. whitening: maps weights (M,) to inverse standard deviations (M,), 1/px."""
        views = [view for frame in observations for view in frame.keypoints]
        rows = {id(view.camera): view.camera.row for view in views}
        number, sizes = {camera: k for k, camera in enumerate(rows)}, [len(view.joints) for view in views]
        names = {name: k for k, name in enumerate(dict.fromkeys(view.camera.name for view in views))}
        keypoints = np.concatenate([np.empty((0, 3)), *(view.detections for view in views)])
        ends = np.cumsum([sum(len(view.joints) for view in frame.keypoints) for frame in observations])
        return KeypointArrays(
            first=np.concatenate([[0], ends]).astype(np.int64),
            joints=np.concatenate([np.empty(0, np.int64), *(view.joints for view in views)]),
            cameras=np.repeat(np.array([number[id(view.camera)] for view in views], dtype=np.int64), sizes),
            pixels=np.ascontiguousarray(keypoints[:, :2]),
            whitening=np.ascontiguousarray(whitening(keypoints[:, 2])),
            rows=np.array([*rows.values()]).reshape(-1, 23),
            views=np.repeat(np.array([names[view.camera.name] for view in views], dtype=np.int64), sizes),
        )

    @staticmethod
    def none(n_frames: int) -> "KeypointArrays":
        """Return those of frames without keypoints."""
        return KeypointArrays.of([Observed(np.empty((0, 3)))] * n_frames, lambda weights: weights)

    def select_frames(self, frames: IntArray) -> "KeypointArrays":
        """Return the keypoints of the frames with these indices."""
        indices = [np.arange(self.first[t], self.first[t + 1]) for t in frames]
        k = np.concatenate([np.empty(0, np.int64), *indices])
        first = np.concatenate([[0], np.cumsum([len(frame) for frame in indices])]).astype(np.int64)
        each = self.joints[k], self.cameras[k], self.pixels[k], self.whitening[k]
        return KeypointArrays(first, *each, self.rows, self.views[k])

    def select(self, chosen: BoolArray) -> "KeypointArrays":
        """Return the keypoints that are chosen, (K,)."""
        first = np.concatenate([[0], np.cumsum(chosen)])[self.first]
        return replace(
            self, first=first, joints=self.joints[chosen], cameras=self.cameras[chosen], pixels=self.pixels[chosen],
            whitening=self.whitening[chosen], views=self.views[chosen],
        )  # fmt: skip

    @property
    def arrays(self) -> tuple[IntArray | FloatArray, ...]:
        """Return the arrays in the kernels' order."""
        return self.first, self.joints, self.cameras, self.pixels, self.whitening, self.rows


@dataclass(frozen=True, eq=False)
class PoseProblem:
    """F = Σ_t [Σ_k ρ(r_tk) + limits + pose prior + balance + ground + depths] + foot contacts + smoothness, over the
    poses of T frames.

    Each term is a sum of squares of whitened residuals, or of their robust losses (`core.losses`):

    - the observations r_tk under `loss`: reprojection errors of the joints, and `residual_functions`;
    - limits: angles beyond the skeleton's limits over LIMIT_SIGMA_RAD;
    - pose prior: a Gaussian of the pose;
    - balance: the centre of mass from the line between the ankles; ground: the lower ankle from `ground_m`;
    - depths: bones that are less deep than by their landmarks, see `landmark_depths`;
    - foot contacts: displacements of ankles in contact from one frame to the next;
    - smoothness: second differences of all parameters.

    Parameters
    ----------
    skeleton : that of the poses (T, P).
    keypoints : of T frames.
    times_s : (T,), increasing.
    loss : of the observations.
    smoothness : standard deviations of the second differences.
    foot_contacts : (T, 2) of ANKLES.
    ground_m : height of a standing person's ankles, m; None: unknown.
    pose_prior : means (T, P) and precisions (T, P, P); None: those of `nominal_pose_prior`.
    depths : None: without.
    residual_functions : of observations other than keypoints, one per frame, or none.
    """

    skeleton: Skeleton
    keypoints: KeypointArrays
    times_s: FloatArray
    loss: Loss
    smoothness: Smoothness
    foot_contacts: BoolArray
    ground_m: float | None = None
    pose_prior: tuple[FloatArray, FloatArray] | None = None
    depths: DepthArrays | None = None
    residual_functions: Sequence[ResidualFunction] = ()

    @property
    def n_frames(self) -> int:
        """Return T."""
        return len(self.times_s)

    def select_frames(self, frames: IntArray) -> "PoseProblem":
        """Return the problem of the frames with these indices."""
        keypoints, contacts = self.keypoints.select_frames(frames), self.foot_contacts[frames]
        depths = None if self.depths is None else self.depths.select_frames(frames)
        pose_prior = None if self.pose_prior is None else (self.pose_prior[0][frames], self.pose_prior[1][frames])
        return replace(
            self, keypoints=keypoints, times_s=self.times_s[frames], foot_contacts=contacts, pose_prior=pose_prior,
            depths=depths, residual_functions=[self.residual_functions[t] for t in frames if self.residual_functions],
        )  # fmt: skip

    def expand(self, x: FloatArray) -> Quadratic:
        """Return the cost at poses x (T P,) and its Gauss–Newton model."""
        return self.expand_frames(x.reshape(self.n_frames, -1), 0, self.n_frames)

    def expand_frames(self, poses: FloatArray, first: int, last: int) -> Quadratic:
        """Return the cost and its model in the frames [first, last) at poses (T, P).

        The cost includes the terms of other frames that depend on these.
        """
        n_dofs, begin, end = poses.shape[1], max(first - 1, 0), min(last + 1, self.n_frames)
        evaluation, window = self._evaluate(poses, begin, end), slice(first - begin, last - begin)
        damping_diagonal = np.diagonal(evaluation.blocks[window], axis1=1, axis2=2).ravel()
        cost, gradient = self._smoothness_cost(poses, first, last)
        cells = np.empty(((last - first) * n_dofs, 2 * n_dofs + 1)).T  # column by column, as LAPACK takes it
        band, weights = self._smoothness_band[first:last], self._smoothness_weights
        kernels.fill_band(evaluation.blocks[window], evaluation.couplings[window], band, weights, cells)
        pattern = Pattern(n_band=cells.shape[1], n_border=0, width=2 * n_dofs)
        gradient += evaluation.gradients[window]
        return Quadratic(evaluation.cost + cost, gradient.ravel(), Arrowhead(pattern, cells), damping_diagonal)

    def cost_of_frames(self, poses: FloatArray, first: int, last: int) -> float:
        """Return the cost of `expand_frames`."""
        evaluation = self._evaluate(poses, max(first - 1, 0), min(last + 1, self.n_frames))
        return evaluation.cost + self._smoothness_cost(poses, first, last)[0]

    def fit_sequentially(self, start: FloatArray) -> FloatArray:
        """Return poses (T, P), each fitted near the previous one, the first near `start` (P,)."""
        poses = np.empty((self.n_frames, len(start)))
        poses[0] = start
        gaps = np.diff(self.times_s, prepend=self.times_s[0] - 1.0 / REFERENCE_RATE_HZ)
        precisions = 1.0 / (FOLLOW_SIGMA**2 * REFERENCE_RATE_HZ * gaps)
        if self.residual_functions:
            for t in tqdm(range(self.n_frames), desc="following", unit="frame", disable=None, leave=False):
                poses[t] = self.select_frames(np.array([t]))._fit_near(poses[max(t - 1, 0)], precisions[t])
        else:
            precisions = np.repeat(precisions[:, None], len(start), axis=1)
            kernels.fit_frames(poses, True, precisions, self._terms, 20, 1e-3, np.empty(len(poses)))
        return poses

    def _fit_near(self, centre: FloatArray, precision: float) -> FloatArray:
        """Return the pose (P,) of a single frame, with a quadratic term of this precision about `centre` (P,)."""

        def expand(x: FloatArray) -> Quadratic:
            quadratic, offset = self.expand(x), x - centre
            quadratic.normal.cells[0] += precision
            return replace(
                quadratic, cost=quadratic.cost + 0.5 * precision * float(offset @ offset),
                gradient=quadratic.gradient + precision * offset,
            )  # fmt: skip

        return minimise(expand, centre, max_iterations=20, tolerance=1e-3).x

    def fit_independently(self, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the poses fitted to every frame alone from poses (T, P), and their costs (T,)."""
        fitted, costs = poses.copy(), np.empty(len(poses))
        kernels.fit_frames(fitted, False, np.zeros_like(poses), self._terms, 20, 1e-3, costs)
        return fitted, costs

    def bias_sensitivity(self, factor: Factor, poses: FloatArray, by_length: FloatArray) -> FloatArray:
        """Return the error (T, P, G) of fitted poses (T, P) for one standard deviation of each cause of wrong limb
        lengths.

        H⁻¹ Σ_t Σ_j D_jᵀ M_j L_j with L the joints' Jacobian by the lengths, up to the sign. Deviation: the changes of
        balance and ground height are neglected, because the feet determine the ground.

        Parameters
        ----------
        factor : of the Gauss–Newton matrix H at the poses.
        by_length : (J, 3, G), see `Body.limb_length_std`, m.
        """
        joint_hessians = self.joint_information(poses)
        displacements = length_jacobian(self.skeleton, by_length, poses)
        jacobian = joint_jacobian(self.skeleton, poses)
        right = np.einsum("tjxp,tjxy,tjyg->tpg", jacobian, joint_hessians, displacements, optimize=True)
        return factor.solve(right.reshape(-1, displacements.shape[3])).reshape(right.shape)

    def joint_information(self, poses: FloatArray) -> FloatArray:
        """Return the Gauss–Newton matrices (T, J, 3, 3), 1/m², of the keypoints by the joints' positions."""
        return self._evaluate(poses, 0, self.n_frames).joint_hessians

    def residuals(self, poses: FloatArray) -> FloatArray:
        """Return the whitened residuals (K, 2) of the keypoints at poses (T, P)."""
        residuals = np.empty_like(self.keypoints.pixels)
        kernels.keypoint_residuals(joints(self.skeleton, poses), self.keypoints.arrays, residuals)
        return residuals

    def inliers(self, poses: FloatArray) -> FloatArray:
        """Return the fraction (T,) of the residuals within the loss's scale; NaN in a frame without observations."""
        if self.residual_functions:
            pairs = zip(self.residual_functions, poses, strict=True)
            return inlier_fractions((residual(pose)[0] for residual, pose in pairs), self.loss)
        return inlier_fractions(np.split(self.residuals(poses), self.keypoints.first[1:-1]), self.loss)

    def _evaluate(self, poses: FloatArray, begin: int, end: int) -> "_Evaluation":
        """Return the evaluation of the frames [begin, end) and of the foot contacts between them, at poses (T, P)."""
        evaluation = _Evaluation.of(end - begin, len(self.skeleton.names), poses.shape[1])
        kinematics = (evaluation.positions, evaluation.axes)
        derivatives = (evaluation.gradients, evaluation.blocks)
        window = np.ascontiguousarray(poses[begin:end])
        cost = kernels.expand_frames(window, begin, self._terms, *kinematics, evaluation.joint_hessians, *derivatives)
        pairs = slice(*np.searchsorted(self._contact_pairs[0], [begin, end - 1]))
        frames, ankles, whitening = (array[pairs] for array in self._contact_pairs)
        cost += kernels.add_foot_contacts(
            begin, frames, ankles, whitening, self._terms[0], *kinematics, *derivatives, evaluation.couplings
        )
        return replace(evaluation, cost=cost + self._add_residual_functions(poses, begin, end, *derivatives))

    def _add_residual_functions(
        self, poses: FloatArray, begin: int, end: int, gradients: FloatArray, blocks: FloatArray
    ) -> float:
        """Add the residual functions of the frames [begin, end) at poses (T, P) to their gradients (n, P) and blocks
        (n, P, P); return their cost."""
        cost = 0.0
        for k, residual in enumerate(self.residual_functions[begin:end]):
            values, jacobian = robust(residual, self.loss)(poses[begin + k])
            gradients[k] += jacobian.T @ values
            blocks[k] += jacobian.T @ jacobian
            cost += 0.5 * float(values @ values)
        return cost

    def _smoothness_cost(self, poses: FloatArray, first: int, last: int) -> tuple[float, FloatArray]:
        """Return the cost of the second differences that include the frames [first, last), and its gradient (n, P)."""
        begin, end = max(first - 2, 0), min(last + 2, self.n_frames)
        gradient = np.zeros((end - begin, poses.shape[1]))
        if end - begin < 3:
            return 0.0, gradient[first - begin : last - begin]
        rows = self._second_differences[begin : end - 2]
        differences = sum(rows[:, k, None] * poses[begin + k : end - 2 + k] for k in range(3))
        weighted = differences * self._smoothness_weights
        for k in range(3):
            gradient[k : len(gradient) - 2 + k] += rows[:, k, None] * weighted
        return 0.5 * float((differences * weighted).sum()), gradient[first - begin : last - begin]

    @cached_property
    def _second_differences(self) -> FloatArray:
        """Return the coefficients of the second differences (T − 2, 3), of unit variance; at uneven times the speed is
        a random walk between the midpoints."""
        if self.n_frames < 3:
            return np.zeros((0, 3))
        before, after = (1.0 / np.diff(REFERENCE_RATE_HZ * self.times_s)[k : self.n_frames - 2 + k] for k in range(2))
        walk_std = np.sqrt(0.5 * REFERENCE_RATE_HZ * (self.times_s[2:] - self.times_s[:-2]))
        return np.stack([before, -before - after, after], axis=1) / walk_std[:, None]

    @cached_property
    def _smoothness_band(self) -> FloatArray:
        """Return the products (T, 3) of each frame's coefficients with its own, the next and the one after, summed over
        the second differences."""
        band, (a, b, c) = np.zeros((self.n_frames, 3)), self._second_differences.T
        n = len(a)
        for k, value in enumerate((a, b, c)):
            band[k : n + k, 0] += value**2
        band[:n, 1] += a * b
        band[1 : n + 1, 1] += b * c
        band[:n, 2] = a * c
        return band

    @cached_property
    def _smoothness_weights(self) -> FloatArray:
        """Return the inverse variances (P,) of second differences."""
        deviations = np.array([self.smoothness.of_angle(name) for name in self.skeleton.dof_names])
        deviations[:N_ROOT] = self.smoothness.second_differences[1:]
        return deviations**-2.0

    @cached_property
    def _contact_pairs(self) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the frames (K,) whose foot contacts last to the next frame, the ankles (K,), and the inverse standard
        deviations (K,), 1/m."""
        frames, feet = contact_pairs(self.foot_contacts, self.times_s).T
        ankles = np.array([self.skeleton.joint(name) for name in ANKLES]) if len(frames) else np.zeros(2, np.int64)
        return frames, ankles[feet], 1.0 / (DRIFT_M * np.sqrt(np.diff(self.times_s)[frames]))

    @cached_property
    def _terms(self) -> tuple[Any, ...]:
        """Return the kernels' arguments from `chain` to `stance`."""
        loss = (LOSSES[self.loss.name], float(self.loss.scale))
        depths = (self.depths or DepthArrays.none(self.n_frames)).arrays
        return chain(self.skeleton), self.keypoints.arrays, loss, NO_TARGETS, self._prior, depths, self._stance

    @cached_property
    def _prior(self) -> tuple[FloatArray, ...]:
        if self.pose_prior is not None:
            return limits(self.skeleton, *self.pose_prior)
        mean, precision = self.nominal
        return limits(self.skeleton, mean[None], precision[None])

    @cached_property
    def nominal(self) -> tuple[FloatArray, FloatArray]:
        """Return mean (P,) and precision (P, P) of `nominal_pose_prior`. That of the ankles, which may have no other
        information over many frames, is for frames at REFERENCE_RATE_HZ, and less for more of them."""
        nominal = nominal_pose_prior(self.skeleton)
        precision = nominal.whitening.T @ nominal.whitening
        if self.n_frames > 1 and set(POSE_NAMES) < set(self.skeleton.dof_names):
            feet = slice(len(POSE_NAMES), None)
            precision[feet, feet] *= min(1.0, REFERENCE_RATE_HZ * float(np.median(np.diff(self.times_s))))
        return nominal.mean, precision

    @cached_property
    def _stance(self) -> tuple[FloatArray | IntArray, ...]:
        if not set(JOINT_NAMES) <= set(self.skeleton.names):
            return NO_STANCE
        height = np.nan if self.ground_m is None else self.ground_m
        return (
            centre_of_mass(self.skeleton.names), np.array([self.skeleton.joint(name) for name in ANKLES]),
            np.array([*BALANCE_M, 1.0 / BALANCE_SIGMA_M]), np.array([height, 1.0 / GROUND_SIGMA_M]),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Evaluation:
    """Cost and kernel outputs of n frames, see `pose_kernels`."""

    positions: FloatArray
    axes: FloatArray
    joint_hessians: FloatArray
    gradients: FloatArray
    blocks: FloatArray
    couplings: FloatArray
    cost: float = 0.0

    @staticmethod
    def of(n: int, n_joints: int, n_dofs: int) -> "_Evaluation":
        """Return uninitialised arrays for n frames."""
        return _Evaluation(
            np.empty((n, n_joints, 3)), np.empty((n, n_dofs, 3)), np.empty((n, n_joints, 3, 3)),
            np.empty((n, n_dofs)), np.empty((n, n_dofs, n_dofs)), np.zeros((n, n_dofs, n_dofs)),
        )  # fmt: skip


NO_TARGETS = (np.empty(0, np.int64), np.empty((0, 0, 3)), np.zeros(1))
NO_STANCE = (np.empty(0), np.array([-1, -1]), np.zeros(3), np.zeros(2))


def chain(skeleton: Skeleton) -> tuple[FloatArray | IntArray, ...]:
    """Return the skeleton as arrays for the kernels, see `pose_kernels`."""
    below = descendants(skeleton)[skeleton.dof_joints].T
    below[:, :3] = True
    movers, n_movers = np.zeros(below.shape, dtype=np.int64), below.sum(axis=1)
    for j, moves in enumerate(below):
        movers[j, : n_movers[j]] = np.flatnonzero(moves)
    return skeleton.parents, skeleton.offsets, skeleton.dof_joints, skeleton.dof_axes, movers, n_movers


def limits(skeleton: Skeleton, mean: FloatArray, precision: FloatArray) -> tuple[FloatArray, ...]:
    """Return the limits, and a Gaussian of poses, mean (n, P) and precision (n, P, P), as arrays for the kernels."""
    lower, upper = (np.ascontiguousarray(side) for side in skeleton.limits.T)
    return lower, upper, np.array([LIMIT_SIGMA_RAD**-2.0]), np.ascontiguousarray(mean), np.ascontiguousarray(precision)


def reach_targets(
    skeleton: Skeleton, poses: FloatArray, limb: IntArray, targets: FloatArray, sigma_m: float
) -> FloatArray:
    """Return poses (n, P) whose limb reaches targets, as far as its limits allow.

    Parameters
    ----------
    limb : (3,) its first, middle and last joint; the angles of the first two change.
    targets : (n, 2, 3) of the middle and the last joint, m.
    sigma_m : standard deviation of the distance, m.
    """
    fitted, active = poses.copy(), np.isin(skeleton.dof_joints, limb[:2])
    precisions = np.repeat(np.where(active, 0.0, _FIXED_PRECISION)[None], len(poses), axis=0)
    prior = (np.zeros(poses.shape[1]), np.zeros((poses.shape[1], poses.shape[1])))
    terms = _target_terms(skeleton, np.asarray(limb[1:]), targets, sigma_m, *prior)
    kernels.fit_frames(fitted, False, precisions, terms, 8, 1e-2, np.empty(len(poses)))
    fitted[:, ~active] = poses[:, ~active]
    return fitted


def reach_in_sequence(skeleton: Skeleton, targets: FloatArray, sigma_m: float) -> FloatArray:
    """Return poses (n, P) with the root at the origin whose joints, but for the ends of feet, reach targets (n, J, 3),
    m, as far as their limits allow, each fitted from the previous one. sigma_m: standard deviation of the distance, m,
    against nominal angles."""
    nominal, n_dofs = nominal_pose_prior(skeleton), len(skeleton.dof_names)
    poses = np.zeros((len(targets), n_dofs))
    poses[0, N_ROOT:] = np.clip(0.5, *skeleton.limits[N_ROOT:].T)  # bent, away from singular straight limbs
    precisions = np.where(np.arange(n_dofs) < N_ROOT, _FIXED_PRECISION, 0.0) + np.zeros((len(targets), 1))
    reaching = np.flatnonzero(~np.isin(skeleton.names, FOOT_POINTS))
    gaussian = nominal.mean, nominal.whitening.T @ nominal.whitening
    terms = _target_terms(skeleton, reaching, targets[:, reaching], sigma_m, *gaussian)
    kernels.fit_frames(poses, True, precisions, terms, 20, 1e-3, np.empty(len(poses)))
    return poses


def _target_terms(
    skeleton: Skeleton, reaching: IntArray, targets: FloatArray, sigma_m: float, mean: FloatArray, precision: FloatArray
) -> tuple[Any, ...]:
    """Return the kernels' arguments for joints (A,) with targets (n, A, 3), m, and a Gaussian of poses, mean (P,) and
    precision (P, P), and nothing else."""
    depths, keypoints = DepthArrays.none(len(targets)).arrays, KeypointArrays.none(len(targets)).arrays
    target_terms = (reaching, np.ascontiguousarray(targets), np.array([sigma_m**-2.0]))
    loss, prior = (LOSSES[SQUARED.name], SQUARED.scale), limits(skeleton, mean[None], precision[None])
    return chain(skeleton), keypoints, loss, target_terms, prior, depths, NO_STANCE
