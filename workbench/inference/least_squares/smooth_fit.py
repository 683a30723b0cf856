"""Poses that move smoothly and stay within the body's limits, fitted to all frames at once without a motion model."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
import scipy
from tqdm import tqdm

from workbench.body.camera import Camera
from workbench.body.skeleton import Skeleton
from workbench.core.capabilities import Traits, offering
from workbench.core.observations import Keypoints, Observed, observed_kinds
from workbench.core.pose_prior import PosePrior
from workbench.core.prior import REFERENCE_RATE_HZ, MotionModel, Smoothness
from workbench.core.residual import KeypointResiduals, Loss
from workbench.core.side_information import GROUND_HEIGHT
from workbench.core.state_space import StateSpace
from workbench.inference.least_squares.foot_contact import standing_feet, standing_height
from workbench.inference.least_squares.hypotheses import (
    KEYPOINT_LOSS,
    distinct_poses,
    first_keypoints,
    first_pose,
    upright_poses,
)
from workbench.inference.least_squares.keypoint_problem import KeypointArrays, KeypointProblem
from workbench.inference.least_squares.limb_flips import turn_limbs
from workbench.inference.least_squares.residual_problem import ResidualProblem
from workbench.inference.least_squares.residuals import posture_prior
from workbench.inference.least_squares.single_frame import PoseDecoder, spaced
from workbench.inference.least_squares.solver import Minimum, Quadratic, minimise
from workbench.inference.least_squares.task import Fit, Task
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.timing import working_s

log = logging.getLogger(__name__)

FAR_LOSS = Loss("huber", 3.0)
LEANING_SIGMA_RAD = np.inf
"""Deviation of pitch and roll beyond what is usual, which says it all."""
POSTURES, POSTURE_ROUNDS = 0.2, 2
"""Power of the density of postures, below 1 as neighbouring frames say the same, chosen on clips.half=choose of
experiment=strangers by detected joints; how often poses are drawn to it and are then of its other parts."""
N_HYPOTHESES = 3
"""Poses of the first frame that are followed: one camera does not tell forwards from backwards."""
DISTINCT_M = 0.1
"""Mean distance of joints between poses of the first frame that are worth following both."""
_SEARCHED = 0.1
"""Nats: the search ends when it promises less."""


class SmoothProblem(Protocol):
    """Poses of T frames under a smoothness prior: `KeypointProblem` or `ResidualProblem`, whose fields these are."""

    @property
    def skeleton(self) -> Skeleton: ...
    @property
    def times_s(self) -> FloatArray: ...
    @property
    def stand(self) -> BoolArray: ...
    def some(self, frames: IntArray) -> "SmoothProblem": ...
    def expand(self, x: FloatArray) -> Quadratic: ...
    def followed(self, start: FloatArray) -> FloatArray: ...
    def inliers(self, poses: FloatArray) -> FloatArray: ...


@dataclass(frozen=True, eq=False)
class SmoothPoses:
    """Fitted poses (T, P) with marginal covariances (T, P, P), and the last search."""

    poses: FloatArray
    covariances: FloatArray
    search: Minimum


@dataclass(frozen=True)
class SmoothFit:
    """Fit smooth poses to all frames at once, see `fit_smooth`. ground_m: height of a standing person's ankles in the
    world, m, to which the lower foot is tied; None: where one camera sees feet that stand, they give it."""

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
        clock, problem = working_s(), self._problem(task)
        doubt = task.length_doubt if isinstance(problem, KeypointProblem) else None
        starts = _starts(task, start)
        fitted = fit_smooth(problem, task.seen, starts, task.max_iterations, task.postures, doubt)
        decoder, poses = PoseDecoder(task.skeleton), fitted.poses
        return Fit(
            space=decoder.space, poses=poses, covariance=fitted.covariances, states=poses,
            state_covariance=fitted.covariances, pose_jacobian=decoder.jacobian(poses),
            inliers=problem.inliers(poses), iterations=fitted.search.iterations, costs=fitted.search.costs,
            timing_s={"least_squares": working_s() - clock},
        )  # fmt: skip

    def _problem(self, task: Task) -> KeypointProblem | ResidualProblem:
        likelihood, stand = task.likelihood, standing_feet(task.skeleton, task.seen, task.times_s)
        rest = (task.times_s, likelihood.residual_loss, task.smoothness, stand, self.ground_m)
        if observed_kinds(task.seen) == ("keypoints",) and isinstance(likelihood, KeypointResiduals):
            return KeypointProblem(task.skeleton, KeypointArrays.of(task.seen, likelihood.whitening), *rest)
        return ResidualProblem(task.skeleton, task.data(LEANING_SIGMA_RAD).residuals, *rest)


def _starts(task: Task, start: FloatArray | None) -> FloatArray:
    """Return poses (n, P) of the first frame to start from."""
    if start is not None:
        return start[None]
    if keypoints := first_keypoints(task.seen):
        return first_poses(task.skeleton, keypoints, task.sigma_px)
    return first_pose(task, None)[None]


def keypoint_problem(
    skeleton: Skeleton, seen: Sequence[Observed], times_s: FloatArray, sigma_px: float, loss: Loss,
    smoothness: Smoothness | None = None,
) -> KeypointProblem:  # fmt: skip
    """Pose the problem of T frames of keypoints with the deviation sigma_px, px, over the root of their weight."""
    marks = KeypointArrays.of(seen, lambda weights: np.sqrt(weights) / sigma_px)
    stand = standing_feet(skeleton, seen, times_s)
    return KeypointProblem(skeleton, marks, times_s, loss, smoothness or Smoothness(), stand)


def fit_smooth(
    problem: KeypointProblem | ResidualProblem, seen: Sequence[Observed], starts: FloatArray, max_iterations: int,
    postures: PosePrior | None = None, doubt: FloatArray | None = None,
) -> SmoothPoses:  # fmt: skip
    """Fit poses (T, P) to what is seen of T frames.

    Minimises Σ_t Σ_k ρ(r_tk) + limits + habits + the smoothness's second differences, which is the smooth prior of
    paper A (section 6.1) over all frames at once.

    1. Poses are found frame by frame, at most PACE_HZ a second, from each of `starts`, with a loss that sees any
       distance: an arm that a redescending loss has lost in one frame would be an outlier in all that follow. The
       hypothesis wins that all these frames together like best; where one camera sees all, which cannot tell which way
       limbs point, they are turned over, see `limb_flips`.
    2. All frames are fitted. Feet that stand keep their place, see `foot_contact`. Where one camera sees all, the feet
       that stand are brought to one floor, at their median height, unless `problem.ground_m` is known.
    3. Where it is known which postures people take, poses are drawn to these instead of to each angle's usual values.

    Parameters
    ----------
    seen
        What each of T frames shows.
    starts : (n, P) array
        Poses of the first frame to start from.
    postures
        Which ones people take, the last numbers of a pose.
    doubt : (J, 3, G) array, optional
        By how much the skeleton's offsets may be off, m. Covariances then have it in them: limbs that are all a
        twentieth too long put the person a twentieth too far away, in however many frames.

    Raises
    ------
    InputError
        When what the frames show does not determine the poses.
    """
    alone = _only_camera(seen)
    poses = _searched(problem, seen, starts, alone, max_iterations)
    minimum = _fitted(problem, poses, max_iterations)
    if alone is not None and problem.ground_m is None and problem.stand.any():
        height = standing_height(problem.skeleton, _poses(minimum, poses), problem.stand)
        log.info("the feet stand at %.2f m, by the person's size", height)
        problem = replace(problem, ground_m=height)
        minimum = _fitted(problem, _poses(minimum, poses), max_iterations)
    fit = SmoothPoses(_poses(minimum, poses), _covariances(minimum, len(poses)), minimum)
    result = fit if postures is None else _drawn(problem, fit, postures, max_iterations)
    if doubt is None or not isinstance(problem, KeypointProblem):
        return result
    misled = problem.misled(minimum.quadratic.normal.factor(), fit.poses, doubt)
    return replace(result, covariances=result.covariances + misled @ misled.swapaxes(1, 2))


def candidates(
    problem: KeypointProblem | ResidualProblem, starts: FloatArray, max_iterations: int
) -> list[tuple[FloatArray, float]]:
    """Fit poses (T, P) from each of the poses `starts` (n, P); returns them with their costs, the likeliest first."""
    fits = []
    for start in starts:
        poses = problem.followed(start)
        minimum = _fitted(problem, poses, max_iterations, tolerance=1e-3)
        fits.append((_poses(minimum, poses), minimum.costs[-1]))
    return sorted(fits, key=lambda fit: fit[1])


def first_poses(skeleton: Skeleton, seen: Sequence[Keypoints], sigma_px: float) -> FloatArray:
    """Return poses (n ≤ N_HYPOTHESES, P) within limits that one frame of keypoints allows: minima found from headings
    all around, the best first."""
    poses = upright_poses(skeleton, seen, posture_prior(skeleton).mean)
    copies = [Observed(np.empty((0, 3)), tuple(seen))] * len(poses)
    problem = keypoint_problem(skeleton, copies, np.arange(len(poses)) / REFERENCE_RATE_HZ, sigma_px, KEYPOINT_LOSS)
    poses, costs = problem.each(poses)
    return distinct_poses(skeleton, poses[np.argsort(costs, kind="stable")], N_HYPOTHESES, DISTINCT_M)


def _only_camera(seen: Sequence[Observed]) -> Camera | None:
    """Return the camera that sees all there is, or None."""
    cameras = {keypoints.camera.name: keypoints.camera for frame in seen for keypoints in frame.keypoints}
    return next(iter(cameras.values())) if len(cameras) == 1 and "points" not in observed_kinds(seen) else None


def _searched(
    problem: KeypointProblem | ResidualProblem, seen: Sequence[Observed], starts: FloatArray, alone: Camera | None,
    max_iterations: int,
) -> FloatArray:  # fmt: skip
    """Find poses (T, P) from the likeliest of `starts` (n, P), turned over where one camera, `alone`, sees all."""
    frames = spaced((bool(observed_kinds([frame])) for frame in seen), problem.times_s)
    far = replace(problem, loss=FAR_LOSS).some(frames)
    poses, _ = candidates(far, starts, max_iterations)[0]
    if alone is not None and isinstance(far, KeypointProblem):
        poses = _poses(_fitted(far, poses, max_iterations, tolerance=0.0), poses)
        poses = turn_limbs(far, alone, poses)
    if len(poses) == 1:
        return poses[[0] * len(problem.times_s)]
    return np.asarray(scipy.interpolate.make_interp_spline(far.times_s, poses, k=1)(problem.times_s))


def _drawn(
    problem: KeypointProblem | ResidualProblem, before: SmoothPoses, postures: PosePrior, max_iterations: int
) -> SmoothPoses:
    """Draw what is fitted to postures, in POSTURE_ROUNDS of expectation and maximisation.

    Deviation: the covariances are those before that, as postures of neighbouring frames say the same and would narrow
    each of them, and d dᵀ / 2, d being how far a pose was drawn: what is found without and with postures are two
    samples of what may be found.
    """
    poses, minimum = before.poses, before.search
    for _ in range(POSTURE_ROUNDS):
        usual = nearest_postures(postures, poses, before.covariances, POSTURES)
        minimum = _fitted(replace(problem, usual=usual), poses, max_iterations)
        poses = _poses(minimum, poses)
    drawn = poses - before.poses
    return SmoothPoses(poses, before.covariances + 0.5 * drawn[:, :, None] * drawn[:, None, :], minimum)


def nearest_postures(
    postures: PosePrior, poses: FloatArray, covariances: FloatArray, power: float
) -> tuple[FloatArray, FloatArray]:
    """Return means (T, P) and precisions (T, P, P) of the postures, to a power above 0, that poses (T, P) with
    covariances (T, P, P) are drawn to, see `PosePrior.nearest`: they stay those when the poses move."""
    own = slice(poses.shape[1] - postures.means.shape[1], None)
    means, precisions = np.zeros_like(poses), np.zeros_like(covariances)
    for t, (pose, covariance) in enumerate(zip(poses, covariances, strict=True)):
        means[t, own], precisions[t, own, own] = postures.nearest(pose[own], covariance[own, own], power)
    return means, precisions


def _fitted(problem: SmoothProblem, poses: FloatArray, max_iterations: int, tolerance: float = 1e-4) -> Minimum:
    """Fit all frames from poses (T, P)."""
    with tqdm(total=max_iterations, desc="least squares", unit="step", disable=None, leave=False) as bar:

        def progress(cost: float) -> None:
            bar.set_postfix_str(f"cost {cost:.4g}")
            bar.update()

        return minimise(
            problem.expand, poses.ravel(), max_iterations=max_iterations, tolerance=tolerance,
            least_gain=_SEARCHED if tolerance == 0.0 else 0.0, progress=progress,
        )  # fmt: skip


def _poses(minimum: Minimum, like: FloatArray) -> FloatArray:
    return minimum.x.reshape(len(like), -1)


def _covariances(minimum: Minimum, n_frames: int) -> FloatArray:
    """Return the marginal covariances (T, P, P): the inverse of the Gauss–Newton matrix, Laplace's approximation."""
    try:
        factor = minimum.quadratic.normal.factor()
    except np.linalg.LinAlgError:
        raise InputError(
            f"least squares: what {n_frames} frames show does not determine the motion; expected more points"
        ) from None
    return factor.covariances(np.arange(len(minimum.x)).reshape(n_frames, -1))
