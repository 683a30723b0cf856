"""Outcome of a run: whether the person was tracked, frame by frame, by ground truth, annotations or keypoints."""

import numpy as np

from workbench.evaluation.finding import DOUBTFUL, NOT_USABLE, TRUSTWORTHY, Finding
from workbench.evaluation.run_measurements import RunMeasurements
from workbench.evaluation.track_loss import FOREARM_OVER_HEIGHT, TRACKED_MM, WINDOW_FRAMES, lost_frames, lost_states
from workbench.utils.arrays import BoolArray, FloatArray

TRACKED, LOST, UNKNOWN = "tracked", "lost", "not known"
"""States of a frame, with DOUBTFUL."""
_MOSTLY, _FAR = 0.5, 2.0
"""A run is not usable if at least this fraction of its frames is lost, with mean errors of at least this many
thresholds: a trunk's depth."""
_NORMAL_90 = 1.645
"""Half width of a normal distribution's 90 % interval, in standard deviations."""
_DRIFT_S = 0.5
"""Time over which the error in space is averaged, a step of a walk: shorter errors are of limbs and detections."""


def outcome(measured: RunMeasurements, shows_person: bool) -> tuple[Finding, tuple[str, ...]]:
    """Return whether the person was tracked, and the states (F,) of the frames, "" in a run without errors.

    A frame is lost where the error in the image or in space reaches its threshold, see `lost_frames`; without ground
    truth, also where the distance from the keypoints does. Others are doubtful as of `doubtful_frames`. The first
    frame, whose pose may be given, is tracked.
    shows_person: the dataset has observations of the person.
    """
    n, details = len(measured.frames), _details(measured)
    errors = {name: values[1:] for name, values in measured.errors.items()}
    of_errors = lost_frames({name: values.tolist() for name, values in errors.items()})
    known = _evaluated(measured)
    if of_errors is None and not known.any():
        return _unknown(measured, shows_person, details), ("",) * n
    lost = np.zeros(n, dtype=bool)
    if not _has_truth(measured):
        distances_px, widths_px = _keypoint_distances(measured)
        lost |= lost_states(distances_px.tolist(), widths_px.tolist())
    lost[1:] |= False if of_errors is None else of_errors
    lost[:1] &= of_errors is None
    doubtful = doubtful_frames(measured)
    states = [UNKNOWN if not known[k] else LOST if lost[k] else DOUBTFUL if doubtful[k] else TRACKED for k in range(n)]
    states[:1] = [TRACKED] if not (lost | doubtful)[:1].any() else [LOST if lost[0] else DOUBTFUL]
    if n == 1 and of_errors is not None:
        return Finding("no ground truth", _and("only one frame, whose pose is given", details)), ("",)
    if lost.any():
        excess = float(np.nanmean(_relative_errors(measured)[lost & known])) if (lost & known).any() else 0.0
        is_usable = lost[known].mean() < _MOSTLY or excess < _FAR
        return _lost(measured, lost, known, DOUBTFUL if is_usable else NOT_USABLE, details), tuple(states)
    if of_errors is None:
        return Finding("no ground truth", f"no ground truth, {details}", TRUSTWORTHY), tuple(states)
    n_evaluated = int(np.isfinite(errors["mpjpe_px" if "mpjpe_px" in errors else "mpjpe_abs_mm"]).sum())
    where = f"in all {n_evaluated} {'' if _has_truth(measured) else 'annotated '}frames after the first"
    return Finding(TRACKED, _and(f"tracked {where}", details), TRUSTWORTHY), tuple(states)


def doubtful_frames(measured: RunMeasurements) -> BoolArray:
    """Return whether the error in space exceeds TRACKED_MM and the 90 % interval that the run states for the depth of
    one camera, or the error expected by the posterior exceeds LOST_MM, (F,)."""
    doubtful: BoolArray = np.array([bool(groups) for groups in measured.uncertain_groups], dtype=bool)
    in_space, steps_s = measured.errors.get("mpjpe_abs_mm"), np.diff(measured.times_s)
    if in_space is not None and len(steps_s):
        window = max(WINDOW_FRAMES, int(_DRIFT_S / np.median(steps_s)) if np.median(steps_s) > 0.0 else 0)
        limits = np.fmax(TRACKED_MM, _NORMAL_90 * 1e3 * measured.depth_std_m)
        doubtful[1:] |= lost_states(in_space[1:].tolist(), limits[1:].tolist(), window)
    return doubtful


def _evaluated(measured: RunMeasurements) -> BoolArray:
    """Return the frames with an error or, without ground truth, with keypoints, (F,)."""
    valid = {name: np.isfinite(values) for name, values in measured.errors.items()}
    if _has_truth(measured):
        in_image = valid.get("mpjpe_px", False) & valid.get("forearm_width_px", valid["mpjpe_abs_mm"])
        return np.asarray(in_image | valid["mpjpe_abs_mm"])
    by_keypoints = np.isfinite(measured.keypoint_error_px).any(axis=1)
    return np.asarray(by_keypoints | valid.get("mpjpe_px", False))


def _has_truth(measured: RunMeasurements) -> bool:
    return "mpjpe_abs_mm" in measured.errors


def _keypoint_distances(measured: RunMeasurements) -> tuple[FloatArray, FloatArray]:
    """Return the distances from the keypoints, and a forearm's width in the image, means over views, (F,) each, px."""
    width_px = FOREARM_OVER_HEIGHT * mean_over_views(measured.person_height_px)
    return mean_over_views(measured.keypoint_error_px), np.where(width_px > 0.0, width_px, np.nan)


def _relative_errors(measured: RunMeasurements) -> FloatArray:
    """Return the largest of a frame's errors (F,) over their thresholds; NaN without any."""
    errors = measured.errors
    distance_px, width_px = _keypoint_distances(measured)
    each = [errors["mpjpe_abs_mm"] / TRACKED_MM] if "mpjpe_abs_mm" in errors else [distance_px / width_px]
    if "mpjpe_px" in errors and "forearm_width_px" in errors:
        each.append(errors["mpjpe_px"] / errors["forearm_width_px"])
    return np.asarray(np.fmax.reduce(each))


def _lost(measured: RunMeasurements, lost: BoolArray, known: BoolArray, level: str, details: str) -> Finding:
    """Describe a loss in frames (F,); known: the evaluated ones."""
    first = int(np.flatnonzero(lost)[0])
    text = f"lost from frame {measured.frames[first]}"
    if not lost[-1]:
        text += f", recovered from frame {measured.frames[int(np.flatnonzero(lost)[-1]) + 1]}"
    return Finding(LOST, _and(f"{text}, {lost[known].mean():.0%} of the frames", details), level)


def _unknown(measured: RunMeasurements, shows_person: bool, details: str) -> Finding:
    """Return the outcome of a run without any error."""
    if not shows_person:
        return Finding("no person visible", "no frame shows a person: the estimate is drawn from the prior", NOT_USABLE)
    inliers = measured.inlier_fraction
    if measured.has_points:
        near = f": {np.nanmean(inliers):.0%} of them lie near the body" if has_values(inliers) else ""
        text = _and(f"no ground truth, only the points themselves to compare with{near}", details)
        return Finding("no ground truth", text, TRUSTWORTHY if near else DOUBTFUL)
    text = "nothing but the images shows whether the person was tracked: inspect them, or annotate some frames"
    return Finding("no ground truth", text)


def _details(measured: RunMeasurements) -> str:
    """Return mean errors after the first frame with units, the distances from annotations and keypoints, and the
    uncertainty of one camera's depth."""
    forms = {"mpjpe_abs_mm": "absolute MPJPE {:.0f} mm", "pa_mpjpe_mm": "PA-MPJPE {:.0f} mm"}
    forms |= {"mpjpe_px": "{:.1f} px"} if _has_truth(measured) else {}
    errors = {name: measured.errors[name][1:] for name in forms if name in measured.errors}
    parts = [forms[name].format(float(np.nanmean(each))) for name, each in errors.items() if has_values(each)]
    if not _has_truth(measured):
        parts += [_annotation_error(measured), _keypoint_error(measured)]
    depth_m = measured.depth_std_m
    if has_values(depth_m) and not _has_truth(measured):
        parts.append(f"depth known to ± {np.nanmedian(depth_m):.2f} m")
    return ", ".join(filter(None, parts))


def _annotation_error(measured: RunMeasurements) -> str:
    """Describe the distance from annotated joints after the first frame, whose annotations may start a run; or ""."""
    px, heights = measured.errors.get("mpjpe_px", np.full(1, np.nan))[1:], measured.annotation_height_px[1:]
    if not has_values(px):
        return ""
    valid = np.isfinite(px) & np.isfinite(heights) & (heights > 0.0)
    relative = f", {np.mean(px[valid] / heights[valid]):.1%} of the person's height" if valid.any() else ""
    return f"{np.nanmean(px):.1f} px from the joints annotated in {int(np.isfinite(px).sum())} frames{relative}"


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


def mean_over_views(table: FloatArray) -> FloatArray:
    """Return the mean (F,) over views (F, V), NaN ignored, NaN where all are."""
    valid = np.isfinite(table)
    total = np.where(valid, table, 0.0).sum(axis=1)
    return np.where(valid.any(axis=1), total / np.maximum(valid.sum(axis=1), 1), np.nan)


def has_values(values: FloatArray) -> bool:
    """Return whether any value is not NaN."""
    return bool(np.isfinite(values).any())


def _and(text: str, details: str) -> str:
    return f"{text}, {details}" if details else text
