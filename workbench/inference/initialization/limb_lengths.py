"""How long a person's limbs are, from 2-D joints in the first frames: least squares over lengths and poses together."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from workbench.body.kinematics import forward, joint_jacobian, length_jacobian
from workbench.body.limbs import Body, person
from workbench.body.shape import Shape, from_height
from workbench.body.skeleton import Skeleton, person_skeleton
from workbench.core.capabilities import KEYPOINTS, Traits, declaring, offering
from workbench.core.frame_cache import FrameCache
from workbench.core.observations import Keypoints, Observed, frame_keypoints, person_px
from workbench.core.prior import REFERENCE_RATE_HZ
from workbench.core.residual import projection_jacobian
from workbench.core.side_information import FIRST_FRAMES, HEIGHT
from workbench.inference.least_squares.hypotheses import KEYPOINT_LOSS, enough_keypoints, likely_poses
from workbench.inference.least_squares.residuals import posture_prior, views_residual
from workbench.inference.least_squares.single_frame import PoseDecoder, fit_frame
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

log = logging.getLogger(__name__)

LENGTHS = ("torso", "shoulders", "hips", "head", "upper_arm", "forearm", "thigh", "calf")
"""What may differ from the average person, beside the height."""
AVERAGE_M, HEIGHT_SIGMA, GIVEN_SIGMA = 1.70, 0.06, 0.01
"""Adults' height and the standard deviation of its logarithm; and that of a height that is given."""
PROPORTION_SIGMA = 0.05
"""Of the logarithm of a length over the height: people differ by some 4 %, and detectors' joints are not
anatomists'."""
WIDTHS, WIDTH_SIGMA = ("shoulders", "hips"), 0.1
"""Detectors' hips and shoulders are 30 to 50 mm from anatomists' (Needham et al. 2021), which is more of a width."""
UPPER_ARM, FOREARM = 0.162, 0.154
"""Over the height, between joints' centres (de Leva 1996), as detectors see them; from_height's is measured from the
shoulder's top."""
KEYPOINT_SIGMA = 0.03
"""Of a joint, in heights of the person in the image: detectors are off by 1 to 2 %, but alike in frames that follow
each other, so that eight say little more than one."""


@dataclass(frozen=True, eq=False)
class _MeasuredLengths:
    """shape: the person's. poses: (T, P) in the frames looked at. error_px: root mean square distance to the marks.
    doubt: (J, 3, G) by how much the skeleton's offsets may be off, see `Body.limb_length_std`."""

    shape: Shape
    poses: FloatArray
    error_px: float
    doubt: FloatArray


def _traits(keys: Mapping[str, Any]) -> Traits:
    """Declare that joints of the first frames measure the person, and the height where it is given."""
    height = () if keys.get("height_m") is None else (HEIGHT,)
    return offering(dataset=KEYPOINTS, given=(FIRST_FRAMES, *height))


@declaring(_traits)
def of_keypoints(clip: FrameCache, *, height_m: float | None = None, n_frames: int = 8) -> Body:
    """Measure a person by the keypoints of a clip's first `n_frames` that are a 14th of a second apart.

    height_m: the person's, which one camera cannot tell from the distance; None: an adult's, 1.70 m, give or take 10
    cm. Raises InputError where fewer than LEAST_KEYPOINTS joints are seen in every one of these frames, and heights as
    `from_height` does.
    """
    skeleton = person_skeleton(from_height(AVERAGE_M if height_m is None else height_m))
    seen, last_s = list[tuple[Keypoints, ...]](), -np.inf
    for frame in clip:
        if len(seen) == n_frames:
            break
        keypoints = frame_keypoints(skeleton, frame)
        if frame.time_s - last_s > 0.99 / REFERENCE_RATE_HZ and enough_keypoints(Observed(np.empty((0, 3)), keypoints)):
            seen.append(keypoints)
            last_s = frame.time_s
    if not seen:
        raise InputError("body: expected keypoints in the dataset's frames to measure the person by, found none")
    measured = measure(seen, height_m)
    lengths = ", ".join(f"{name} {100.0 * getattr(measured.shape, name):.1f}" for name in LENGTHS[4:])
    log.info("limbs measured in %d frames, residual %.1f px: %s cm", len(seen), measured.error_px, lengths)
    return replace(person(measured.shape), limb_length_std=measured.doubt)


def measure(
    seen: Sequence[Sequence[Keypoints]], height_m: float | None = None, keypoint_sigma: float = KEYPOINT_SIGMA
) -> _MeasuredLengths:
    """Return lengths and poses that fit the keypoints of T frames best, all views of a frame together.

    The logarithms of the height and of every length over it are normal, see AVERAGE_M, PROPORTION_SIGMA and
    WIDTH_SIGMA; joints have the deviation keypoint_sigma, in the person's heights in the image, over the root of their
    weight.
    """
    sigma_px = keypoint_sigma * person_px(seen[0])
    start = np.zeros(1 + len(LENGTHS))
    start[0] = 0.0 if height_m is None else np.log(height_m / AVERAGE_M)
    spread = np.array([WIDTH_SIGMA if name in WIDTHS else PROPORTION_SIGMA for name in ("height", *LENGTHS)])
    spread[0] = HEIGHT_SIGMA if height_m is None else GIVEN_SIGMA
    poses = _first_poses(person_skeleton(shape_of(start)), seen, sigma_px)
    usual = posture_prior(person_skeleton(shape_of(start)))
    mean = np.concatenate([start, np.tile(usual.mean, len(poses))])
    whitening = np.concatenate([1.0 / spread, np.tile(np.diag(usual.whitening), len(poses))])
    tied = whitening > 0.0

    def project(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        return _project(x[: len(start)], x[len(start) :].reshape(poses.shape), seen, sigma_px)

    def misses(x: FloatArray) -> FloatArray:
        return np.concatenate([project(x)[0], ((x - mean) * whitening)[tied]])

    def slopes(x: FloatArray) -> FloatArray:
        return np.vstack([project(x)[1], np.diag(whitening)[tied]])

    x = scipy.optimize.least_squares(
        misses, np.concatenate([start, poses.ravel()]), slopes, loss="huber", f_scale=KEYPOINT_LOSS.scale,
        x_scale="jac", max_nfev=50,
    ).x  # fmt: skip
    n_marks = sum(len(keypoints.joints) for views in seen for keypoints in views)
    error_px = sigma_px * float(np.sqrt((project(x)[0] ** 2).sum() / n_marks))
    lengths, slope = x[: len(start)], slopes(x)
    covariance = np.linalg.pinv(slope.T @ slope, hermitian=True)[: len(start), : len(start)]  # Laplace's
    doubt = _by_length(lengths) @ np.linalg.cholesky(covariance)
    return _MeasuredLengths(shape_of(lengths), x[len(start) :].reshape(poses.shape), error_px, doubt)


def shape_of(lengths: FloatArray) -> Shape:
    """Make a person of lengths (9,): logarithms of the height over AVERAGE_M, and of LENGTHS over the average's."""
    height = AVERAGE_M * float(np.exp(lengths[0]))
    average = from_height(height, upper_arm=UPPER_ARM * height, forearm=FOREARM * height)
    factor = dict(zip(LENGTHS, np.exp(lengths[1:]).tolist(), strict=True))
    (x, y, z), (ahead, aside, up), (_, half, _) = average.head, average.shoulder, average.hip
    return replace(
        average, neck=(0.0, 0.0, factor["torso"] * average.neck[2]), hip=(0.0, factor["hips"] * half, 0.0),
        shoulder=(ahead, factor["shoulders"] * aside, factor["torso"] * up),
        head=(factor["head"] * x, factor["head"] * y, factor["head"] * z),
        **{name: factor[name] * getattr(average, name) for name in LENGTHS[4:]},
    )  # fmt: skip


def _project(
    lengths: FloatArray, poses: FloatArray, seen: Sequence[Sequence[Keypoints]], sigma_px: float
) -> tuple[FloatArray, FloatArray]:
    """Return whitened residuals (K,) of all keypoints, and their derivative (K, G + T P) by lengths and poses."""
    skeleton = person_skeleton(shape_of(lengths))
    by_pose, by_lengths = joint_jacobian(skeleton, poses), length_jacobian(skeleton, _by_length(lengths), poses)
    places, misses, slopes = forward(skeleton, poses).positions, [], []
    for t, views in enumerate(seen):
        for view in views:
            white, camera, own = np.sqrt(view.marks[:, 2:]) / sigma_px, view.camera, places[t, view.joints]
            miss = np.nan_to_num((camera.project(own) - view.marks[:, :2]) * white, nan=1e3)
            lens = projection_jacobian(camera, own) * white[..., None]
            slope, first = np.zeros((miss.size, len(lengths) + poses.size)), len(lengths) + t * poses.shape[1]
            slope[:, : len(lengths)] = (lens @ by_lengths[t, view.joints]).reshape(miss.size, -1)
            slope[:, first : first + poses.shape[1]] = (lens @ by_pose[t, view.joints]).reshape(miss.size, -1)
            misses.append(miss.ravel())
            slopes.append(slope)
    return np.concatenate(misses), np.vstack(slopes)


def _by_length(lengths: FloatArray) -> FloatArray:
    """Differentiate the skeleton's offsets by lengths (G,), (J, 3, G)."""
    steps = 1e-6 * np.eye(len(lengths))
    offsets = [person_skeleton(shape_of(lengths + sign * step)).offsets for step in steps for sign in (1.0, -1.0)]
    return np.stack([(up - down) / 2e-6 for up, down in zip(offsets[::2], offsets[1::2], strict=True)], axis=-1)


def _first_poses(skeleton: Skeleton, seen: Sequence[Sequence[Keypoints]], sigma_px: float) -> FloatArray:
    """Return poses (T, P) of the average person: the first from nothing, the others each from the one before."""
    prior = posture_prior(skeleton)
    residuals = [views_residual(skeleton, views, sigma_px, np.inf) for views in seen]
    poses = [likely_poses(skeleton, seen[0], residuals[0], prior, 1)[0]]
    for residual in residuals[1:]:
        poses.append(fit_frame(PoseDecoder(skeleton), residual, KEYPOINT_LOSS, poses[-1], prior=prior).x)
    return np.array(poses)
