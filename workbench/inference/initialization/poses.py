"""Initial poses of tracking, for every prior: from the prior or dataset, or fitted to annotations, detected joints or
points."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import takewhile

import numpy as np

from workbench.body.kinematics import axis_rotations, joints
from workbench.body.limbs import Body
from workbench.body.skeleton import Skeleton
from workbench.body.surface import Surface, person_surface
from workbench.cameras.camera import Camera
from workbench.core.frame import AnnotatedFrames, Frame
from workbench.core.frame_cache import FrameCache
from workbench.core.losses import POINT_LOSS, SEARCH_LOSS, Loss
from workbench.core.observations import Keypoints, Observables, Observed, person_px, usable_keypoints
from workbench.core.prior import MotionModel, Prior, PriorCapabilities
from workbench.core.residual import ResidualFunction, surface_residual
from workbench.inference.initialization.from_keypoints import (
    MAX_COST_GAP,
    START_S,
    consistent_poses,
    poses_from_keypoints,
)
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.motion.all_frames import fit_motion, fit_problem
from workbench.inference.least_squares.motion.first_frame import START_SIGMA_M, likely_roots
from workbench.inference.least_squares.motion.motion_decoder import MotionDecoder
from workbench.inference.least_squares.motion.phase_grid import find_phase
from workbench.inference.least_squares.solver.residuals import views_residual
from workbench.inference.least_squares.solver.single_frame import FitData, PoseDecoder, fit_frame
from workbench.inference.least_squares.video.hypotheses import MIN_KEYPOINTS, distinct_poses
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

ANNOTATION_SIGMA_PX = 4.0
EXAMPLE_SIGMA = 0.03
"""Standard deviation of a joint, in heights of the person in the image: 5 cm, by which people differ from the nearest
example."""
N_HEADINGS = 24
N_TRIED, N_REFINED, N_SELECTED = 2000, 32, 8
"""Numbers of examples, each with a heading, that are compared with each other, fitted exactly, and returned."""
MIN_SEPARATION_M = 0.03
"""Smallest mean distance of joints between two returned poses."""
_BLOCK = 2_000
_ROOT_COLUMNS = np.arange(4)  # position and heading; how a person leans is part of the example


@dataclass(frozen=True, eq=False)
class _AnnotationFit:
    """pose: (P,) in the first annotated frame, with its phase, cycles, and heading, rad. error_px: root mean square
    reprojection error over all annotations, weighted. rate_hz: cycles per second, NaN for a single annotated frame."""

    pose: FloatArray
    error_px: float
    phase: float
    heading: float
    rate_hz: float


def fit_annotations(
    model: MotionModel, skeleton: Skeleton, camera: Camera, annotations: AnnotatedFrames
) -> _AnnotationFit:
    """Return the cyclic motion of the model, with one style, fitted to the joints annotated in all F frames.

    Least squares over coefficients, phases and roots, from several headings and phases; the lowest cost is selected.
    Annotations have left/right labels and a standard deviation of ANNOTATION_SIGMA_PX / √weight. Raises InputError as
    `usable_annotations`.
    """
    views = usable_annotations(skeleton, camera, annotations)
    residuals = [views_residual(skeleton, [keypoints], ANNOTATION_SIGMA_PX) for keypoints in views]
    decoder = MotionDecoder(skeleton, model, np.zeros(len(skeleton.dof_names)))
    roots = likely_roots(decoder, views[:1], residuals[0])
    data = FitData(residuals, annotations.times_s, SEARCH_LOSS)
    problem = fit_problem(decoder, data, len(views))
    states, _, _ = fit_motion(problem, find_phase(decoder, data, roots), tolerance=1e-6)
    poses, phases = decoder.poses(states), states[:, decoder.n_style]
    duration_s = annotations.times_s[-1] - annotations.times_s[0]
    rate_hz = float((phases[-1] - phases[0]) / duration_s) if len(views) > 1 else np.nan
    error, phase, heading = error_px(skeleton, views, poses), float(phases[0] % 1.0), float(poses[0, 3])
    return _AnnotationFit(poses[0], error, phase, heading, rate_hz)


def usable_annotations(skeleton: Skeleton, camera: Camera, annotations: AnnotatedFrames) -> list[Keypoints]:
    """Return the joints annotated in each of F frames; raises InputError if a frame has fewer than MIN_KEYPOINTS."""
    usable = [usable_keypoints(skeleton, rows, camera) for rows in annotations.keypoints]
    sufficient = [keypoints for keypoints in usable if keypoints is not None and len(keypoints.joints) >= MIN_KEYPOINTS]
    if len(sufficient) < len(usable):
        fewest = min(0 if keypoints is None else len(keypoints.joints) for keypoints in usable)
        raise InputError(
            f"initial annotations: expected at least {MIN_KEYPOINTS} annotated joints in a frame, found {fewest}"
        )
    return sufficient


def error_px(skeleton: Skeleton, views: Sequence[Keypoints], poses: FloatArray) -> float:
    """Return the weighted root mean square reprojection error of poses (F, P)."""
    squares, weights = [], []
    for view, positions in zip(views, joints(skeleton, poses), strict=True):
        squares.append(((view.camera.project(positions[view.joints]) - view.detections[:, :2]) ** 2).sum(axis=1))
        weights.append(view.detections[:, 2])
    return float(np.sqrt(np.average(np.concatenate(squares), weights=np.concatenate(weights))))


def poses_from_examples(examples: FloatArray, skeleton: Skeleton, keypoints: Keypoints) -> FloatArray:
    """Return those (m ≤ N_SELECTED, P) of examples (n, P) that fit one frame's keypoints, with fitted root, the best
    first.

    Every example is tried at N_HEADINGS headings, at the position of a linear fit (`placed_costs`). The best distinct
    ones are fitted by least squares over position and heading. Raises InputError if none is in front of the camera.
    """
    sigma_px = EXAMPLE_SIGMA * person_px([keypoints])
    upright_examples = examples.copy()
    upright_examples[:, : len(_ROOT_COLUMNS)] = 0.0
    candidates = _best_placements(upright_examples, skeleton, keypoints, sigma_px)
    if not len(candidates):
        raise InputError(
            "initial annotations: expected joints of a person in front of the camera, found none of the prior's "
            "examples that fits"
        )
    residual, decoder = views_residual(skeleton, [keypoints], sigma_px, np.inf), PoseDecoder(skeleton)
    distinct = distinct_poses(skeleton, candidates, N_REFINED, MIN_SEPARATION_M)
    fits = [fit_frame(decoder, residual, SEARCH_LOSS, pose, free=_ROOT_COLUMNS) for pose in distinct]
    fits.sort(key=lambda fit: fit.costs[-1])
    within_gap = np.array([fit.x for fit in fits if fit.costs[-1] < fits[0].costs[-1] + MAX_COST_GAP])
    return distinct_poses(skeleton, within_gap, N_SELECTED, MIN_SEPARATION_M)


def placed_costs(
    keypoints: Keypoints, positions: FloatArray, heading: float, sigma_px: float
) -> tuple[FloatArray, FloatArray]:
    """Return costs (n,), nats, and root positions (n, 3), m, of n people, translated to fit the keypoints.

    In the camera's axes a joint X translated by T projects to (u, v) with X_x + T_x = u (X_z + T_z), and likewise for
    v: linear in T, with one least-squares matrix for all poses. The residual of an equation times the focal length over
    the depth is the distance in the image. Poses behind the camera have infinite cost.

    Parameters
    ----------
    positions : (n, M, 3) of the M joints in `keypoints`, with the root at the origin.
    heading : rad, by which all people are rotated.
    """
    camera, weights = keypoints.camera, np.sqrt(keypoints.detections[:, 2])
    rays = camera.undistorted(keypoints.detections[:, :2])  # (M, 2)
    rotation = camera.rotation @ axis_rotations(np.array([0.0, 0.0, 1.0]), np.array([heading]))[0]
    positions = positions @ rotation.T
    offsets = positions[..., :2] - rays * positions[..., 2:]  # (n, M, 2)
    by_shift = np.concatenate([np.broadcast_to(np.eye(2), (len(rays), 2, 2)), -rays[:, :, None]], axis=2)  # (M, 2, 3)
    solve = np.linalg.pinv((weights[:, None, None] * by_shift).reshape(-1, 3))
    translations = -(weights[:, None] * offsets).reshape(len(positions), -1) @ solve.T  # (n, 3), T
    remainder = offsets + np.einsum("mki,ni->nmk", by_shift, translations)
    depth = positions[..., 2] + translations[:, 2:]
    with np.errstate(divide="ignore", invalid="ignore"):
        residuals = remainder * (camera.matrix[[0, 1], [0, 1]] * weights[:, None] / sigma_px) / depth[..., None]
    in_front = (depth > 0.0).all(axis=1)
    costs = np.full(len(positions), np.inf)
    costs[in_front] = SEARCH_LOSS(residuals[in_front])[0].sum(axis=(1, 2))
    return costs, (translations - camera.translation) @ camera.rotation


def _best_placements(examples: FloatArray, skeleton: Skeleton, keypoints: Keypoints, sigma_px: float) -> FloatArray:
    """Return the N_TRIED poses (k, P) of lowest cost, of all examples at all headings, the best first."""
    best, candidates = np.empty(0), np.empty((0, examples.shape[1]))
    for first in range(0, len(examples), _BLOCK):
        block = examples[first : first + _BLOCK]
        positions = joints(skeleton, block)[:, keypoints.joints]
        for heading in np.arange(N_HEADINGS) * 2.0 * np.pi / N_HEADINGS:
            costs, roots = placed_costs(keypoints, positions, heading, sigma_px)
            poses = np.column_stack([roots, np.full(len(block), heading), block[:, len(_ROOT_COLUMNS) :]])
            costs, poses = np.concatenate([best, costs]), np.concatenate([candidates, poses])
            order = np.argsort(costs, kind="stable")[:N_TRIED]
            best, candidates = costs[order], poses[order]
    return candidates[np.isfinite(best)]


POINTS_S = 1.0
"""Time over which frames are used; the direction of motion determines the heading."""


@dataclass(frozen=True, eq=False)
class _DistanceResiduals:
    """Distances of points from a surface, as in the initial search of least squares."""

    skeleton: Skeleton
    surface: Surface
    observables: Observables = Observables(sigma=START_SIGMA_M)  # noqa: RUF009 - frozen
    residual_loss: Loss = POINT_LOSS

    def residual_function(self, observed: Observed) -> ResidualFunction:
        """Return the whitened distances."""
        return surface_residual(self.skeleton, self.surface, observed.points, "distance", START_SIGMA_M)


def _pose_from_points(prior: Prior | None, body: Body, frames: Iterable[Frame]) -> FloatArray:
    """Return the pose (P,) in the first frame, fitted to the points of the first second.

    The fit uses the prior's motion model if it has one, else smooth poses within the body's limits. Raises InputError
    if the points do not determine the heading.
    """
    frames = iter(frames)
    first = next(frames)
    used_frames = [first, *takewhile(lambda frame: frame.time_s - first.time_s <= POINTS_S, frames)]
    likelihood = _DistanceResiduals(body.skeleton, person_surface(body))
    fit, _, _ = LeastSquares(body, likelihood, prior).fit_frames(used_frames, None, np.random.default_rng(0))
    return fit.poses[0]


def initial_poses(prior: Prior | None, body: Body, clip: FrameCache) -> tuple[FloatArray, str]:
    """Return the pose (P,) in the first frame, or several candidates (n, P), and a description of their source.

    The sources in order are: the prior's own first pose and the dataset's, both without description; annotated joints,
    fitted with the prior's cyclic motion, its examples, or the body's limits alone; detected joints; points. Raises
    InputError if there is none of these, or too few joints.
    """
    info, capabilities = clip.info, PriorCapabilities() if prior is None else prior.capabilities
    if capabilities.first_pose is not None:
        return capabilities.first_pose(), ""
    if info.initial_pose is not None:
        return info.initial_pose, ""
    if info.initial_annotations is not None:
        camera, annotations = info.cameras[0], info.initial_annotations
        poses, description = _from_annotations(capabilities, body.skeleton, camera, annotations, info.scale)
        return poses, f"initial pose fitted to the annotations: {description}"
    if info.has_keypoints:
        poses = poses_from_keypoints(body.skeleton, clip)
        return poses, f"initial pose fitted to keypoints: {len(poses)} consistent poses"
    if info.has_points:
        return _pose_from_points(prior, body, clip), "initial pose fitted to the points of the first second"
    raise InputError(
        "dataset: no initial pose: annotate joints in a video's first frame (dataset.initial_annotations=FILE.csv), "
        "for points set dataset.initialization=perturbed_truth, or fit by inference=least_squares, which finds it"
    )


def _from_annotations(
    capabilities: PriorCapabilities, skeleton: Skeleton, camera: Camera, annotations: AnnotatedFrames, scale: float
) -> tuple[FloatArray, str]:
    """Return the pose (P,) or poses (n, P) fitted to the annotations, and their residual in words, in pixels of the
    source's images."""
    if capabilities.motion is not None:
        fit = fit_annotations(capabilities.motion, skeleton, camera, annotations)
        rate = "" if np.isnan(fit.rate_hz) else f", {fit.rate_hz:.2f} cycles/s"
        error, heading = fit.error_px / scale, np.degrees(fit.heading)
        return fit.pose, f"residual {error:.1f} px, phase {fit.phase:.2f}, heading {heading:.0f}°{rate}"
    views = usable_annotations(skeleton, camera, annotations)
    if capabilities.examples is not None:
        source = "the prior's examples"
        poses = poses_from_examples(capabilities.examples(), skeleton, views[0])
    else:
        frames = np.flatnonzero(annotations.times_s - annotations.times_s[0] <= START_S)
        poses = consistent_poses(skeleton, [(views[k],) for k in frames], annotations.times_s[frames])
        source = "the consistent poses"
    error = error_px(skeleton, views[:1], poses[:1]) / scale
    return poses, f"residual {error:.1f} px for the best of {len(poses)} of {source}"
