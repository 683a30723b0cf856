"""Smooth poses within the body's limits, fitted to all frames at once without a motion model."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from tqdm import tqdm

from workbench.body.skeleton import POSE_NAMES, Skeleton
from workbench.cameras.camera import Camera
from workbench.core.capabilities import Traits, component_traits
from workbench.core.losses import SEARCH_LOSS, Loss
from workbench.core.observations import Keypoints, Observed, observed_kinds
from workbench.core.pose_prior import PosePrior
from workbench.core.prior import REFERENCE_RATE_HZ, MotionModel, Smoothness
from workbench.core.residual import KeypointResiduals
from workbench.core.side_information import GROUND_HEIGHT
from workbench.core.state_space import StateSpace
from workbench.inference.least_squares.motion.first_frame import first_pose
from workbench.inference.least_squares.motion.task import Fit, Task
from workbench.inference.least_squares.solver.motion_posterior import MotionPosterior, SystematicErrors
from workbench.inference.least_squares.solver.residuals import nominal_pose_prior
from workbench.inference.least_squares.solver.single_frame import PoseDecoder, select_spaced
from workbench.inference.least_squares.solver.sparse_solver import Factor, Minimum, minimise
from workbench.inference.least_squares.video.detector_errors import with_detector_errors
from workbench.inference.least_squares.video.foot_contact import detect_foot_contacts, median_foot_height
from workbench.inference.least_squares.video.hypotheses import (
    distinct_poses,
    first_keypoints,
    upright_poses,
)
from workbench.inference.least_squares.video.landmark_depths import DepthArrays
from workbench.inference.least_squares.video.landmark_poses import landmark_paths
from workbench.inference.least_squares.video.limb_flips import flip_limbs
from workbench.inference.least_squares.video.pose_problem import KeypointArrays, PoseProblem
from workbench.inference.least_squares.video.systematic_errors import estimated_camera_sensitivity
from workbench.inference.least_squares.video.transient_errors import trusting_lasting_joints
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.timing import working_s

log = logging.getLogger(__name__)

POSE_PRIOR_POWER, EM_ROUNDS = 0.2, 2
"""Power of the pose prior, below 1 because neighbouring frames are dependent, chosen on clips.split=validation of
experiment=held_out_subjects; and the number of expectation-maximisation iterations."""
N_HYPOTHESES = 3
"""Number of initial poses that are fitted sequentially, because one camera does not separate forwards from
backwards."""
MIN_START_SEPARATION_M = 0.1
"""Smallest mean distance of joints between two initial poses."""
_MIN_SEARCH_GAIN = 0.1
"""Nats: predicted decrease at which the search ends."""


@dataclass(frozen=True, eq=False)
class SmoothPoses:
    """The posterior of fitted poses of all frames, and the last search."""

    posterior: MotionPosterior
    search: Minimum

    @property
    def poses(self) -> FloatArray:
        """Return the fitted poses (T, P)."""
        return self.posterior.poses

    @property
    def covariances(self) -> FloatArray:
        """Return their marginal covariances (T, P, P)."""
        return self.posterior.covariances


@dataclass(frozen=True)
class SmoothFit:
    """Fit smooth poses to all frames at once, see `fit_smooth`. ground_m: height of a standing person's ankles in the
    world, m, a constraint on the lower foot; None: estimated from the foot contacts if there is a single camera."""

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare the height of the ground as an assumption, if it is set."""
        return component_traits(assumptions=() if keys.get("ground_m") is None else (GROUND_HEIGHT,))

    ground_m: float | None = None

    def space(self, skeleton: Skeleton, motion: MotionModel | None) -> StateSpace:
        """Return the names of the pose's parameters."""
        return PoseDecoder(skeleton).space

    def fit(self, task: Task, start: FloatArray | None) -> Fit:
        """Return the fit of all frames at once; `start` as for `LeastSquares.run`."""
        clock, problem = working_s(), self._problem(task)
        fitted = fit_smooth(
            problem, task.observations, _initial_candidates(task, start), task.max_iterations, task.pose_prior,
            task.length_uncertainty, task.likelihood.observables.systematic_errors,
        )  # fmt: skip
        decoder, poses = PoseDecoder(task.skeleton), fitted.poses
        return Fit(
            space=decoder.space, poses=poses, covariance=fitted.covariances, states=poses,
            state_covariance=fitted.covariances, pose_jacobian=decoder.jacobian(poses),
            inliers=problem.inliers(poses), iterations=fitted.search.iterations, costs=fitted.search.costs,
            timing_s={"least_squares": working_s() - clock}, posterior=fitted.posterior,
        )  # fmt: skip

    def _problem(self, task: Task) -> PoseProblem:
        likelihood, contacts = task.likelihood, detect_foot_contacts(task.skeleton, task.observations, task.times_s)
        rest = (task.times_s, likelihood.residual_loss, task.smoothness, contacts, self.ground_m)
        if observed_kinds(task.observations) == ("keypoints",) and isinstance(likelihood, KeypointResiduals):
            keypoints = KeypointArrays.of(task.observations, likelihood.whitening)
            return PoseProblem(task.skeleton, keypoints, *rest, depths=_depths(task))
        functions = [likelihood.residual_function(frame) for frame in task.observations]
        return PoseProblem(task.skeleton, KeypointArrays.none(len(functions)), *rest, residual_functions=functions)


def _initial_candidates(task: Task, start: FloatArray | None) -> FloatArray:
    """Return candidate poses (n, P) of the first frame, or with a single camera's world landmarks (n, T, P) of all."""
    if start is not None:
        return start[None]
    if (
        _depths(task) is not None
        and (paths := landmark_paths(task.skeleton, task.observations, task.times_s)) is not None
    ):
        return paths
    if keypoints := first_keypoints(task.observations):
        return first_poses(task.skeleton, keypoints, task.sigma_px, task.likelihood.observables.depth_sigma_m)
    return first_pose(task)[None]


def _depths(task: Task) -> DepthArrays | None:
    """Return the depths by world landmarks; None with several cameras, whose rays determine the depth."""
    sigma_m = task.likelihood.observables.depth_sigma_m
    if sigma_m is None or _single_camera(task.observations) is None:
        return None
    return DepthArrays.of(task.skeleton, task.observations, sigma_m)


def keypoint_problem(
    skeleton: Skeleton, observations: Sequence[Observed], times_s: FloatArray, sigma_px: float, loss: Loss,
    smoothness: Smoothness | None = None,
) -> PoseProblem:  # fmt: skip
    """Return the problem of T frames of keypoints with standard deviation sigma_px / √weight, px."""
    keypoints = KeypointArrays.of(observations, lambda weights: np.sqrt(weights) / sigma_px)
    foot_contacts = detect_foot_contacts(skeleton, observations, times_s)
    return PoseProblem(skeleton, keypoints, times_s, loss, smoothness or Smoothness(), foot_contacts)


def fit_smooth(
    problem: PoseProblem, observations: Sequence[Observed], starts: FloatArray,
    max_iterations: int, pose_prior: PosePrior | None = None, length_uncertainty: FloatArray | None = None,
    systematic_errors: bool = False,
) -> SmoothPoses:  # fmt: skip
    """Return poses (T, P) fitted to the observations of T frames, with covariances.

    Minimises the objective of `PoseProblem`, whose smoothness is the smooth prior of paper A (section 6.1) over all
    frames at once.

    1. Poses are fitted sequentially, at most REFERENCE_RATE_HZ a second, from each of `starts`, under a loss that does
       not redescend: with a redescending loss an arm lost in one frame would be an outlier in all following ones. The
       hypothesis of lowest cost over these frames is selected. With a single camera, which does not determine in which
       direction limbs point, limbs are then flipped in depth, see `limb_flips`.
    2. All frames are fitted, with foot contacts as constraints, see `foot_contact`. With a single camera they are then
       fitted again, with all joints but `transient_errors`, and without `problem.ground_m` with the feet in contact on
       one floor at their median height.
    3. With a pose prior, its Gaussians replace the nominal values of each angle.

    Parameters
    ----------
    observations : one per frame.
    starts : (n, P) candidate poses of the first frame.
    pose_prior : of the last of POSE_NAMES.
    length_uncertainty : (J, 3, G) errors of the skeleton's offsets, m, for one standard deviation of each cause, or
        None. The covariances of a fit to joints alone include them: limbs that are all 5 % too long place the person
        5 % too far away, however many frames there are.
    systematic_errors : whether the covariances of a fit to joints alone include `with_detector_errors`. Those of an
        only camera that is estimated are always included, see `estimated_camera_sensitivity`.

    Raises
    ------
    InputError : the observations do not determine the poses.
    """
    single_camera = _single_camera(observations)
    poses = _initial_poses(problem, observations, starts, single_camera, max_iterations)
    minimum = _fit_all(problem, poses, max_iterations)
    if single_camera is not None and not problem.residual_functions:
        poses = _poses(minimum, poses)
        problem = trusting_lasting_joints(problem, poses)
        if problem.ground_m is None and problem.foot_contacts.any():
            height = median_foot_height(problem.skeleton, poses, problem.foot_contacts)
            log.info("ankle height at foot contact: %.2f m, from the person's size", height)
            problem = replace(problem, ground_m=height)
        minimum = _fit_all(problem, poses, max_iterations)
    fit = SmoothPoses(MotionPosterior(_poses(minimum, poses), _factor(minimum, len(poses))), minimum)
    result = fit if pose_prior is None else _fit_with_pose_prior(problem, fit, pose_prior, max_iterations)
    if problem.residual_functions:
        return result
    posterior = result.posterior
    if length_uncertainty is not None:
        errors = problem.bias_sensitivity(fit.posterior.noise, fit.poses, length_uncertainty)
        posterior = posterior.including(SystematicErrors(errors))
    if single_camera is not None and single_camera.uncertainty is not None:
        errors = estimated_camera_sensitivity(problem, fit.poses, _camera_uncertainty(observations))
        posterior = posterior.including(SystematicErrors(errors))
    if systematic_errors:
        posterior = with_detector_errors(posterior, problem, fit.poses, fit.posterior.noise)
    return replace(result, posterior=posterior)


def candidates(problem: PoseProblem, starts: FloatArray, max_iterations: int) -> list[tuple[FloatArray, float]]:
    """Return the poses (T, P) fitted from each of `starts`, poses (n, P) of the first frame or (n, T, P) of all, with
    their costs, the lowest first."""
    fits = []
    for start in starts:
        poses = problem.fit_sequentially(start) if start.ndim == 1 else start
        minimum = _fit_all(problem, poses, max_iterations, tolerance=1e-3)
        fits.append((_poses(minimum, poses), minimum.costs[-1]))
    return sorted(fits, key=lambda fit: fit[1])


def first_poses(
    skeleton: Skeleton, views: Sequence[Keypoints], sigma_px: float, depth_sigma_m: float | None = None
) -> FloatArray:
    """Return poses (n ≤ N_HYPOTHESES, P) within limits that agree with one frame of keypoints, and with a single view's
    depths by world landmarks if depth_sigma_m is set: minima from all headings, the best first."""
    poses = upright_poses(skeleton, views, nominal_pose_prior(skeleton).mean)
    copies = [Observed(np.empty((0, 3)), tuple(views))] * len(poses)
    problem = keypoint_problem(skeleton, copies, np.arange(len(poses)) / REFERENCE_RATE_HZ, sigma_px, SEARCH_LOSS)
    if depth_sigma_m is not None and len(views) == 1:
        problem = replace(problem, depths=DepthArrays.of(skeleton, copies, depth_sigma_m))
    poses, costs = problem.fit_independently(poses)
    return distinct_poses(skeleton, poses[np.argsort(costs, kind="stable")], N_HYPOTHESES, MIN_START_SEPARATION_M)


def _single_camera(observations: Sequence[Observed]) -> Camera | None:
    """Return the camera of all observations if there is only one, else None."""
    cameras = {keypoints.camera.name: keypoints.camera for frame in observations for keypoints in frame.keypoints}
    return next(iter(cameras.values())) if len(cameras) == 1 and "points" not in observed_kinds(observations) else None


def _camera_uncertainty(observations: Sequence[Observed]) -> FloatArray:
    """Return the uncertainty (G, C, 23) of an only camera that is estimated, in the order of the keypoints' rows."""
    cameras = {id(view.camera): view.camera for frame in observations for view in frame.keypoints}
    return np.stack([each.uncertainty for each in cameras.values() if each.uncertainty is not None], axis=1)


def _initial_poses(
    problem: PoseProblem, observations: Sequence[Observed], starts: FloatArray,
    single_camera: Camera | None, max_iterations: int,
) -> FloatArray:  # fmt: skip
    """Return poses (T, P) fitted from the best of `starts` (n, P), with flipped limbs if there is a single camera."""
    frames = select_spaced((bool(observed_kinds([frame])) for frame in observations), problem.times_s)
    spaced_problem = replace(problem, loss=SEARCH_LOSS).select_frames(frames)
    poses, _ = candidates(spaced_problem, starts[:, frames] if starts.ndim == 3 else starts, max_iterations)[0]
    if single_camera is not None and not spaced_problem.residual_functions:
        poses = _poses(_fit_all(spaced_problem, poses, max_iterations, tolerance=0.0), poses)
        poses = flip_limbs(spaced_problem, single_camera, poses)
    if len(poses) == 1:
        return poses[[0] * len(problem.times_s)]
    return np.asarray(scipy.interpolate.make_interp_spline(spaced_problem.times_s, poses, k=1)(problem.times_s))


def _fit_with_pose_prior(
    problem: PoseProblem, previous: SmoothPoses, pose_prior: PosePrior, max_iterations: int
) -> SmoothPoses:
    """Return the poses fitted with the pose prior, by EM_ROUNDS iterations of expectation maximisation.

    Deviation: the posterior's noise is that without the pose prior, which would narrow it for dependent neighbouring
    frames, plus a systematic error of covariance d dᵀ / 2 with the shift d of the poses: the fits without and with the
    prior are taken as two samples.
    """
    poses, minimum = previous.poses, previous.search
    for _ in range(EM_ROUNDS):
        gaussians = pose_prior_gaussians(pose_prior, poses, previous.covariances, POSE_PRIOR_POWER, problem.nominal)
        minimum = _fit_all(replace(problem, pose_prior=gaussians), poses, max_iterations)
        poses = _poses(minimum, poses)
    shifts = poses - previous.poses
    posterior = replace(previous.posterior, poses=poses).including(SystematicErrors(shifts[:, :, None], variance=0.5))
    return SmoothPoses(posterior, minimum)


def pose_prior_gaussians(
    pose_prior: PosePrior, poses: FloatArray, covariances: FloatArray, power: float,
    nominal: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Return means (T, P) and precisions (T, P, P) of the pose prior's Gaussians at poses (T, P) with covariances (T,
    P, P), to a power above 0, see `PosePrior.geometric_mean`; they are fixed in the following fit. The angles of feet
    keep their nominal mean and precision, of (P,) and (P, P)."""
    angles, feet = slice(len(POSE_NAMES) - pose_prior.means.shape[1], len(POSE_NAMES)), slice(len(POSE_NAMES), None)
    means, precisions = np.zeros_like(poses), np.zeros_like(covariances)
    means[:, feet], precisions[:, feet, feet] = nominal[0][feet], nominal[1][feet, feet]
    for t, (pose, covariance) in enumerate(zip(poses, covariances, strict=True)):
        gaussian = pose_prior.geometric_mean(pose[angles], covariance[angles, angles], power)
        means[t, angles], precisions[t, angles, angles] = gaussian
    return means, precisions


def _fit_all(problem: PoseProblem, poses: FloatArray, max_iterations: int, tolerance: float = 1e-4) -> Minimum:
    """Return the minimum over all frames, searched from poses (T, P)."""
    with tqdm(total=max_iterations, desc="least squares", unit="step", disable=None, leave=False) as bar:

        def progress(cost: float) -> None:
            bar.set_postfix_str(f"cost {cost:.4g}")
            bar.update()

        return minimise(
            problem.expand, poses.ravel(), max_iterations=max_iterations, tolerance=tolerance,
            min_gain=_MIN_SEARCH_GAIN if tolerance == 0.0 else 0.0, progress=progress,
        )  # fmt: skip


def _poses(minimum: Minimum, like: FloatArray) -> FloatArray:
    return minimum.x.reshape(len(like), -1)


def _factor(minimum: Minimum, n_frames: int) -> Factor:
    """Return the Cholesky factor of the Gauss–Newton matrix; InputError if it is singular."""
    try:
        return minimum.quadratic.normal.factor()
    except np.linalg.LinAlgError:
        raise InputError(
            f"least squares: the observations of {n_frames} frames do not determine the motion; expected more points"
        ) from None
