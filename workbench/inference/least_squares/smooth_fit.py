"""The problem of poses that move smoothly and stay within the body's limits, without a motion model."""

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from tqdm import tqdm

from workbench.body.camera import Camera
from workbench.body.kinematics import joints
from workbench.body.skeleton import JOINT_NAMES, N_ROOT, Skeleton
from workbench.core.capabilities import Traits, offering
from workbench.core.observations import Keypoints, Observed, kinds_seen
from workbench.core.pose_prior import Postures
from workbench.core.prior import PACE_HZ, MotionModel
from workbench.core.residual import SQUARED, Loss, ResidualFunction, robust, stacked
from workbench.core.side_information import GROUND_HEIGHT
from workbench.core.state_space import StateSpace
from workbench.inference.least_squares.all_frames import FitProblem, fit_motion, misled, second_differences
from workbench.inference.least_squares.foot_contact import standing_feet, standing_height, ties_of_feet
from workbench.inference.least_squares.hypotheses import first_keypoints, first_pose, likely_poses
from workbench.inference.least_squares.residuals import (
    balance_residual,
    ground_residual,
    joint_residual,
    limit_residual,
    posture_prior,
    posture_residual,
    usual_residual,
    views_residual,
)
from workbench.inference.least_squares.single_frame import FitData, GaussianPrior, PoseDecoder, fit_frame
from workbench.inference.least_squares.solver import Minimum
from workbench.inference.least_squares.systematic_errors import Lengths
from workbench.inference.least_squares.task import Fit, Task, fit_of
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.timing import working_s

log = logging.getLogger(__name__)

LIMIT_SIGMA_RAD = 0.05
FOLLOW_SIGMA = 0.5
"""m and rad at PACE_HZ: how far from the frame before a pose is looked for at first."""
FAR_LOSS = Loss("huber", 3.0)
BALANCE_LOSS = Loss("huber", 1.0)
"""Balance is a habit: who jumps or leans on something is out of it by more than its deviation says."""
GROUND_LOSS = Loss("huber", 2.0)
"""People jump, and there are steps."""
LEANING_SIGMA_RAD = np.inf
"""Deviation of pitch and roll beside what is usual, which says it all."""
FLIP_ROUNDS, HOPELESS, FLIP_GAIN = 2, 2.0, 0.5
"""Flips are tried one by one, in rounds until none helps; not those that at first cost HOPELESS times as much; those
that gain less than FLIP_GAIN nats are not taken."""
LIMBS = tuple(
    (f"{side}_{upper}", f"{side}_{middle}", f"{side}_{lower}")
    for side in ("left", "right")
    for upper, middle, lower in (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle"))
)
LEAST_FRAMES = 3
"""A stretch of fewer is left to the fit, which gets there by itself."""
FLIP_SIGMA_M = 0.03
"""How near the joints of a limb come to where the flip has them, against the body's limits."""
POSTURES, POSTURE_ROUNDS = 0.2, 2
"""Power of the density of postures, below 1 as neighbouring frames say the same, chosen on clips.half=choose of
experiment=strangers by detected joints; how often poses are drawn to it and are then of its other parts."""
N_HYPOTHESES = 3
"""Poses of the first frame that are followed: one camera does not tell forwards from backwards."""


@dataclass(frozen=True)
class SmoothFit:
    """Fit smooth poses to all frames at once, see `fit_smooth`. ground_m: height of a standing person's ankles in the
    world, m, to which the lower foot is tied; None: where one camera sees feet that stand, they tell it themselves."""

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare the height of the ground, where it is given."""
        return offering(given=() if keys.get("ground_m") is None else (GROUND_HEIGHT,))

    ground_m: float | None = None

    def space(self, skeleton: Skeleton, motion: MotionModel | None) -> StateSpace:
        """Name the pose's parameters."""
        return PoseDecoder(skeleton).space

    def fit(self, task: Task, start: FloatArray | None) -> Fit:
        """Fit all frames at once; `start` as for `LeastSquares.run`."""
        clock, data, skeleton = working_s(), task.data(LEANING_SIGMA_RAD), task.skeleton
        doubt = task.length_doubt if kinds_seen(task.seen) == ("keypoints",) else None
        poses, covariances, search = fit_smooth(
            skeleton, task.seen, data, _starts(task, start), task.max_iterations, self.ground_m, task.postures, doubt
        )
        fit = fit_of(PoseDecoder(skeleton), data, poses, covariances, search.iterations, search.costs)
        return replace(fit, timing_s={"least_squares": working_s() - clock})


def _starts(task: Task, start: FloatArray | None) -> FloatArray:
    """Return poses (n, P) of the first frame to start from."""
    if start is not None:
        return start[None]
    if keypoints := first_keypoints(task.seen):
        return first_poses(task.skeleton, keypoints, task.sigma_px)
    return first_pose(task, None)[None]


def fit_smooth(
    skeleton: Skeleton, seen: Sequence[Observed], data: FitData, starts: FloatArray, max_iterations: int,
    ground_m: float | None = None, postures: Postures | None = None, doubt: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray, Minimum]:  # fmt: skip
    """Fit poses (T, P) to what is seen of T frames; returns them, their marginal covariances (T, P, P), and the search.

    Minimises Σ_t Σ_k ρ(r_tk) + limits + what is usual, see `bounded`, + the smoothness's second differences (paper A,
    section 6.1). It starts from poses (n, P) in the first frame, of which the best over all frames wins, and follows
    them frame by frame at 1 / PACE_HZ, at first with a loss that sees any distance. Standing feet keep their place, see
    `standing`. With one camera, limbs are turned over in depth, see `flips`, and standing feet brought to one floor, at
    their median height unless ground_m is known. Where the density of postures is known, it replaces each angle's usual
    values at last. doubt (J, 3, G): by how much the skeleton's offsets may be off; the covariances contain it."""
    stand = standing_feet(skeleton, seen, data.times_s)
    decoder, data = PoseDecoder(skeleton), replace(data, stand=stand)
    cameras = {keypoints.camera.name: keypoints.camera for frame in seen for keypoints in frame.keypoints}
    alone = next(iter(cameras.values())) if len(cameras) == 1 and "points" not in kinds_seen(seen) else None
    far = replace(data, loss=FAR_LOSS).spaced(bool(kinds_seen([frame])) for frame in seen)
    poses = _searched(decoder, bounded(skeleton, far, ground_m), starts, alone, max_iterations)
    if len(poses) > 1:
        poses = np.asarray(scipy.interpolate.make_interp_spline(far.times_s, poses, k=1)(data.times_s))
    else:
        poses = poses[[0] * len(data.times_s)]
    problem = smooth_problem(decoder, bounded(skeleton, data, ground_m))
    fitted = fit_motion(problem, poses, max_iterations=max_iterations)
    if alone is not None and ground_m is None and stand.any():
        ground_m = standing_height(skeleton, fitted[0], stand)
        log.info("the feet stand at %.2f m, as the person's size tells", ground_m)
        problem = smooth_problem(decoder, bounded(skeleton, data, ground_m))
        fitted = fit_motion(problem, fitted[0], max_iterations=max_iterations)
    told = fitted if postures is None else _drawn(decoder, data, ground_m, fitted, postures, max_iterations)
    if doubt is None:
        return told
    missed = misled(problem, fitted[2], Lengths(skeleton, seen, doubt))
    return told[0], told[1] + missed @ missed.swapaxes(1, 2), told[2]


def _drawn(
    decoder: PoseDecoder, data: FitData, ground_m: float | None, fitted: tuple[FloatArray, FloatArray, Minimum],
    postures: Postures, max_iterations: int,
) -> tuple[FloatArray, FloatArray, Minimum]:  # fmt: skip
    """Draw what is fitted to postures, in POSTURE_ROUNDS of expectation and maximisation.

    Deviation: the covariances are those before that, as postures of neighbouring frames say the same and would narrow
    each of them, and d dᵀ / 2, d being how far a pose was drawn: what is found without and with postures are two
    samples of what may be found.
    """
    before, covariances, search = fitted
    poses = before
    for _ in range(POSTURE_ROUNDS):
        usual = [posture_residual(postures, *each, POSTURES) for each in zip(poses, covariances, strict=True)]
        problem = smooth_problem(decoder, bounded(decoder.skeleton, data, ground_m, usual))
        poses, _, search = fit_motion(problem, poses, max_iterations=max_iterations)
    apart = poses - before
    return poses, covariances + 0.5 * apart[:, :, None] * apart[:, None, :], search


def _searched(
    decoder: PoseDecoder, data: FitData, starts: FloatArray, alone: Camera | None, max_iterations: int
) -> FloatArray:
    """Find poses (T, P) from the likeliest of `starts` (n, P), turned over where one camera, `alone`, sees all."""
    poses, cost = candidates(decoder, data, starts, max_iterations)[0]
    if alone is None:
        return poses
    return _turned_over(smooth_problem(decoder, data), decoder.skeleton, alone, poses, cost)


def candidates(
    decoder: PoseDecoder, data: FitData, starts: FloatArray, max_iterations: int
) -> list[tuple[FloatArray, float]]:
    """Fit poses (T, P) from each of the poses `starts` (n, P); returns them with their costs, the likeliest first."""
    problem, fits = smooth_problem(decoder, data), []
    for start in starts:
        followed = _follow(decoder, data, start)
        poses, _, minimum = fit_motion(problem, followed, max_iterations=max_iterations, tolerance=1e-3)
        fits.append((poses, minimum.costs[-1]))
    return sorted(fits, key=lambda fit: fit[1])


def bounded(
    skeleton: Skeleton, data: FitData, ground_m: float | None = None, usual: Sequence[ResidualFunction] = ()
) -> FitData:  # fmt: skip
    """Add to what is seen, under its loss, what no loss forgives, limits and how people hold themselves: usual angles
    or, frame by frame, what `usual` says of these; balance; and where ground_m, the height of a standing person's
    ankles, is known, one foot near the ground."""
    limits, own = limit_residual(skeleton, LIMIT_SIGMA_RAD), []
    if set(JOINT_NAMES) <= set(skeleton.names):
        own += [robust(balance_residual(skeleton), BALANCE_LOSS)]
        own += [robust(ground_residual(skeleton, ground_m), GROUND_LOSS)] if ground_m is not None else []
    usual = usual or [usual_residual(skeleton)] * len(data.residuals)
    both = zip(data.residuals, usual, strict=True)
    residuals = [stacked([robust(residual, data.loss), limits, angles, *own]) for residual, angles in both]
    return replace(data, residuals=residuals, loss=SQUARED)


def first_poses(skeleton: Skeleton, seen: Sequence[Keypoints], sigma_px: float) -> FloatArray:
    """Return poses (n ≤ N_HYPOTHESES, P) within limits that one frame of keypoints allows."""
    residual = views_residual(skeleton, seen, sigma_px, LEANING_SIGMA_RAD)
    within = stacked([residual, limit_residual(skeleton, LIMIT_SIGMA_RAD)])
    return likely_poses(skeleton, seen, within, posture_prior(skeleton), N_HYPOTHESES)


def smooth_problem(decoder: PoseDecoder, data: FitData) -> FitProblem:
    """Pose the problem of T frames in which every one has a pose of its own."""
    n_frames, n_dofs, smoothness = len(data.residuals), len(decoder.space), data.smoothness
    columns = np.arange(n_frames * n_dofs).reshape(n_frames, n_dofs)
    deviations = np.array([*smoothness.second_differences[1:], *[smoothness.angle] * (n_dofs - N_ROOT)])
    rows = second_differences(columns, PACE_HZ * data.times_s, deviations)
    none = [(columns[0, :1], np.zeros(1))]  # one or two frames have no second differences
    ties = [] if data.stand is None else ties_of_feet(decoder.skeleton, data.stand, data.times_s)
    return FitProblem.of(decoder, data, columns, rows or none, n_border=0, ties=ties)


def _follow(decoder: PoseDecoder, data: FitData, start: FloatArray) -> FloatArray:
    """Fit poses (T, P), each near the one before."""
    poses, gaps = [start], np.diff(data.times_s, prepend=data.times_s[0] - 1.0 / PACE_HZ)
    for t in tqdm(range(len(gaps)), desc="following", unit="frame", disable=None, leave=False):
        prior = GaussianPrior.independent(poses[-1], np.full(len(start), FOLLOW_SIGMA * np.sqrt(PACE_HZ * gaps[t])))
        poses.append(fit_frame(decoder, data.residuals[t], data.loss, poses[-1], prior=prior).x)
    return np.array(poses[1:])


def _turned_over(problem: FitProblem, skeleton: Skeleton, camera: Camera, poses: FloatArray, cost: float) -> FloatArray:
    """Return the poses (T, P), or such with limbs turned over in depth that fit better."""
    for _ in range(FLIP_ROUNDS):
        before = cost
        for guess in tqdm(list(flips(skeleton, camera, poses)), desc="flips", disable=None, leave=False):
            if problem.expand(problem.unknowns(guess)).cost > HOPELESS * cost:
                continue
            turned, _, minimum = fit_motion(problem, guess, max_iterations=12, tolerance=1e-3)
            if minimum.costs[-1] < cost - FLIP_GAIN:
                poses, cost = turned, minimum.costs[-1]
        if cost == before:
            break
    return poses


def flips(skeleton: Skeleton, camera: Camera, poses: FloatArray) -> Iterator[FloatArray]:
    """Yield motions (T, P) that differ from `poses` (T, P) in one limb's lower part, turned over in depth (Sminchisescu
    & Triggs, Kinematic Jump Processes for Monocular 3D Human Tracking, CVPR 2003): in all frames, or between two times
    at which it lies across the view."""
    places = joints(skeleton, poses)
    for names in LIMBS:
        if not set(names) <= set(skeleton.names):
            continue
        limb = np.array([skeleton.joint(name) for name in names])
        rays = places[:, limb[1]] - camera.position
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        away = ((places[:, limb[2]] - places[:, limb[1]]) * rays).sum(axis=1)
        stretches = np.split(np.arange(len(poses)), np.flatnonzero(np.diff(np.sign(away))) + 1)
        for frames in [np.arange(len(poses))] * (len(stretches) > 1) + stretches:
            if len(frames) >= LEAST_FRAMES:
                aims = places[:, limb[1:]].copy()
                aims[:, 1] -= 2.0 * away[:, None] * rays
                yield _reaching(skeleton, poses, frames, limb, aims)


def _reaching(skeleton: Skeleton, poses: FloatArray, frames: IntArray, limb: IntArray, aims: FloatArray) -> FloatArray:
    """Bring a limb's middle and end near aims (T, 2, 3) in some frames of poses (T, P), as far as its limits allow."""
    reached, decoder = poses.copy(), PoseDecoder(skeleton)
    own = np.flatnonzero(np.isin(skeleton.dof_joints, limb[:2]))
    for t in frames:
        aim = joint_residual(skeleton, limb[1:], aims[t], FLIP_SIGMA_M)
        near = stacked([aim, limit_residual(skeleton, LIMIT_SIGMA_RAD)])
        reached[t] = fit_frame(decoder, near, SQUARED, poses[t], free=own, max_iterations=8, tolerance=1e-2).x
    return reached
