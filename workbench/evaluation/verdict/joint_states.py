"""States of joints and body in every frame: tracked, doubtful, lost or not seen."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import median_filter

from workbench.body.skeleton import JOINT_NAMES
from workbench.body.stature import SIDES
from workbench.cameras.observed_joints import MIN_JOINTS, MIN_WEIGHT
from workbench.evaluation.errors.track_loss import TRACKED_MM, UNCERTAIN_MM
from workbench.evaluation.verdict.identity_findings import another_person
from workbench.evaluation.verdict.landmark_agreement import (
    MAX_FACING_DEG,
    MAX_KNEE_DEG,
    facing_deg,
    knee_differences_deg,
)
from workbench.evaluation.verdict.repeated_frames import frozen_frames
from workbench.evaluation.verdict.run_measurements import RunMeasurements
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.crossings import WINDOW_FRAMES
from workbench.utils.finding import DOUBTFUL
from workbench.utils.nan_statistics import nan_median

TRACKED, LOST, NOT_SEEN, UNKNOWN = "tracked", "lost", "not seen", "not known"
"""States of a joint or a frame, with DOUBTFUL; UNKNOWN where nothing shows whether it is tracked."""
JOINT_GROUPS = {
    "torso": ("pelvis", "neck", "head_centre", "left_shoulder", "right_shoulder", "left_hip", "right_hip"),
    **{f"{side}_arm": (f"{side}_elbow", f"{side}_wrist") for side in SIDES},
    **{f"{side}_leg": (f"{side}_knee", f"{side}_ankle") for side in SIDES},
}
"""Joints by part of the body."""
MAX_CONFUSION_S = 0.2
"""Longest time for which a detector confuses joints while a fit is right: one leg of a walking person hides the other.
"""
LASTING_S = 0.5
"""Duration from which on landmarks or detections contradict an estimate: longer than a detector's confusions of front
and back, and about a step of a walk."""
_DETECTOR_STD = 0.033 / 1.7
"""Standard deviation of a detected joint along each axis of the image, over the person's height: the difference of its
definition from another one's, 33 mm (Needham et al., Scientific Reports 11, 2021) of an adult."""
DOUBTFUL_DISTANCE, LOST_DISTANCE = 3.0 * _DETECTOR_STD, 6.0 * _DETECTOR_STD
"""Distances of a joint from its detections or annotations, over the person's height, from which on it is doubtful or
lost: 0.06 and 0.12, the latter half the length of a thigh."""
_MIN_LOST = 0.5
"""Fraction of the joints that are seen of which on the body is lost with them."""


@dataclass(frozen=True, eq=False)
class JointStates:
    """States of the joints in F frames, as whether one holds, (F, J) each.

    doubtful: for a reason other than the distance, see `joint_states`. far, lost: the distance from the detected,
    annotated or true joint is doubtful; the joint is lost by it. seen: some camera sees the joint. compared: (F,)
    whether anything shows where the joints are.
    """

    doubtful: BoolArray
    far: BoolArray
    lost: BoolArray
    seen: BoolArray
    compared: BoolArray

    @cached_property
    def body_lost(self) -> BoolArray:
        """Return whether at least _MIN_LOST of a frame's joints that are seen are lost, (F,)."""
        n_lost, n_seen = (self.lost & self.seen).sum(axis=1), self.seen.sum(axis=1)
        return np.asarray((n_seen >= MIN_JOINTS) & (n_lost >= _MIN_LOST * n_seen))

    def of_joints(self, names: tuple[str, ...]) -> list[str]:
        """Return the worst state of some joints in every frame, F; NOT_SEEN where no camera sees any of them."""
        k = [JOINT_NAMES.index(name) for name in names]
        seen = self.seen[:, k]
        lost, doubtful = (self.lost[:, k] & seen).any(axis=1), ((self.doubtful | self.far)[:, k] & seen).any(axis=1)
        words = np.where(lost, LOST, np.where(doubtful, DOUBTFUL, np.where(seen.any(axis=1), TRACKED, NOT_SEEN)))
        return list(np.where(self.compared, words, UNKNOWN).tolist())


def joint_states(measured: RunMeasurements) -> JointStates:
    """Return the states of the joints.

    A joint is far or lost where its distance from the detections (the median over cameras), from the annotations or
    from the true joint exceeds a threshold in most frames of MAX_CONFUSION_S before and after. Otherwise it is
    doubtful where the posterior expects an error of more than UNCERTAIN_MM relative to the root, and where the
    landmarks contradict the direction of the torso, or the flexion of the knee above it, for LASTING_S. All joints are
    lost where all cameras that show the person are frozen, and where they show another person.
    """
    times_s = measured.times_s
    true, annotated = 1e3 * measured.joint_errors_m / TRACKED_MM, annotation_distances(measured) / DOUBTFUL_DISTANCE
    scaled = true if measured.has_truth else relative_distances(measured) / DOUBTFUL_DISTANCE
    window = odd_window(times_s)
    excess = running_median(scaled, window)
    doubtful = measured.expected_joint_errors_m > 1e-3 * UNCERTAIN_MM
    if not measured.has_truth:
        excess = np.where(np.isfinite(annotated), annotated, excess)
        doubtful |= contradicted_facing(measured)[:, None]
        knees = contradicted_knees(measured)
        for side, name in enumerate(SIDES):
            doubtful[:, [JOINT_NAMES.index(f"{name}_{joint}") for joint in ("knee", "ankle")]] |= knees[:, side, None]
    seen = np.isfinite(true) if measured.has_truth else _seen(measured, window)
    far, lost = excess >= 1.0, excess >= LOST_DISTANCE / DOUBTFUL_DISTANCE
    if not measured.has_truth:
        lost |= _not_followed(measured)[:, None]
    return JointStates(doubtful, far, lost, seen, np.asarray(np.isfinite(excess).any(axis=1)))


def relative_distances(measured: RunMeasurements) -> FloatArray:
    """Return the distances of joints from their detections over the person's height, the median over views, (F, J)."""
    heights = measured.person_height_px[:, :, None]
    return nan_median(measured.keypoint_distances_px / np.where(heights > 0.0, heights, np.nan), axis=1)


def annotation_distances(measured: RunMeasurements) -> FloatArray:
    """Return the distances of joints from annotations over the person's height in them, (F, J), NaN in frame 0."""
    heights = measured.annotation_height_px[:, None]
    distances = measured.annotation_distances_px / np.where(heights > 0.0, heights, np.nan)
    distances[:1] = np.nan  # its annotations may start the run
    return distances


def contradicted_facing(measured: RunMeasurements) -> BoolArray:
    """Return in which frames (F,) the landmarks' torso faces more than MAX_FACING_DEG elsewhere for LASTING_S."""
    return lasting(facing_deg(measured) > MAX_FACING_DEG, measured.times_s)


def contradicted_knees(measured: RunMeasurements) -> BoolArray:
    """Return in which frames (F, 2) the flexion of left and right knee differs from the landmarks' by more than
    MAX_KNEE_DEG for LASTING_S."""
    differs = np.abs(knee_differences_deg(measured)) > MAX_KNEE_DEG
    return np.stack([lasting(each, measured.times_s) for each in differs.T], axis=1)


def lasting(chosen: BoolArray, times_s: FloatArray) -> BoolArray:
    """Return the frames of the stretches of chosen frames (F,) that last for LASTING_S, at least WINDOW_FRAMES.

    A stretch lasts from its first frame to the one after it, and may be interrupted for MAX_CONFUSION_S.
    """
    lasts = np.zeros(len(chosen), bool)
    for first, last in stretches(chosen, times_s):
        end_s = times_s[min(last + 1, len(times_s) - 1)]
        lasts[first : last + 1] = end_s - times_s[first] >= LASTING_S and last - first + 1 >= WINDOW_FRAMES
    return lasts


def stretches(chosen: BoolArray, times_s: FloatArray) -> list[tuple[int, int]]:
    """Return the first and last frame of every stretch of chosen frames (F,), interrupted for up to MAX_CONFUSION_S."""
    frames: IntArray = np.flatnonzero(chosen)
    if not len(frames):
        return []
    breaks = np.flatnonzero((np.diff(frames) > 1) & (np.diff(times_s[frames]) > MAX_CONFUSION_S))
    firsts, lasts = frames[np.r_[0, breaks + 1]], frames[np.r_[breaks, len(frames) - 1]]
    return [(int(first), int(last)) for first, last in zip(firsts, lasts, strict=True)]


def odd_window(times_s: FloatArray) -> int:
    """Return an odd number of frames that last for MAX_CONFUSION_S before and after, at least WINDOW_FRAMES."""
    steps_s = np.diff(times_s)
    step_s = float(np.median(steps_s)) if len(steps_s) else 0.0
    return max(2 * round(MAX_CONFUSION_S / step_s) + 1, WINDOW_FRAMES) if step_s > 0.0 else WINDOW_FRAMES


def running_median(values: FloatArray, window: int) -> FloatArray:
    """Return the medians (F, K) of values (F, K) over windows of frames that have one, NaN in the others."""
    medians = np.full(values.shape, np.nan)
    for k, column in enumerate(values.T):
        valid = np.isfinite(column)
        if valid.any():
            medians[valid, k] = median_filter(column[valid], min(window, 2 * int(valid.sum()) - 1), mode="nearest")
    return medians


def _not_followed(measured: RunMeasurements) -> BoolArray:
    """Return in which frames (F,) the keypoints are frozen in all cameras, or of another person."""
    shows_person, frozen = measured.observed.shows_person, frozen_frames(measured)
    all_frozen = np.any(frozen, axis=1) & ~np.any(shows_person & ~frozen, axis=1)
    return np.asarray(all_frozen | another_person(measured))


def _seen(measured: RunMeasurements, window: int) -> BoolArray:
    """Return whether some camera sees a joint with MIN_WEIGHT in most of the frames around that show the person, or the
    joint is annotated, (F, J)."""
    seen: BoolArray = np.any(np.isfinite(measured.observed.pixels(MIN_WEIGHT)[..., 0]), axis=0)
    shows_person: BoolArray = np.any(measured.observed.shows_person, axis=1)
    around = running_median(np.where(shows_person[:, None], seen, np.nan), window)
    return np.asarray((around > 0.5) | np.isfinite(annotation_distances(measured)))
