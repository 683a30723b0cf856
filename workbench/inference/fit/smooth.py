"""Poses of all frames at once that move smoothly and stay within the body's limits: least squares without a motion
model, where what is seen of every frame alone does not tell its pose, as by one camera."""

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import make_interp_spline
from tqdm import tqdm

from workbench.arrays import BoolArray, FloatArray, IntArray
from workbench.body.camera import Camera
from workbench.body.skeleton import JOINT_NAMES, N_ROOT, Skeleton
from workbench.core.observations import Keypoints
from workbench.core.residual import Loss, ResidualFunction, robust, stacked
from workbench.core.smoothness import PACE_HZ, Smoothness
from workbench.inference.fit.decoding import PoseDecoder
from workbench.inference.fit.flips import flips
from workbench.inference.fit.frame import Gaussian, fit_frame
from workbench.inference.fit.hypotheses import likely_poses
from workbench.inference.fit.motion import FitProblem, fit_motion, second_differences
from workbench.inference.fit.pose_prior import balance_residual, ground_residual, usual_poses, usual_residual
from workbench.inference.fit.residuals import limit_residual, views_residual
from workbench.inference.fit.solver import Minimum

LIMIT_SIGMA_RAD = 0.05
FOLLOW_SIGMA = 0.5
"""m and rad at PACE_HZ: how far from the frame before a pose is looked for at first."""
SQUARED = Loss("squared", 1.0)
FAR_LOSS = Loss("huber", 3.0)
BALANCE_LOSS = Loss("huber", 1.0)
"""Balance is a habit: who jumps or leans on something is out of it by more than its deviation says."""
LEANING_SIGMA_RAD = np.inf
"""Deviation of pitch and roll beside what is usual, which says it all."""
FLIP_ROUNDS, HOPELESS, FLIP_GAIN = 2, 2.0, 0.5
"""Flips are tried one by one, in rounds until none helps; not those that at first cost HOPELESS times as much; those
that gain less than FLIP_GAIN nats are not taken."""
N_HYPOTHESES = 3
"""Poses of the first frame that are followed: one camera does not tell forwards from backwards."""


def fit_smooth(
    skeleton: Skeleton,
    residuals: Sequence[ResidualFunction],
    times_s: FloatArray,
    loss: Loss,
    starts: FloatArray,
    smoothness: Smoothness,
    max_iterations: int,
    shown: Sequence[bool] | None = None,
    camera: Camera | None = None,
    ground_m: float | None = None,
) -> tuple[FloatArray, FloatArray, Minimum]:
    """Poses (T, P) with their marginal covariances (T, P, P), and the search.

    Minimises Σ_t Σ_k ρ(r_tk) + limits + what is usual, see `bounded`, + the smoothness's second differences, which is
    the smooth prior of paper A (section 6.1) over all frames at once. It starts from poses (n, P) in the first
    frame, of which the one wins that all frames together like best, and what is then found frame by frame, at first
    with a loss that sees any distance: an arm that one which redescends has lost in one frame would be an outlier in
    all that follow. That search looks at frames 1 / PACE_HZ apart, of those that are `shown`. camera: the only one, who
    cannot tell which way limbs point; see `flips`. ground_m: see `bounded`.
    """
    few = _apart(times_s, np.ones(len(times_s), dtype=bool) if shown is None else np.asarray(shown))
    seen, times = [residuals[t] for t in few], times_s[few]
    poses, cost = candidates(skeleton, seen, times, starts, smoothness, max_iterations, ground_m)[0]
    if camera is not None:
        near = smooth_problem(PoseDecoder(skeleton), bounded(skeleton, seen, FAR_LOSS, ground_m), times, smoothness)
        poses = _turned_over(near, skeleton, camera, poses, cost)
    poses = np.asarray(make_interp_spline(times, poses, k=1)(times_s)) if len(few) > 1 else poses[[0] * len(times_s)]
    own = bounded(skeleton, residuals, loss, ground_m)
    return fit_motion(
        smooth_problem(PoseDecoder(skeleton), own, times_s, smoothness), poses, max_iterations=max_iterations
    )  # fmt: skip


def candidates(
    skeleton: Skeleton,
    residuals: Sequence[ResidualFunction],
    times_s: FloatArray,
    starts: FloatArray,
    smoothness: Smoothness,
    max_iterations: int,
    ground_m: float | None = None,
) -> list[tuple[FloatArray, float]]:
    """Poses (T, P) and their cost under FAR_LOSS, from each of the poses `starts` (n, P), the likeliest first."""
    decoder, near = PoseDecoder(skeleton), bounded(skeleton, residuals, FAR_LOSS, ground_m)
    problem, found = smooth_problem(decoder, near, times_s, smoothness), []
    for start in starts:
        poses = _follow(decoder, near, times_s, start)
        poses, _, minimum = fit_motion(problem, poses, max_iterations=max_iterations, tolerance=1e-3)
        found.append((poses, minimum.costs[-1]))
    return sorted(found, key=lambda one: one[1])


def bounded(
    skeleton: Skeleton, residuals: Sequence[ResidualFunction], loss: Loss, ground_m: float | None = None
) -> list[ResidualFunction]:
    """With the loss of what is seen, and beside it, forgiven by no loss, limits and how people hold themselves: usual
    angles, balance, and where ground_m, the height of a standing person's ankles, is known, one foot near the ground.
    """
    own = [limit_residual(skeleton, LIMIT_SIGMA_RAD), usual_residual(skeleton)]
    if set(JOINT_NAMES) <= set(skeleton.names):
        own += [robust(balance_residual(skeleton), BALANCE_LOSS)]
        own += [ground_residual(skeleton, ground_m)] if ground_m is not None else []
    return [stacked([robust(one, loss), *own]) for one in residuals]


def first_poses(skeleton: Skeleton, seen: Sequence[Keypoints], sigma_px: float) -> FloatArray:
    """Poses (n ≤ N_HYPOTHESES, P) within limits that one frame of keypoints allows."""
    residual = views_residual(skeleton, seen, sigma_px, LEANING_SIGMA_RAD)
    within = stacked([residual, limit_residual(skeleton, LIMIT_SIGMA_RAD)])
    return likely_poses(skeleton, seen, within, usual_poses(skeleton), N_HYPOTHESES)


def smooth_problem(
    decoder: PoseDecoder, residuals: Sequence[ResidualFunction], times_s: FloatArray, smoothness: Smoothness
) -> FitProblem:
    """The problem of T frames at times (T,), s, in which every frame has a pose of its own."""
    n_frames, n_dofs = len(residuals), len(decoder.space)
    columns = np.arange(n_frames * n_dofs).reshape(n_frames, n_dofs)
    rows = second_differences(columns, PACE_HZ * times_s, pose_deviations(smoothness, n_dofs))
    nothing = [(columns[0, :1], np.zeros(1))]  # one or two frames have no second differences
    return FitProblem.of(decoder, residuals, SQUARED, columns, rows or nothing, n_border=0)


def pose_deviations(smoothness: Smoothness, n_dofs: int) -> FloatArray:
    """(P,), of second differences of the pose at PACE_HZ."""
    return np.array([*smoothness.second_differences[1:], *[smoothness.angle] * (n_dofs - N_ROOT)])


def _follow(
    decoder: PoseDecoder, residuals: Sequence[ResidualFunction], times_s: FloatArray, start: FloatArray
) -> FloatArray:
    """Poses (T, P), each near the one before."""
    poses = [start]
    gaps = np.diff(times_s, prepend=times_s[0] - 1.0 / PACE_HZ)
    for t in tqdm(range(len(residuals)), desc="following", unit="frame", disable=None, leave=False):
        spread = np.full(len(start), FOLLOW_SIGMA * np.sqrt(PACE_HZ * gaps[t]))
        prior = Gaussian.independent(poses[-1], spread)
        poses.append(fit_frame(decoder, residuals[t], SQUARED, poses[-1], prior=prior).x)
    return np.array(poses[1:])


def _apart(times_s: FloatArray, shown: BoolArray) -> IntArray:
    """The frames shown that are not closer than 1 / PACE_HZ to one before."""
    few: list[int] = []
    for t in np.flatnonzero(shown):
        if not few or times_s[t] - times_s[few[-1]] > 0.99 / PACE_HZ:
            few.append(int(t))
    return np.array(few, dtype=np.intp)


def _turned_over(problem: FitProblem, skeleton: Skeleton, camera: Camera, poses: FloatArray, cost: float) -> FloatArray:
    """The poses (T, P), or such with limbs turned over in depth that fit better."""
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
