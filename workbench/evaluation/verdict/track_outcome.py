"""Outcome of a run: whether the person was tracked, frame by frame, by ground truth, annotations or keypoints."""

from collections.abc import Mapping

import numpy as np

from workbench.body.shape import FOREARM_OVER_HEIGHT
from workbench.body.skeleton import JOINT_NAMES
from workbench.evaluation.errors.track_loss import TRACKED_MM, criteria, lost_states
from workbench.evaluation.metrics import row_of
from workbench.evaluation.verdict.joint_states import LOST, TRACKED, UNKNOWN, JointStates
from workbench.evaluation.verdict.run_measurements import RunMeasurements
from workbench.utils.arrays import BoolArray, FloatArray
from workbench.utils.crossings import WINDOW_FRAMES
from workbench.utils.finding import DOUBTFUL, NOT_USABLE, NOTE, TRUSTWORTHY, Finding
from workbench.utils.nan_statistics import nan_mean

_MOSTLY, _FAR = 0.5, 2.0
"""A run is not usable if at least this fraction of its frames is lost, with mean errors of at least this many
thresholds: a trunk's depth."""
_NORMAL_90 = 1.645
"""Half width of a normal distribution's 90 % interval, in standard deviations."""
_DRIFT_S = 0.5
"""Time over which the error in depth is averaged, a step of a walk: shorter errors are of limbs and detections."""


def outcome(measured: RunMeasurements, joints: JointStates, shows_person: bool) -> tuple[Finding, tuple[str, ...]]:
    """Return whether the person was tracked, and the states (F,) of the frames, "" in a run without errors.

    A frame is lost where the error in the image or the root-aligned error reaches its threshold, see `criteria`;
    without ground truth, also where the distance from the keypoints does, or where most joints are lost. Others are
    doubtful as of `doubtful_frames`. The first frame, whose pose may be given, is tracked.
    joints: `joint_states` of the run. shows_person: the dataset has observations of the person.
    """
    n, details = len(measured.frames), _details(measured)
    has_errors, known = bool(criteria(measured.errors)), _evaluated(measured)
    if not has_errors and not known.any():
        return _unknown(measured, shows_person, details), ("",) * n
    losses = _losses(measured, joints)
    lost: BoolArray = np.any([np.zeros(n, dtype=bool), *losses.values()], axis=0)
    lost[:1] &= not has_errors
    evaluated = known & (np.arange(n) >= has_errors)  # the frames of `lost_fraction`
    doubtful = doubtful_frames(measured, joints)
    states = [UNKNOWN if not known[k] else LOST if lost[k] else DOUBTFUL if doubtful[k] else TRACKED for k in range(n)]
    states[:1] = [TRACKED] if not (lost | doubtful)[:1].any() else [LOST if lost[0] else DOUBTFUL]
    if n == 1 and has_errors:
        return Finding("no ground truth", _and("only one frame, whose pose is given", details)), ("",)
    if lost.any():
        excess = float(np.nanmean(_relative_errors(measured)[lost & known])) if (lost & known).any() else 0.0
        is_usable = lost[evaluated].mean() < _MOSTLY or excess < _FAR
        level, text = DOUBTFUL if is_usable else NOT_USABLE, _described_loss(measured, joints, losses, lost, evaluated)
        return Finding(LOST, _and(text, details), level), tuple(states)
    if not has_errors:
        return Finding("no ground truth", details, TRUSTWORTHY), tuple(states)
    n_evaluated = int(np.isfinite(next(iter(criteria(measured.errors).values()))[0][1:]).sum())
    annotated = "" if measured.has_truth else "annotated "
    frames = f"all {n_evaluated} {annotated}frames" if n_evaluated > 1 else f"the only {annotated}frame"
    where = f"in {frames} after the first"
    return Finding(TRACKED, _and(f"tracked {where}", details), TRUSTWORTHY), tuple(states)


def depth_drift(measured: RunMeasurements) -> tuple[str, BoolArray]:
    """Return a clause with the size of the estimate's drift along the line of sight, averaged over _DRIFT_S, in the
    frames after the first, "" below TRACKED_MM; and whether it is larger than TRACKED_MM and the 90 % interval that the
    run states for the depth, (F,)."""
    steps_s, error_mm = np.diff(measured.times_s), 1e3 * np.abs(measured.depth_error_m)
    error_mm[:1] = np.nan
    window = max(WINDOW_FRAMES, int(_DRIFT_S / np.median(steps_s)) if len(steps_s) and np.median(steps_s) > 0.0 else 0)
    limits = np.fmax(TRACKED_MM, _NORMAL_90 * 1e3 * measured.depth_std_m)
    drifts = lost_states(error_mm, np.full(len(error_mm), TRACKED_MM), window)
    message = f"depth drifted by {np.nanmax(error_mm[drifts]):.0f} mm" if drifts.any() else ""
    return message, lost_states(error_mm, limits, window)


def doubtful_frames(measured: RunMeasurements, joints: JointStates) -> BoolArray:
    """Return whether the depth drifted beyond its stated uncertainty, the error expected by the posterior exceeds
    UNCERTAIN_MM, or a joint is not tracked, (F,)."""
    uncertain: BoolArray = np.array([bool(groups) for groups in measured.uncertain_groups], dtype=bool)
    untracked: BoolArray = np.any(joints.seen & (joints.doubtful | joints.far | joints.lost), axis=1)
    return np.asarray(uncertain | depth_drift(measured)[1] | untracked)


def _losses(measured: RunMeasurements, joints: JointStates) -> dict[str, BoolArray]:
    """Return the lost frames (F,) by each criterion that loses any, described with its mean error in them."""
    after_first = {name: values[1:] for name, values in measured.errors.items()}
    losses: dict[str, BoolArray] = {}
    for name, (errors, thresholds) in criteria(after_first).items():
        if (lost := lost_states(errors, thresholds)).any():
            losses[row_of(name).words(float(np.nanmean(errors[lost])))] = np.concatenate([[False], lost])
    if not measured.has_truth:
        distances_px, widths_px = _keypoint_distances(measured)
        if (lost := lost_states(distances_px, widths_px)).any():
            losses[f"{np.nanmean(distances_px[lost]):.0f} px from the keypoints"] = lost
        if joints.body_lost.any():
            losses["most joints far from their detections"] = joints.body_lost
    return losses


def _evaluated(measured: RunMeasurements) -> BoolArray:
    """Return the frames with an error or, without ground truth, with keypoints, (F,)."""
    valid = {name: np.isfinite(values) for name, values in measured.errors.items()}
    if measured.has_truth:
        in_image = valid.get("mpjpe_px", False) & valid.get("forearm_width_px", valid["mpjpe_abs_mm"])
        return np.asarray(in_image | valid["mpjpe_abs_mm"])
    by_keypoints = np.isfinite(measured.keypoint_error_px).any(axis=1)
    return np.asarray(by_keypoints | valid.get("mpjpe_px", False))


def _keypoint_distances(measured: RunMeasurements) -> tuple[FloatArray, FloatArray]:
    """Return the distances from the keypoints, and a forearm's width in the image, means over views, (F,) each, px."""
    width_px = FOREARM_OVER_HEIGHT * nan_mean(measured.person_height_px)
    return nan_mean(measured.keypoint_error_px), np.where(width_px > 0.0, width_px, np.nan)


def _relative_errors(measured: RunMeasurements) -> FloatArray:
    """Return the largest of a frame's errors (F,) over their thresholds; NaN without any."""
    each = [errors / thresholds for errors, thresholds in criteria(measured.errors).values()]
    if not measured.has_truth:
        distance_px, width_px = _keypoint_distances(measured)
        each.append(distance_px / width_px)
    return np.asarray(np.fmax.reduce(each))


def _described_loss(
    measured: RunMeasurements, joints: JointStates, losses: Mapping[str, BoolArray], lost: BoolArray,
    evaluated: BoolArray,
) -> str:  # fmt: skip
    """Describe a loss in frames (F,): its first frame, by which errors (see `_losses`), the first frame from which on
    every joint is tracked, and the fraction of the evaluated frames."""
    first = int(np.flatnonzero(lost)[0])
    text = f"lost from frame {measured.frames[first]}: {' and '.join(text for text in losses if losses[text][first])}"
    if not lost[-1]:
        text += f", {_recovery(measured, joints, int(np.flatnonzero(lost)[-1]) + 1)}"
    return f"{text}, {lost[evaluated].mean():.0%} of the frames"


def _recovery(measured: RunMeasurements, joints: JointStates, end: int) -> str:
    """Describe the recovery from a loss up to frame `end`, excluded: where all joints stay tracked, or which do not."""
    away = (joints.seen & (joints.far | joints.lost))[end:]
    if not away.any():
        return f"recovered from frame {measured.frames[end]}"
    all_tracked = end + int(np.flatnonzero(away.any(axis=1))[-1]) + 1
    if all_tracked < len(measured.frames):
        return f"recovered from frame {measured.frames[all_tracked]}"
    names = " and ".join(JOINT_NAMES[k].replace("_", " ") for k in np.flatnonzero(away[-1]))
    return f"recovered from frame {measured.frames[end]} but for {names}"


def _unknown(measured: RunMeasurements, shows_person: bool, details: str) -> Finding:
    """Return the outcome of a run without any error."""
    if not shows_person:
        return Finding("no person visible", "nothing is observed, the motion is a sample of the prior", NOTE)
    inliers = measured.inlier_fraction
    if measured.has_points:
        near = f": {np.nanmean(inliers):.0%} of them lie near the body" if has_values(inliers) else ""
        text = _and(f"the points can only be compared with themselves{near}", details)
        return Finding("no ground truth", text, TRUSTWORTHY if near else DOUBTFUL)
    text = "nothing but the images shows whether the person was tracked: inspect them, or annotate some frames"
    return Finding("no ground truth", text)


def _details(measured: RunMeasurements) -> str:
    """Return mean errors after the first frame with units, the distances from annotations and keypoints, and the
    uncertainty of one camera's depth."""
    digits = {"mpjpe_abs_mm": 0, "mpjpe_mm": 0, "pa_mpjpe_mm": 0} | ({"mpjpe_px": 1} if measured.has_truth else {})
    errors = {name: measured.errors[name][1:] for name in digits if name in measured.errors}
    parts = [
        row_of(name).words(float(np.nanmean(each)), digits[name]) for name, each in errors.items() if has_values(each)
    ]
    if not measured.has_truth:
        parts += [_annotation_error(measured), _keypoint_error(measured)]
    drift, exceeds = depth_drift(measured)
    if drift and not exceeds.any():  # otherwise a finding
        parts.append(f"{drift}, within its 90 % interval")
    depth_m = measured.depth_std_m
    if has_values(depth_m) and not measured.has_truth:
        estimated = any(camera.uncertainty is not None for camera in measured.observed.cameras)
        reason = " as the camera is estimated" if estimated else ""
        parts.append(f"depth known to ± {np.nanmedian(depth_m):.2f} m{reason}")
    return ", ".join(filter(None, parts))


def _annotation_error(measured: RunMeasurements) -> str:
    """Describe the distance from annotated joints after the first frame, whose annotations may start a run; or ""."""
    px, heights = measured.errors.get("mpjpe_px", np.full(1, np.nan))[1:], measured.annotation_height_px[1:]
    if not has_values(px):
        return ""
    valid = np.isfinite(px) & np.isfinite(heights) & (heights > 0.0)
    relative = f", {np.mean(px[valid] / heights[valid]):.1%} of the person's height" if valid.any() else ""
    n = int(np.isfinite(px).sum())
    return f"{np.nanmean(px):.1f} px from the joints annotated in {n} frame{'s' if n > 1 else ''}{relative}"


def _keypoint_error(measured: RunMeasurements) -> str:
    """Describe the distances from the keypoints by camera, and over the person's height; "" without any."""
    px, heights = measured.keypoint_error_px, measured.person_height_px
    if not has_values(px):
        return ""
    each = [f"{name} {np.nanmean(px[:, v]):.1f}" for v, name in enumerate(measured.cameras) if has_values(px[:, v])]
    relative = float(np.nanmedian(px / np.where(heights > 0.0, heights, np.nan)))
    by_camera = f" ({', '.join(each)})" if len(each) > 1 else ""
    n = int(np.isfinite(px).any(axis=1).sum())
    return (
        f"joints {np.nanmean(px):.1f} px from the keypoints{by_camera}, {relative:.1%} of the person's height, in {n} "
        f"of {len(px)} frames"
    )


def has_values(values: FloatArray) -> bool:
    """Return whether any value is not NaN."""
    return bool(np.isfinite(values).any())


def _and(text: str, details: str) -> str:
    return f"{text}, {details}" if details else text
