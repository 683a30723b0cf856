"""Limb lengths fitted to 2-D joints in some frames, by least squares over lengths and poses together."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np
import scipy

from workbench.body.kinematics import forward, joint_jacobian, length_jacobian
from workbench.body.limbs import Body, person_on
from workbench.body.shape import Shape, from_height
from workbench.body.skeleton import JOINT_NAMES, Skeleton, person_skeleton
from workbench.body.stature import limb_lengths, usual_height
from workbench.cameras.calibration_findings import HEIGHTS_M
from workbench.cameras.triangulation import triangulate
from workbench.core.capabilities import KEYPOINTS, Traits, component_traits, declares_traits
from workbench.core.frame_cache import FrameCache, without_images
from workbench.core.losses import SEARCH_LOSS
from workbench.core.observations import Keypoints, Observed, frame_keypoints, person_px
from workbench.core.residual import projection_jacobian
from workbench.core.side_information import FIRST_FRAMES, HEIGHT
from workbench.inference.least_squares.solver.residuals import nominal_pose_prior, views_residual
from workbench.inference.least_squares.video.hypotheses import enough_keypoints, likely_poses
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

log = logging.getLogger(__name__)

LENGTHS = ("torso", "shoulders", "hips", "head", "upper_arm", "forearm", "thigh", "calf")
"""Proportions of a person besides the height."""
AVERAGE_M, HEIGHT_SIGMA, KNOWN_HEIGHT_SIGMA = 1.70, 0.06, 0.01
"""Mean of adults' height and standard deviation of its logarithm; standard deviation of the logarithm of a given
height."""
PROPORTION_SIGMA = 0.05
"""Standard deviation of the logarithm of a length over the height: people differ by some 4 %, and detected joints
differ from anatomical ones."""
WIDTHS, WIDTH_SIGMA = ("shoulders", "hips"), 0.1
"""Detected hips and shoulders are 30 to 50 mm from anatomical ones (Needham et al. 2021), a larger fraction of a
width."""
UPPER_ARM, FOREARM = 0.162, 0.154
"""Over the height, between joint centres (de Leva 1996), as of detectors; `from_height` uses lengths from the
shoulder's top."""
KEYPOINT_SIGMA = 0.03
"""Standard deviation of a joint, in heights of the person in the image: detection errors are 1 to 2 %, but correlated
between frames, so that eight frames have little more information than one."""
_MAX_FRAMES = 300
"""Frames with keypoints among which those of the fit are: at 30 Hz 10 s, in which most people turn or step."""


@dataclass(frozen=True, eq=False)
class _MeasuredLengths:
    """Fitted shape. poses: (T, P) in the frames used. error_px: root mean square reprojection error.
    length_uncertainty: (J, 3, G) errors of the skeleton's offsets, see `Body.limb_length_std`."""

    shape: Shape
    poses: FloatArray
    error_px: float
    length_uncertainty: FloatArray


def _traits(keys: Mapping[str, Any]) -> Traits:
    """Declare the need of keypoints, and the assumptions of the first frames and of the height, if it is set."""
    height = () if keys.get("height_m") is None else (HEIGHT,)
    return component_traits(dataset=KEYPOINTS, assumptions=(FIRST_FRAMES, *height))


@declares_traits(_traits)
def of_keypoints(
    clip: FrameCache, *, height_m: float | None = None, n_frames: int = 8, skeleton: str = "person"
) -> Body:
    """Return a body fitted to the keypoints of `n_frames` of a clip's first _MAX_FRAMES frames with keypoints, those
    that show most of the person in as many equal parts of them.

    height_m: the person's, which one camera cannot separate from the distance; None: an adult's, 1.70 m ± 10 cm.
    skeleton: see `person_on`; feet are as long as an average person's with such legs. Raises InputError if none of the
    frames has MIN_KEYPOINTS joints, for heights as `from_height`, and for an unknown skeleton.
    """
    average = person_on(skeleton, from_height(AVERAGE_M if height_m is None else height_m))
    plain = person_skeleton(average.shape)
    usable = (
        keypoints
        for frame in without_images(clip)
        if enough_keypoints(Observed(np.empty((0, 3)), keypoints := frame_keypoints(plain, frame)))
    )
    candidates = list(islice(usable, _MAX_FRAMES))
    if not candidates:
        raise InputError("body: expected keypoints in the dataset's frames to fit the limb lengths, found none")
    observations = best_observed(candidates, n_frames)
    measurement = fit_lengths(observations, height_m)
    lengths = ", ".join(f"{name} {100.0 * getattr(measurement.shape, name):.1f}" for name in LENGTHS[4:])
    log.info(
        "limb lengths fitted in %d frames, residual %.1f px: %s cm", len(observations), measurement.error_px, lengths
    )
    body, std = person_on(skeleton, measurement.shape), measurement.length_uncertainty
    if skeleton == "feet":
        std = _with_feet(body, std)
    return replace(body, limb_length_std=std)


def best_observed(frames: Sequence[tuple[Keypoints, ...]], n: int) -> list[tuple[Keypoints, ...]]:
    """Return of n equal parts of frames the frame in which the weights of the joints have the largest sum."""
    parts = np.array_split(np.arange(len(frames)), min(n, len(frames)))
    weights = np.array([sum(float(view.detections[:, 2].sum()) for view in views) for views in frames])
    return [frames[part[weights[part].argmax()]] for part in parts]


def fit_lengths(
    observations: Sequence[Sequence[Keypoints]], height_m: float | None = None, keypoint_sigma: float = KEYPOINT_SIGMA
) -> _MeasuredLengths:
    """Return the lengths and poses of best fit to the keypoints of T frames, all views of a frame together.

    The logarithms of the height and of every length over it are normal, see AVERAGE_M, PROPORTION_SIGMA and
    WIDTH_SIGMA. Joints have the standard deviation keypoint_sigma / √weight, in heights of the person in the image.
    Raises InputError if the fitted height is impossible, see `from_height`.
    """
    sigma_px = keypoint_sigma * np.array([person_px(views) for views in observations])
    start = np.zeros(1 + len(LENGTHS))
    start[0] = 0.0 if height_m is None else np.log(height_m / AVERAGE_M)
    deviations = np.array([WIDTH_SIGMA if name in WIDTHS else PROPORTION_SIGMA for name in ("height", *LENGTHS)])
    deviations[0] = HEIGHT_SIGMA if height_m is None else KNOWN_HEIGHT_SIGMA
    first = start.copy()
    if height_m is None:
        first[0] = np.log(_initial_height_m(observations) / AVERAGE_M)
    poses = _initial_poses(person_skeleton(shape_of(first)), observations, sigma_px)
    nominal = nominal_pose_prior(person_skeleton(shape_of(start)))
    mean = np.concatenate([start, np.tile(nominal.mean, len(poses))])
    whitening = np.concatenate([1.0 / deviations, np.tile(np.diag(nominal.whitening), len(poses))])
    regularized = whitening > 0.0

    def project(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        return _project(x[: len(start)], x[len(start) :].reshape(poses.shape), observations, sigma_px)

    def residuals(x: FloatArray) -> FloatArray:
        return np.concatenate([project(x)[0], ((x - mean) * whitening)[regularized]])

    def jacobian(x: FloatArray) -> FloatArray:
        return np.vstack([project(x)[1], np.diag(whitening)[regularized]])

    x = scipy.optimize.least_squares(
        residuals, np.concatenate([first, poses.ravel()]), jacobian, loss="huber", f_scale=SEARCH_LOSS.scale,
        x_scale="jac", max_nfev=50, ftol=1e-4,  # which moves lengths by less than a millimetre
    ).x  # fmt: skip
    n_keypoints = sum(len(keypoints.joints) for views in observations for keypoints in views)
    error_px = float(np.median(sigma_px) * np.sqrt((project(x)[0] ** 2).sum() / n_keypoints))
    lengths, rows = x[: len(start)], jacobian(x)
    if height_m is None:
        from_height(height_of(lengths))  # raises for an impossible height, which trial steps may have
    covariance = np.linalg.pinv(rows.T @ rows, hermitian=True)[: len(start), : len(start)]  # Laplace approximation
    length_uncertainty = _by_length(lengths) @ np.linalg.cholesky(covariance)
    return _MeasuredLengths(shape_of(lengths), x[len(start) :].reshape(poses.shape), error_px, length_uncertainty)


def _initial_height_m(observations: Sequence[Sequence[Keypoints]]) -> float:
    """Return AVERAGE_M, or the height by triangulated limbs where several cameras show that it is not an adult's."""
    cameras = list({view.camera.name: view.camera for views in observations for view in views}.values())
    pixels = np.full((len(cameras), len(observations), len(JOINT_NAMES), 2), np.nan)
    for t, views in enumerate(observations):
        for view in views:
            v = next(k for k, camera in enumerate(cameras) if camera.name == view.camera.name)
            pixels[v, t, view.joints] = view.detections[:, :2]
    limbs = limb_lengths(triangulate(cameras, pixels)) if len(cameras) > 1 else {}
    height_m = usual_height(limbs) if limbs else AVERAGE_M
    return AVERAGE_M if HEIGHTS_M[0] < height_m < HEIGHTS_M[1] else height_m


def height_of(lengths: FloatArray) -> float:
    """Return the height, m, of lengths (9,) as in `shape_of`."""
    return AVERAGE_M * float(np.exp(lengths[0]))


def shape_of(lengths: FloatArray) -> Shape:
    """Return the shape of lengths (9,): logarithms of the height over AVERAGE_M, and of LENGTHS over the average's."""
    average = from_height(1.0, upper_arm=UPPER_ARM, forearm=FOREARM).scaled(height_of(lengths))
    factor = dict(zip(LENGTHS, np.exp(lengths[1:]).tolist(), strict=True))
    (x, y, z), (ahead, aside, up), (_, half, _) = average.head, average.shoulder, average.hip
    return replace(
        average, neck=(0.0, 0.0, factor["torso"] * average.neck[2]), hip=(0.0, factor["hips"] * half, 0.0),
        shoulder=(ahead, factor["shoulders"] * aside, factor["torso"] * up),
        head=(factor["head"] * x, factor["head"] * y, factor["head"] * z),
        **{name: factor[name] * getattr(average, name) for name in LENGTHS[4:]},
    )  # fmt: skip


def _project(
    lengths: FloatArray, poses: FloatArray, views_of_frames: Sequence[Sequence[Keypoints]], sigma_px: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the whitened residuals (K,) of all keypoints, and their Jacobian (K, G + T P) by lengths and poses."""
    skeleton = person_skeleton(shape_of(lengths))
    by_pose, by_lengths = joint_jacobian(skeleton, poses), length_jacobian(skeleton, _by_length(lengths), poses)
    positions, residuals, jacobians = forward(skeleton, poses).positions, [], []
    for t, views in enumerate(views_of_frames):
        for view in views:
            pixels, weights = view.detections[:, :2], view.detections[:, 2:]
            whitening, camera, points = np.sqrt(weights) / sigma_px[t], view.camera, positions[t, view.joints]
            errors = np.nan_to_num((camera.project(points) - pixels) * whitening, nan=1e3)
            by_point = projection_jacobian(camera, points) * whitening[..., None]
            rows, first = np.zeros((errors.size, len(lengths) + poses.size)), len(lengths) + t * poses.shape[1]
            rows[:, : len(lengths)] = (by_point @ by_lengths[t, view.joints]).reshape(errors.size, -1)
            rows[:, first : first + poses.shape[1]] = (by_point @ by_pose[t, view.joints]).reshape(errors.size, -1)
            residuals.append(errors.ravel())
            jacobians.append(rows)
    return np.concatenate(residuals), np.vstack(jacobians)


def _with_feet(body: Body, length_uncertainty: FloatArray) -> FloatArray:
    """Return errors (J, 3, G + 1) of a body with feet by those (15, 3, G) without: feet are as wrong as the legs, and
    by PROPORTION_SIGMA."""
    knee, ankle = (body.skeleton.joint(f"left_{joint}") for joint in ("knee", "ankle"))
    legs = -(length_uncertainty[knee, 2] + length_uncertainty[ankle, 2]) / (body.shape.thigh + body.shape.calf)
    feet = body.skeleton.offsets[len(length_uncertainty) :, :, None] * np.append(legs, PROPORTION_SIGMA)
    return np.concatenate([np.pad(length_uncertainty, ((0, 0), (0, 0), (0, 1))), feet])


def _by_length(lengths: FloatArray) -> FloatArray:
    """Return the Jacobian (J, 3, G) of the skeleton's offsets by lengths (G,).

    Offsets are linear in the height and in every length over the average's: doubling one of them adds the derivative by
    its logarithm.
    """
    offsets = person_skeleton(shape_of(lengths)).offsets
    doubled = [person_skeleton(shape_of(lengths + step)).offsets for step in np.log(2.0) * np.eye(len(lengths))]
    return np.stack(doubled, axis=-1) - offsets[..., None]


def _initial_poses(skeleton: Skeleton, observations: Sequence[Sequence[Keypoints]], sigma_px: FloatArray) -> FloatArray:
    """Return poses (T, P) of the average person, each the best from all headings."""
    prior = nominal_pose_prior(skeleton)
    residuals = [
        views_residual(skeleton, views, float(sigma), np.inf)
        for views, sigma in zip(observations, sigma_px, strict=True)
    ]
    return np.array([
        likely_poses(skeleton, views, residual, prior, 1)[0]
        for views, residual in zip(observations, residuals, strict=True)
    ])  # fmt: skip
