"""Errors of estimated poses and joints, in space and in the image; unknown joints (NaN) are ignored.

Estimates and truths are (..., J, D): D is 3 (m) or 2 (px), J the measured joints. HumanEva's errors are of Sigal, Balan
& Black, IJCV 87 (2010), eq. 4 and 5; the other names are standard.
"""

from collections import deque
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from workbench.body.angles import N_POSITION, flexions, wrapped_deg
from workbench.body.kinematics import forward, joints
from workbench.body.limbs import Body
from workbench.body.shape import FOREARM_OVER_HEIGHT
from workbench.body.skeleton import JOINT_NAMES, POSE_NAMES, Skeleton
from workbench.cameras.camera import Camera
from workbench.cameras.image_height import height_px
from workbench.core.frame import HUMANEVA_HEAD_M, Frame, Truth, true_cameras
from workbench.core.step import Step
from workbench.evaluation.uncertainty.step_calibration import given_parameters, joint_calibration, pose_calibration
from workbench.utils.arrays import FloatArray
from workbench.utils.nan_statistics import nan_mean

_PCK_M = 0.15
"""Threshold of the percentage of correct keypoints in space (Mehta et al., 3DV 2017): half a head's height."""
_MIN_FOR_PROCRUSTES = 4
"""Joints below which a similarity explains nearly anything."""
_OF_MAX_WEIGHT = ("mpjpe_abs_mm", "mpjpe_mm")
"""Errors in space that are also reported of the particle with the largest weight."""


def step_errors(
    step: Step,
    body: Body,
    moving: Sequence[str] = POSE_NAMES,
    image_scale: float = 1.0,
    initial: FloatArray | None = None,
) -> dict[str, float]:
    """Return the errors of a step against its truth; {} without one.

    They are errors of the expected pose; with the suffix _max_weight three of them are those of the particle with the
    largest weight. Means are over the joints below the parameters `moving`, without the root: 14 of a person, elbow and
    wrist of a tracked arm.

    They are defined in `metrics.METRICS`. humaneva_mm is over all joints with the root, HumanEva's 15, or over
    HumanEva's own markers where the truth has them.

    mpjpe_px: mean joint error in the first view, in pixels of the unscaled image; over the visible annotations where
    joints are annotated. humaneva_px: the same over all views. The estimate is projected by the assumed camera, and the
    true joints by the camera that took the image (`Truth.cameras`), where annotations would lie: the error is that of
    the position in the image. forearm_width_px: a forearm's width in the same pixels, the threshold of `tracked`, where
    the true joints are known; of an average person of the annotations' height, where joints are annotated.

    The calibration of the posterior is that of `step_calibration`; without a true pose, of the joints' coordinates.

    Parameters
    ----------
    step, body : the estimate and the tracked body.
    moving : the parameters that the prior moves.
    image_scale : factor by which the images were resized.
    initial : (P,) the true pose in the first frame, by which `given_parameters` are selected; None: none are.
    """
    truth = step.frame.truth
    if truth is None:
        return {}
    skeleton, measured = body.skeleton, moved_joints(body.skeleton, moving)
    poses = {"": step.expected_pose} | ({} if step.map_pose is step.expected_pose else {"_max_weight": step.map_pose})
    estimates = [step.expected_joints(skeleton), *(joints(skeleton, step.map_pose[None]) if len(poses) > 1 else ())]
    errors: dict[str, float] = {}
    of_views: list[FloatArray] = []
    n_views = len(step.frame.views) if len(measured) == len(skeleton.names) - 1 else 1
    for suffix, estimate in zip(poses, estimates, strict=True):
        if truth.joints is not None:
            in_space = joint_errors(measured, estimate, truth.joints)
            errors |= {name + suffix: in_space[name] for name in in_space if not suffix or name in _OF_MAX_WEIGHT}
        distances = _true_distances_px(step.frame, estimate, truth, 1 if suffix else n_views)
        of_views = of_views or distances
        pixels = _pixel_error(step.frame, measured, estimate, truth, distances) if step.frame.views else None
        if pixels is not None:
            errors[f"mpjpe_px{suffix}"] = pixels / image_scale
    if len(poses) == 1:
        errors |= {f"{name}_max_weight": errors[name] for name in (*_OF_MAX_WEIGHT, "mpjpe_px") if name in errors}
    if of_views and len(measured) == len(skeleton.names) - 1:
        error = float(np.mean([distances.mean() for distances in of_views])) / image_scale
        errors |= {"humaneva_px": error} if np.isfinite(error) else {}
    if truth.joints is not None and "mpjpe_px" in errors:
        camera = step.frame.views[0].camera
        errors["forearm_width_px"] = forearm_width_px(camera, body, truth.joints, measured) / image_scale
    elif truth.annotations is not None and "mpjpe_px" in errors:
        errors["forearm_width_px"] = FOREARM_OVER_HEIGHT * float(height_px(truth.annotations)) / image_scale
    if truth.virtual_markers is not None and len(measured) == len(skeleton.names) - 1:
        errors |= humaneva_errors(step.frame, estimates[0], truth.virtual_markers, image_scale)
    if truth.pose is not None:
        given = None if initial is None else given_parameters(skeleton, moving, truth.pose, initial)
        errors |= pose_calibration(step, skeleton, given)
        errors["mpjae_local_deg"] = angle_error_deg(skeleton, step.expected_pose, truth.pose, moving)
        errors |= flexion_errors(skeleton, step.expected_pose, truth.pose)
    elif truth.joints is not None:
        errors |= joint_calibration(step, skeleton, truth.joints, measured)
    if truth.activity is not None and step.activity is not None:
        errors["activity_accuracy"] = float(step.activity == truth.activity)
    return errors


def flexion_errors(skeleton: Skeleton, pose: FloatArray, truth: FloatArray) -> dict[str, float]:
    """Return knee_flexion_rmse_deg and hip_flexion_rmse_deg, over both legs, where the skeleton has these joints.

    Whole turns are no error: without limits a fit may end a turn away.
    """
    estimate, true, errors = flexions(skeleton, pose), flexions(skeleton, truth), {}
    for joint in ("knee", "hip"):
        residuals = [wrapped_deg(estimate[name] - true[name]) for name in estimate if name.endswith(joint)]
        if residuals:
            errors[f"{joint}_flexion_rmse_deg"] = float(np.sqrt(np.mean(np.square(residuals))))
    return errors


def humaneva_errors(
    frame: Frame, estimate: FloatArray, markers: FloatArray, image_scale: float = 1.0
) -> dict[str, float]:
    """Return humaneva_mm and humaneva_px of estimated joints (J, 3), m, by HumanEva's virtual markers (J, 2, 3), m.

    A joint's error is the mean of its distances from both markers, in px also over the views. The head's marker is on
    the line from the neck through the head's centre, at HUMANEVA_HEAD_M, as the true one is on the axis of the head.
    """
    places, neck, head = estimate.copy(), JOINT_NAMES.index("neck"), JOINT_NAMES.index("head_centre")
    upwards = estimate[head] - estimate[neck]
    places[head] = estimate[neck] + HUMANEVA_HEAD_M * upwards / np.linalg.norm(upwards)
    errors = {"humaneva_mm": 1e3 * float(nan_mean(np.linalg.norm(places[:, None] - markers, axis=-1).mean(axis=1)))}
    cameras = zip((view.camera for view in frame.views), true_cameras(frame), strict=True)
    of_views = [
        np.mean([_pixel_distances(used, places, true.project(markers[:, end])) for end in (0, 1)], axis=0)
        for used, true in cameras
    ]
    if of_views:
        errors["humaneva_px"] = float(nan_mean(np.concatenate(of_views))) / image_scale
    return {name: error for name, error in errors.items() if np.isfinite(error)}


def moved_joints(skeleton: Skeleton, moving: Sequence[str]) -> list[int]:
    """Return the joints without the root that a parameter in `moving` moves: those below the joint that it rotates."""
    return [*_moved_joints(skeleton, tuple(moving))]


@lru_cache
def _moved_joints(skeleton: Skeleton, moving: tuple[str, ...]) -> tuple[int, ...]:
    turned = {int(skeleton.dof_joints[skeleton.dof(name)]) for name in moving}
    translated = any(skeleton.dof(name) < 3 for name in moving)

    def moves(joint: int) -> bool:
        above = int(skeleton.parents[joint])
        return translated or (above >= 0 and (above in turned or moves(above)))

    return tuple(joint for joint in range(1, len(skeleton.names)) if moves(joint))


@lru_cache
def _turned_joints(skeleton: Skeleton, moving: tuple[str, ...]) -> list[int]:
    """Return the joints that parameters in `moving` rotate, in order."""
    return sorted({int(skeleton.dof_joints[p]) for p in map(skeleton.dof, moving) if p >= N_POSITION})


def forearm_width_px(camera: Camera, body: Body, true_joints: FloatArray, measured: Sequence[int]) -> float:
    """Return the forearm's mean width in the image, px, at the mean depth of the measured of true joints (J, 3), m."""
    width_m = float(np.sum(body.shape.forearm_radii))  # the mean of the two ends' diameters
    depth_m = float(np.nanmean(camera.to_camera(true_joints)[list(measured), 2]))
    return float(camera.matrix[0, 0]) * width_m / depth_m


def joint_errors(measured: Sequence[int], estimate: FloatArray, truth: FloatArray) -> dict[str, float]:
    """Return the errors in space of joints (J, 3), m, over the measured joints whose truth (J, 3), m, is not NaN.

    An error that needs more true joints than there are is omitted.
    """
    rows = list(measured)
    places, true, distances = estimate[rows], truth[rows], np.linalg.norm(estimate - truth, axis=-1)
    aligned = np.linalg.norm(places - estimate[0] - (true - truth[0]), axis=-1)
    hits = np.where(np.isnan(distances[rows]), np.nan, distances[rows] < _PCK_M)
    absolute, root_aligned, correct = nan_mean(np.stack([distances[rows], aligned, hits])).tolist()
    errors = {
        "mpjpe_abs_mm": 1e3 * absolute,
        "mpjpe_mm": 1e3 * root_aligned,
        "pa_mpjpe_mm": 1e3 * procrustes(places, true),
        "humaneva_mm": 1e3 * float(nan_mean(distances)) if len(measured) == len(truth) - 1 else np.nan,
        "pck_abs_150mm": correct,
    }
    return {name: error for name, error in errors.items() if np.isfinite(error)}


class AccelerationError:
    """Measures acceleration_error_m_s2, the mean error of the joints' accelerations in the frame before the added one.

    It is the expected pose's, over the joints that parameters in `moving` move. In contrast to the other errors it
    separates jitter from a constant offset.
    """

    def __init__(self, skeleton: Skeleton, moving: Sequence[str] = POSE_NAMES) -> None:
        self._skeleton, self._measured = skeleton, moved_joints(skeleton, moving)
        self._last: deque[tuple[float, FloatArray, FloatArray]] = deque(maxlen=3)

    def add(self, step: Step) -> dict[str, float]:
        """Return the error; {} unless this frame and the two before have a truth."""
        truth = step.frame.truth
        if truth is None or truth.joints is None:
            self._last.clear()
            return {}
        places = step.expected_joints(self._skeleton)
        self._last.append((step.frame.time_s, places[self._measured], truth.joints[self._measured]))
        if len(self._last) < 3:
            return {}
        times_s, estimate, true = (np.array(part) for part in zip(*self._last, strict=True))
        (error,) = acceleration_error(estimate, true, times_s)
        return {"acceleration_error_m_s2": float(error)} if np.isfinite(error) else {}


def angle_error_deg(skeleton: Skeleton, pose: FloatArray, truth: FloatArray, moving: Sequence[str]) -> float:
    """Return the mean angle, degrees, between the joints' rotations relative to their parents in two poses (P,).

    The mean is over the joints that parameters in `moving` rotate. In contrast to differences of single angles it has
    no singular poses.
    """
    rotations = forward(skeleton, np.stack([pose, truth])).rotations
    local = rotations.copy()
    children = np.flatnonzero(skeleton.parents >= 0)
    local[:, children] = np.swapaxes(rotations[:, skeleton.parents[children]], -1, -2) @ rotations[:, children]
    turned = _turned_joints(skeleton, tuple(moving))
    return float(geodesic_deg(local[0, turned], local[1, turned]).mean()) if turned else 0.0


def _pixel_distances(camera: Camera, estimate: FloatArray, truth_px: FloatArray) -> FloatArray:
    """Return distances (J,), px, of projected joints (J, 3), m, from true pixels (J, 2), NaN where these are.

    An estimate behind the camera counts as the image's diagonal.
    """
    distances = np.linalg.norm(camera.project(estimate) - truth_px, axis=1)
    behind = ~np.isfinite(distances) & np.isfinite(truth_px).all(axis=1)
    return np.where(behind, np.hypot(camera.width, camera.height), distances)


def _true_distances_px(frame: Frame, estimate: FloatArray, truth: Truth, n_views: int) -> list[FloatArray]:
    """Return the distances (J,), px, of joints (J, 3), m, from the true joints in the first views; [] without these."""
    if truth.joints is None:
        return []
    cameras = [*zip((view.camera for view in frame.views), true_cameras(frame), strict=True)][:n_views]
    return [_pixel_distances(used, estimate, true.project(truth.joints)) for used, true in cameras]


def _pixel_error(
    frame: Frame, measured: Sequence[int], estimate: FloatArray, truth: Truth, of_views: Sequence[FloatArray]
) -> float | None:
    """Return the mean joint error in the first view, px, or None where no true pixel is known.

    of_views: see `_true_distances_px`.
    """
    camera = frame.views[0].camera
    if truth.annotations is not None:
        pixels = truth.annotations
        if truth.annotations_visible is not None:
            pixels = np.where(truth.annotations_visible[:, None], pixels, np.nan)
        distances = _pixel_distances(camera, estimate, pixels)
    elif of_views:
        distances = of_views[0][list(measured)]
    else:
        return None
    return float(np.nanmean(distances)) if np.isfinite(distances).any() else None


def mean_distance(estimate: FloatArray, truth: FloatArray) -> FloatArray:
    """Return the mean distance (...) over joints in the unit of the input, NaN where no joint is known.

    It is the MPJPE in m, which over 15 virtual markers is HumanEva's 3-D error (eq. 4), and its 2-D error (eq. 5) in
    px.
    """
    return nan_mean(np.linalg.norm(estimate - truth, axis=-1))


def procrustes(estimate: FloatArray, truth: FloatArray) -> float:
    """Return the PA-MPJPE, m, of joints (J, 3): the mean distance after the least-squares similarity (Umeyama 1991).

    NaN for joints all in one place or fewer than _MIN_FOR_PROCRUSTES.
    """
    valid = np.isfinite(truth).all(axis=1)
    if valid.sum() < _MIN_FOR_PROCRUSTES:
        return float("nan")
    centred, true = estimate[valid] - estimate[valid].mean(axis=0), truth[valid] - truth[valid].mean(axis=0)
    size = float((centred**2).sum())
    if size == 0.0:
        return float("nan")
    rotation, stretched = best_rotation(centred, true)
    return float(mean_distance(stretched / size * centred @ rotation.T, true))


def best_rotation(centred: FloatArray, true: FloatArray) -> tuple[FloatArray, float]:
    """Return the rotation (3, 3) of centred points (K, 3) that is nearest to centred true ones in least squares, and
    the sum of the products of the turned points with the true ones: divided by Σ |x|² of the points, it is the best
    scale (Umeyama, *IEEE Trans. PAMI* 13, 1991)."""
    left, singular, right = np.linalg.svd(true.T @ centred)
    proper = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])  # a rotation, not a reflection
    return (left * proper) @ right, float((singular * proper).sum())


def acceleration_error(estimate: FloatArray, truth: FloatArray, times_s: FloatArray) -> FloatArray:
    """Return the mean distance (F − 2,), m/s², between the accelerations of joints (F, J, 3), m, at times (F,), s.

    Times may be uneven: accelerations are second divided differences, which are exact for parabolas.
    """
    return mean_distance(accelerations(estimate, times_s), accelerations(truth, times_s))


def accelerations(places: FloatArray, times_s: FloatArray) -> FloatArray:
    """Return second derivatives (F − 2, J, 3), m/s², of places (F, J, 3), m, at increasing times (F,), s."""
    gaps = np.diff(times_s)[:, None, None]
    velocities = np.diff(places, axis=0) / gaps
    return 2.0 * np.diff(velocities, axis=0) / (gaps[1:] + gaps[:-1])


def geodesic_deg(estimate: FloatArray, truth: FloatArray) -> FloatArray:
    """Return the geodesic distances (...) on SO(3), degrees, between rotations (..., 3, 3)."""
    between = np.swapaxes(estimate, -1, -2) @ truth
    # by sine and cosine, as the arccosine of the trace loses half its digits near zero; SciPy's Rotation.magnitude is
    # the same to 4e-14 degrees, not to the bit
    axis = between[..., [2, 0, 1], [1, 2, 0]] - between[..., [1, 2, 0], [2, 0, 1]]
    trace = np.trace(between, axis1=-2, axis2=-1)
    return np.degrees(np.arctan2(np.linalg.norm(axis, axis=-1), trace - 1.0))
