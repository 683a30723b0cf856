"""Errors of estimated poses and joints, in space and in the image; joints that are not known (NaN) are left out.

Estimates and truths are (..., J, D): D is 3 (m) or 2 (px), J the joints that are measured. HumanEva's errors are of
Sigal, Balan & Black, IJCV 87 (2010), eq. 4 and 5; what else is named is what the field reports by that name.
"""

from collections import deque
from collections.abc import Sequence

import numpy as np

from workbench.body.angles import N_POSITION, flexions, wrapped_deg
from workbench.body.camera import Camera
from workbench.body.kinematics import forward, joints
from workbench.body.limbs import Body
from workbench.body.skeleton import POSE_NAMES, Skeleton
from workbench.core.frame import Frame, Truth, true_cameras
from workbench.core.step import Step
from workbench.evaluation.step_calibration import joint_calibration, pose_calibration
from workbench.utils.arrays import FloatArray

_PCK_M = 0.15
"""Threshold of the percentage of correct keypoints in space (Mehta et al., 3DV 2017): half a head's height."""
_MIN_FOR_PROCRUSTES = 4
"""Joints below which a similarity explains nearly anything."""
_OF_MAX_WEIGHT = ("error_abs_mm", "error_rel_mm")
"""Errors in space that are reported of the heaviest particle, too."""


def step_errors(
    step: Step, body: Body, moving: Sequence[str] = POSE_NAMES, image_scale: float = 1.0
) -> dict[str, float]:
    """Measure what a step's truth allows: errors of the expected pose, and three (`_map`) of the heaviest particle.

    The mean is over the joints that the parameters `moving`, those the prior moves, can move, but the root, which is 14
    of the person's: for a tracked arm elbow and wrist. error_abs_mm: their mean distance. error_rel_mm: the same after
    moving pelvis onto pelvis. error_procrustes_mm: after the best similarity. humaneva_mm: over all joints with the
    root, HumanEva's 15. pck_150mm: fraction of the joints within 15 cm. error_px: mean distance in the first view's
    image, in pixels of the unscaled image (`image_scale` is the factor the image was resized by); where joints were
    marked by hand, over the visible marks. The estimate is seen through the camera as it is told, as it is drawn over
    the image, and the true joints through the camera that took the image (`Truth.cameras`), where marks would lie: as
    with marked video, what counts is whether the estimate lies on the person in the image. forearm_px: width of a
    forearm in the same pixels, the yardstick of `held`, where the true joints are known. coverage_50, coverage_90,
    crps_mm, crps_deg, z2, log_score: how true the posterior is, see `step_calibration`; where the true pose is not
    known, of the joints' coordinates. error_angle_deg: the mean turn between joints' frames and the true ones, relative
    to their parents'. knee_deg, hip_deg: see `flexion_errors`. activity_accuracy: 1 where the activity told is the true
    one.
    """
    truth = step.frame.truth
    if truth is None:
        return {}
    skeleton, measured = body.skeleton, moved_joints(body.skeleton, moving)
    poses = {"": step.expected_pose} | ({} if step.map_pose is step.expected_pose else {"_map": step.map_pose})
    estimates = joints(skeleton, np.stack([*poses.values()]))
    errors: dict[str, float] = {}
    for suffix, estimate in zip(poses, estimates, strict=True):
        if truth.joints is not None:
            in_space = joint_errors(measured, estimate, truth.joints)
            errors |= {name + suffix: in_space[name] for name in in_space if not suffix or name in _OF_MAX_WEIGHT}
        pixels = _pixel_error(step.frame, measured, estimate, truth) if step.frame.views else None
        if pixels is not None:
            errors[f"error_px{suffix}"] = pixels / image_scale
    if len(poses) == 1:
        errors |= {f"{name}_map": errors[name] for name in (*_OF_MAX_WEIGHT, "error_px") if name in errors}
    cameras = [view.camera for view in step.frame.views]
    if truth.joints is not None and len(measured) == len(skeleton.names) - 1 and cameras:
        views = zip(cameras, true_cameras(step.frame), strict=True)
        places = truth.joints
        distances = [_pixel_distances(told, estimates[0], took.project(places)).mean() for told, took in views]
        error = float(np.mean(distances)) / image_scale
        errors |= {"humaneva_px": error} if np.isfinite(error) else {}
    if truth.joints is not None and "error_px" in errors:
        errors["forearm_px"] = forearm_px(cameras[0], body, truth.joints, measured) / image_scale
    if truth.pose is not None:
        errors |= pose_calibration(step, skeleton)
        errors["error_angle_deg"] = angle_error_deg(skeleton, step.expected_pose, truth.pose, moving)
        errors |= flexion_errors(skeleton, step.expected_pose, truth.pose)
    elif truth.joints is not None:
        errors |= joint_calibration(step, skeleton, truth.joints, measured)
    if truth.activity is not None and step.activity is not None:
        errors["activity_accuracy"] = float(step.activity == truth.activity)
    return errors


def flexion_errors(skeleton: Skeleton, pose: FloatArray, truth: FloatArray) -> dict[str, float]:
    """Return knee_deg and hip_deg: root mean square error of the flexion of both legs, degrees, where the skeleton has
    it. Whole turns are no error: where nothing keeps an angle within its limits, a fit may end a turn away."""
    estimate, true, errors = flexions(skeleton, pose), flexions(skeleton, truth), {}
    for joint in ("knee", "hip"):
        apart = [wrapped_deg(estimate[name] - true[name]) for name in estimate if name.endswith(joint)]
        if apart:
            errors[f"{joint}_deg"] = float(np.sqrt(np.mean(np.square(apart))))
    return errors


def moved_joints(skeleton: Skeleton, moving: Sequence[str]) -> list[int]:
    """List the joints, but the root, that a parameter called in `moving` moves: those below the one it turns."""
    turned = {int(skeleton.dof_joints[skeleton.dof(name)]) for name in moving}
    translated = any(skeleton.dof(name) < 3 for name in moving)

    def moves(joint: int) -> bool:
        above = int(skeleton.parents[joint])
        return translated or (above >= 0 and (above in turned or moves(above)))

    return [joint for joint in range(1, len(skeleton.names)) if moves(joint)]


def forearm_px(camera: Camera, body: Body, true_joints: FloatArray, measured: Sequence[int]) -> float:
    """Return the mean width of the forearm in the image, px, seen at the mean depth of the measured joints (J, 3)."""
    width_m = float(np.sum(body.shape.forearm_radii))  # the mean of the two ends' diameters
    depth_m = float(np.nanmean(camera.to_camera(true_joints)[list(measured), 2]))
    return float(camera.matrix[0, 0]) * width_m / depth_m


def joint_errors(measured: Sequence[int], estimate: FloatArray, truth: FloatArray) -> dict[str, float]:
    """Return errors in space of joints (J, 3), m, against true joints (J, 3), m, over those measured whose truth is
    known (not NaN); what needs more than is known is left out."""
    places, true = estimate[list(measured)], truth[list(measured)]
    whole = len(measured) == len(truth) - 1
    errors = {
        "error_abs_mm": 1e3 * float(mean_distance(places, true)),
        "error_rel_mm": 1e3 * float(mean_distance(places - estimate[0], true - truth[0])),
        "error_procrustes_mm": 1e3 * procrustes(places, true),
        "humaneva_mm": 1e3 * float(mean_distance(estimate, truth)) if whole else np.nan,
        "pck_150mm": float(correct_keypoints(places, true, _PCK_M)),
    }
    return {name: error for name, error in errors.items() if np.isfinite(error)}


class AccelerationError:
    """acceleration_error_m_s2: of the expected pose's joints against the true ones', in the frame before the one that
    comes in, over the joints that parameters called `moving` move. Unlike the others it tells shaking from standing
    beside."""

    def __init__(self, skeleton: Skeleton, moving: Sequence[str] = POSE_NAMES) -> None:
        self._skeleton, self._measured = skeleton, moved_joints(skeleton, moving)
        self._last: deque[tuple[float, FloatArray, FloatArray]] = deque(maxlen=3)

    def add(self, step: Step) -> dict[str, float]:
        """Return the error, where this frame and the two before have a truth."""
        truth = step.frame.truth
        if truth is None or truth.joints is None:
            self._last.clear()
            return {}
        places = joints(self._skeleton, step.expected_pose[None])[0]
        self._last.append((step.frame.time_s, places[self._measured], truth.joints[self._measured]))
        if len(self._last) < 3:
            return {}
        times_s, estimate, true = (np.array(part) for part in zip(*self._last, strict=True))
        (error,) = acceleration_error(estimate, true, times_s)
        return {"acceleration_error_m_s2": float(error)} if np.isfinite(error) else {}


def angle_error_deg(skeleton: Skeleton, pose: FloatArray, truth: FloatArray, moving: Sequence[str]) -> float:
    """Return the mean turn, degrees, between joints' frames in poses (P,), each seen from its parent's, and the true
    ones, over the joints that parameters called `moving` turn. Unlike single angles it knows no singular poses."""
    rotations = forward(skeleton, np.stack([pose, truth])).rotations
    local = rotations.copy()
    children = np.flatnonzero(skeleton.parents >= 0)
    local[:, children] = np.swapaxes(rotations[:, skeleton.parents[children]], -1, -2) @ rotations[:, children]
    turned = sorted({int(skeleton.dof_joints[p]) for p in map(skeleton.dof, moving) if p >= N_POSITION})
    return float(geodesic_deg(local[0, turned], local[1, turned]).mean()) if turned else 0.0


def _pixel_distances(camera: Camera, estimate: FloatArray, truth_px: FloatArray) -> FloatArray:
    """Return distances (J,), px, of joints (J, 3), m, in the image from true pixels (J, 2); of an estimate behind the
    camera the image's diagonal, NaN where the truth is not seen."""
    apart = np.linalg.norm(camera.project(estimate) - truth_px, axis=1)
    behind = ~np.isfinite(apart) & np.isfinite(truth_px).all(axis=1)
    return np.where(behind, np.hypot(camera.width, camera.height), apart)


def _pixel_error(frame: Frame, measured: Sequence[int], estimate: FloatArray, truth: Truth) -> float | None:
    camera = frame.views[0].camera
    if truth.annotations is not None:
        marks = truth.annotations
        if truth.annotations_visible is not None:
            marks = np.where(truth.annotations_visible[:, None], marks, np.nan)
        distances = _pixel_distances(camera, estimate, marks)
    elif truth.joints is not None:
        true = true_cameras(frame)[0].project(truth.joints)
        distances = _pixel_distances(camera, estimate, true)[list(measured)]
    else:
        return None
    return float(np.nanmean(distances)) if np.isfinite(distances).any() else None


def mean_distance(estimate: FloatArray, truth: FloatArray) -> FloatArray:
    """Return the mean distance (...), in the unit given, NaN where no joint is known: MPJPE, which is HumanEva's 3-D
    error (eq. 4) over its 15 virtual markers, and its 2-D error (eq. 5) for pixels."""
    return _mean(np.linalg.norm(estimate - truth, axis=-1))


def procrustes(estimate: FloatArray, truth: FloatArray) -> float:
    """Return the mean distance, m, of joints (J, 3) after the similarity (turn, shift, scale) that brings them nearest
    in the mean square (Umeyama 1991): PA-MPJPE. NaN for joints all in one place or fewer than _MIN_FOR_PROCRUSTES."""
    known = np.isfinite(truth).all(axis=1)
    if known.sum() < _MIN_FOR_PROCRUSTES:
        return float("nan")
    centred, true = estimate[known] - estimate[known].mean(axis=0), truth[known] - truth[known].mean(axis=0)
    size = float((centred**2).sum())
    if size == 0.0:
        return float("nan")
    left, singular, right = np.linalg.svd(true.T @ centred)
    proper = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])  # a turn, not a mirror
    rotation, scale = (left * proper) @ right, float((singular * proper).sum()) / size
    return float(mean_distance(scale * centred @ rotation.T, true))


def correct_keypoints(estimate: FloatArray, truth: FloatArray, threshold: float) -> FloatArray:
    """Return PCK, the fraction (...) of known joints nearer than `threshold`, in the unit given, or NaN."""
    apart = np.linalg.norm(estimate - truth, axis=-1)
    return _mean(np.where(np.isnan(apart), np.nan, apart < threshold))


def acceleration_error(estimate: FloatArray, truth: FloatArray, times_s: FloatArray) -> FloatArray:
    """Return the mean distance (F − 2,), m/s², between the accelerations of joints (F, J, 3) in frames at times (F,),
    s. Frames may be uneven: accelerations are second divided differences, which are exact for parabolas."""
    return mean_distance(accelerations(estimate, times_s), accelerations(truth, times_s))


def accelerations(places: FloatArray, times_s: FloatArray) -> FloatArray:
    """Return second derivatives (F − 2, J, 3), m/s², of places (F, J, 3), m, at times (F,), s, rising."""
    gaps = np.diff(times_s)[:, None, None]
    velocities = np.diff(places, axis=0) / gaps
    return 2.0 * np.diff(velocities, axis=0) / (gaps[1:] + gaps[:-1])


def geodesic_deg(estimate: FloatArray, truth: FloatArray) -> FloatArray:
    """Return angles (...), degrees, of the turns between rotations (..., 3, 3): the geodesic distance on SO(3)."""
    between = np.swapaxes(estimate, -1, -2) @ truth
    # by sine and cosine, as the arccosine of the trace loses half its digits near zero; SciPy's Rotation.magnitude is
    # the same to 4e-14 degrees, not to the bit
    axis = between[..., [2, 0, 1], [1, 2, 0]] - between[..., [1, 2, 0], [2, 0, 1]]
    trace = np.trace(between, axis1=-2, axis2=-1)
    return np.degrees(np.arctan2(np.linalg.norm(axis, axis=-1), trace - 1.0))


def _mean(apart: FloatArray) -> FloatArray:
    """Return the mean over the last axis of what is not NaN; NaN where nothing is."""
    known = np.isfinite(apart)
    n = known.sum(axis=-1)
    total = np.where(known, apart, 0.0).sum(axis=-1)
    return np.where(n > 0, total / np.maximum(n, 1), np.nan)
