"""The poses that tracking starts from: given, or found in annotations, detected joints or points, for any prior."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import takewhile

import cv2
import numpy as np

from workbench.body.camera import Camera
from workbench.body.kinematics import axis_rotations, joints
from workbench.body.limbs import Body
from workbench.body.skeleton import Skeleton
from workbench.body.surface import Surface, person_surface
from workbench.core.frame import AnnotatedFrames, Frame
from workbench.core.frame_cache import FrameCache
from workbench.core.observations import Keypoints, Observables, Observed, person_px, usable_keypoints
from workbench.core.prior import MotionModel, Prior, PriorCapabilities
from workbench.core.residual import Loss, ResidualFunction, surface_residual
from workbench.inference.initialization.from_keypoints import LIKELY, START_S, allowed_poses, start_from_keypoints
from workbench.inference.least_squares.all_frames import fit_motion, fit_problem
from workbench.inference.least_squares.hypotheses import (
    KEYPOINT_LOSS,
    LEAST_KEYPOINTS,
    START_LOSS,
    START_SIGMA_M,
    distinct_poses,
    likely_roots,
)
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.phase_grid import find_phase
from workbench.inference.least_squares.residuals import views_residual
from workbench.inference.least_squares.single_frame import FitData, MotionDecoder, PoseDecoder, fit_frame
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

MARK_SIGMA_PX = 4.0
EXAMPLE_SIGMA = 0.03
"""Of a joint, in heights of the person in the image: 5 cm, by which people differ from the nearest example."""
N_HEADINGS = 24
N_TRIED, N_REFINED, N_KEPT = 2000, 32, 8
"""How many of the examples, each with a heading, are compared with each other, fitted exactly, and started from."""
APART_M = 0.03
"""In the mean over the joints; of poses that are nearer than this to each other one is enough."""
_BLOCK = 2_000
_PLACE = np.arange(4)  # position and heading; how a person leans is part of the example


@dataclass(frozen=True, eq=False)
class _StartFit:
    """pose: (P,) in the first marked frame, with its phase, cycles, and heading, rad. error_px: root mean square
    distance to all marks, weighted. rate_hz: cycles a second, NaN where one frame alone is marked."""

    pose: FloatArray
    error_px: float
    phase: float
    heading: float
    rate_hz: float


def start_from_marks(model: MotionModel, skeleton: Skeleton, camera: Camera, marks: AnnotatedFrames) -> _StartFit:
    """Return the cyclic motion of the model that fits the joints marked in all F frames, in one style.

    Least squares over coefficients, phases and roots, from several headings and phases; the lowest cost wins. Marks
    have a deviation of MARK_SIGMA_PX, over the root of their weight; left and right come with them.
    Raises InputError as `usable_marks` does.
    """
    seen = usable_marks(skeleton, camera, marks)
    residuals = [views_residual(skeleton, [keypoints], MARK_SIGMA_PX) for keypoints in seen]
    decoder = MotionDecoder(skeleton, model, np.zeros(len(skeleton.dof_names)))
    roots = likely_roots(decoder, seen[:1], residuals[0])
    data = FitData(residuals, marks.times_s, KEYPOINT_LOSS)
    problem = fit_problem(decoder, data, len(seen))
    states, _, _ = fit_motion(problem, find_phase(decoder, data, roots), tolerance=1e-6)
    poses, phases = decoder.poses(states), states[:, decoder.n_style]
    rate_hz = float((phases[-1] - phases[0]) / (marks.times_s[-1] - marks.times_s[0])) if len(seen) > 1 else np.nan
    return _StartFit(poses[0], error_px(skeleton, seen, poses), float(phases[0] % 1.0), float(poses[0, 3]), rate_hz)


def usable_marks(skeleton: Skeleton, camera: Camera, marks: AnnotatedFrames) -> list[Keypoints]:
    """Select the joints marked in each of F frames; raises InputError where they are fewer than LEAST_KEYPOINTS."""
    given = [usable_keypoints(skeleton, rows, camera) for rows in marks.keypoints]
    seen = [keypoints for keypoints in given if keypoints is not None and len(keypoints.joints) >= LEAST_KEYPOINTS]
    if len(seen) < len(given):
        fewest = min(0 if keypoints is None else len(keypoints.joints) for keypoints in given)
        raise InputError(f"start marks: expected at least {LEAST_KEYPOINTS} marked joints in a frame, found {fewest}")
    return seen


def error_px(skeleton: Skeleton, seen: Sequence[Keypoints], poses: FloatArray) -> float:
    """Return the root mean square distance of the joints of poses (F, P) to the marks, weighted."""
    squares, weights = [], []
    for view, places in zip(seen, joints(skeleton, poses), strict=True):
        squares.append(((view.camera.project(places[view.joints]) - view.marks[:, :2]) ** 2).sum(axis=1))
        weights.append(view.marks[:, 2])
    return float(np.sqrt(np.average(np.concatenate(squares), weights=np.concatenate(weights))))


def start_from_examples(examples: FloatArray, skeleton: Skeleton, seen: Keypoints) -> FloatArray:
    """Find those (m ≤ N_KEPT, P) of examples (n, P) that fit one frame's marks, placed where they do, the best first.

    Every example is tried at N_HEADINGS headings, at the place that a linear fit gives it (`placed_costs`). The best
    that differ are fitted by least squares over position and heading. Raises InputError where none can be placed before
    the camera.
    """
    sigma_px = EXAMPLE_SIGMA * person_px([seen])
    upright = examples.copy()
    upright[:, : len(_PLACE)] = 0.0
    guesses = _best_guesses(upright, skeleton, seen, sigma_px)
    if not len(guesses):
        raise InputError(
            "start marks: expected marks of a person before the camera, found none of the prior's examples"
        )
    residual, decoder = views_residual(skeleton, [seen], sigma_px, np.inf), PoseDecoder(skeleton)
    tried = distinct_poses(skeleton, guesses, N_REFINED, APART_M)
    fits = [fit_frame(decoder, residual, KEYPOINT_LOSS, pose, free=_PLACE) for pose in tried]
    fits.sort(key=lambda fit: fit.costs[-1])
    likely = np.array([fit.x for fit in fits if fit.costs[-1] < fits[0].costs[-1] + LIKELY])
    return distinct_poses(skeleton, likely, N_KEPT, APART_M)


def placed_costs(seen: Keypoints, places: FloatArray, heading: float, sigma_px: float) -> tuple[FloatArray, FloatArray]:
    """Return costs (n,), nats, and positions (n, 3), m, of roots, for people whose M joints seen are at `places` (n, M,
    3) while the root is at the origin, and who are turned by a heading, rad.

    In the camera's axes a joint X that is moved by T is seen at (u, v) where X_x + T_x = u (X_z + T_z), and likewise
    for v: linear in T, whose least squares are one matrix for all poses. What is left of an equation, times the focal
    length over the depth, is the distance in the image. Poses behind the camera cost infinitely much.
    """
    camera, weights = seen.camera, np.sqrt(seen.marks[:, 2])
    rays = cv2.undistortPoints(seen.marks[:, None, :2], camera.matrix, camera.distortion)[:, 0]  # (M, 2)
    turn = camera.rotation @ axis_rotations(np.array([0.0, 0.0, 1.0]), np.array([heading]))[0]
    places = places @ turn.T
    off = places[..., :2] - rays * places[..., 2:]  # (n, M, 2)
    by_move = np.concatenate([np.broadcast_to(np.eye(2), (len(rays), 2, 2)), -rays[:, :, None]], axis=2)  # (M, 2, 3)
    solve = np.linalg.pinv((weights[:, None, None] * by_move).reshape(-1, 3))
    moves = -(weights[:, None] * off).reshape(len(places), -1) @ solve.T  # (n, 3), T
    rest = off + np.einsum("mki,ni->nmk", by_move, moves)
    depth = places[..., 2] + moves[:, 2:]
    with np.errstate(divide="ignore", invalid="ignore"):
        misses = rest * (camera.matrix[[0, 1], [0, 1]] * weights[:, None] / sigma_px) / depth[..., None]
    ahead = (depth > 0.0).all(axis=1)
    costs = np.full(len(places), np.inf)
    costs[ahead] = KEYPOINT_LOSS(misses[ahead])[0].sum(axis=(1, 2))
    return costs, (moves - camera.translation) @ camera.rotation


def _best_guesses(upright: FloatArray, skeleton: Skeleton, seen: Keypoints, sigma_px: float) -> FloatArray:
    """Return the N_TRIED poses (k, P) that cost least, of all examples at all headings, the best first."""
    best, guesses = np.empty(0), np.empty((0, upright.shape[1]))
    for first in range(0, len(upright), _BLOCK):
        block = upright[first : first + _BLOCK]
        places = joints(skeleton, block)[:, seen.joints]
        for heading in np.arange(N_HEADINGS) * 2.0 * np.pi / N_HEADINGS:
            costs, roots = placed_costs(seen, places, heading, sigma_px)
            poses = np.column_stack([roots, np.full(len(block), heading), block[:, len(_PLACE) :]])
            costs, poses = np.concatenate([best, costs]), np.concatenate([guesses, poses])
            order = np.argsort(costs, kind="stable")[:N_TRIED]
            best, guesses = costs[order], poses[order]
    return guesses[np.isfinite(best)]


POINTS_S = 1.0
"""Time whose frames are looked at: which way a person faces shows in which way they go."""


@dataclass(frozen=True, eq=False)
class _Distances:
    """Distances of points from a surface, as the start of least squares always looks at them."""

    skeleton: Skeleton
    surface: Surface
    observables: Observables = Observables(sigma=START_SIGMA_M)  # noqa: RUF009 - frozen
    residual_loss: Loss = START_LOSS

    def residual_function(self, observed: Observed) -> ResidualFunction:
        """Measure the distances, whitened by the deviation."""
        return surface_residual(self.skeleton, self.surface, observed.points, "distance", START_SIGMA_M)


def _start_from_points(prior: Prior | None, body: Body, frames: Iterable[Frame]) -> FloatArray:
    """Find the pose (P,) in the first frame that the points of the first second tell.

    The prior's motion model is fitted where it has one, else smooth poses within the body's limits. Raises InputError
    where the points do not tell where the person faces.
    """
    frames = iter(frames)
    first = next(frames)
    seen = [first, *takewhile(lambda frame: frame.time_s - first.time_s <= POINTS_S, frames)]
    distances = _Distances(body.skeleton, person_surface(body))
    fit, _, _ = LeastSquares(body, distances, prior).fit_frames(seen, None, np.random.default_rng(0))
    return fit.poses[0]


def start_poses(prior: Prior | None, body: Body, clip: FrameCache) -> tuple[FloatArray, str]:
    """Find the pose (P,) in the first frame, or several (n, P) of which each may be it, and say in a sentence how.

    The prior's own first pose comes first, then the dataset's, for which there is nothing to say; then marked joints,
    by what the prior knows of people: a cyclic motion, examples, or nothing, where the body's limits have to do; then
    detected joints, then points. Raises InputError where there is none of these, or too few joints.
    """
    info, capabilities = clip.info, PriorCapabilities() if prior is None else prior.capabilities
    if capabilities.first_pose is not None:
        return capabilities.first_pose(), ""
    if info.initial_pose is not None:
        return info.initial_pose, ""
    if info.initial_annotations is not None:
        poses, how = _from_marks(capabilities, body.skeleton, info.cameras[0], info.initial_annotations, info.scale)
        return poses, f"start fitted to the marks: {how}"
    if info.has_keypoints:
        poses = start_from_keypoints(body.skeleton, clip)
        return poses, f"start fitted to keypoints: {len(poses)} poses that they allow"
    if info.has_points:
        return _start_from_points(prior, body, clip), "start fitted to the points of the first second"
    raise InputError(
        "dataset: no initial pose: annotate joints in a video's first frame (dataset.initial_annotations=FILE.csv), "
        "give the start of points (dataset.start=given), or fit by inference=least_squares, which finds it"
    )


def _from_marks(
    capabilities: PriorCapabilities, skeleton: Skeleton, camera: Camera, marks: AnnotatedFrames, scale: float
) -> tuple[FloatArray, str]:
    """Find the pose (P,) or poses (n, P) that fit the marks, and say how well, in pixels of the source's images."""
    if capabilities.motion is not None:
        fit = start_from_marks(capabilities.motion, skeleton, camera, marks)
        pace = "" if np.isnan(fit.rate_hz) else f", {fit.rate_hz:.2f} cycles/s"
        error, heading = fit.error_px / scale, np.degrees(fit.heading)
        return fit.pose, f"residual {error:.1f} px, phase {fit.phase:.2f}, heading {heading:.0f}°{pace}"
    seen = usable_marks(skeleton, camera, marks)
    if capabilities.examples is not None:
        poses, of = start_from_examples(capabilities.examples(), skeleton, seen[0]), "the prior's examples"
    else:
        soon = np.flatnonzero(marks.times_s - marks.times_s[0] <= START_S)
        poses = allowed_poses(skeleton, [(seen[k],) for k in soon], marks.times_s[soon])
        of = "the poses that they allow"
    error = error_px(skeleton, seen[:1], poses[:1]) / scale
    return poses, f"residual {error:.1f} px by the best of {len(poses)} of {of}"
