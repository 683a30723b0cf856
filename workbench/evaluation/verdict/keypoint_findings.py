"""Findings on keypoints that no person has: in no order of time, too fast, or of impossible proportions."""

from collections.abc import Iterator

import numpy as np

from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES, joint_of
from workbench.body.stature import LIMBS, SIDES
from workbench.cameras.image_height import height_px
from workbench.cameras.observed_joints import MIN_WEIGHT, some_frames
from workbench.evaluation.verdict.run_measurements import RunMeasurements
from workbench.utils.arrays import FloatArray
from workbench.utils.finding import DOUBTFUL, NOT_USABLE, Finding
from workbench.utils.nan_statistics import nan_median

_MIN_FRAMES, _MAX_STEP_S = 15, 1.0 / 15.0
"""Frames, and the time between two, from which on their order is known: a runner's limbs move by a tenth of a stride
within 1/15 s, and by as much as between any two frames within a fifth."""
_MAX_DISORDER = 0.7
"""Distance of a joint from its place in the frame before over the distance between any two frames: sin 18° / sin 45° =
0.44 for a tenth of a cycle, and 1 for frames in no order."""
_MIN_MOTION, _MIN_JOINTS = 0.075, 4
"""Distance between any two frames, in heights, from which on a joint moves: three times that of a detector's joints at
rest, of σ = 0.015 heights, 1.18 √2 σ in the median. Number of such joints: two limbs."""
_COMPARED_FRAMES = 60
"""Evenly spread frames of which every two are compared."""
_MAX_SPEED, _SPEED_S = 7.0, 0.1
"""Heights per second over this time: a sprinter of 1.95 m at 12.4 m/s moves by 6.4."""
_MAX_LIMB, _WRONG_LIMB = 2.0, 3.0
"""Height of a person with the longest limb in the image over the height in the image, from head to ankle, in the median
frame: a person who crouches is half as high, and no person folds into a third."""
_UPPER = [JOINT_NAMES.index(name) for name in ("head_centre", "left_shoulder", "right_shoulder")]
_ANKLES = [JOINT_NAMES.index(f"{side}_ankle") for side in SIDES]


def keypoint_findings(measured: RunMeasurements) -> Iterator[Finding]:
    """Yield the findings on the keypoints of each camera."""
    pixels, times_s = measured.observed.pixels(MIN_WEIGHT), measured.times_s
    for name, each in zip(measured.cameras, pixels, strict=True):
        shown = np.isfinite(each[..., 0]).any(axis=1)
        heights = height_px(each[shown])
        if shown.sum() < 2 or not (heights > 0.0).any() or (np.diff(times_s) <= 0.0).any():
            continue
        camera = f"{name}: " if len(measured.cameras) > 1 else ""
        relative = each[shown] / float(np.median(heights[heights > 0.0]))
        if (disorder := _disorder(relative, times_s[shown])) > _MAX_DISORDER:
            text = f"neighbouring frames differ by {disorder:.0%} of any two: they are in no order of time"
            yield Finding("impossible motion", f"{camera}{text}", NOT_USABLE)
        if (speed := _speed(relative, times_s[shown])) > _MAX_SPEED:
            text = f"the keypoints move by {speed:.0f} heights of the person per second, a sprinter by 6"
            yield Finding("impossible motion", f"{camera}{text}")
        if (limb := _longest_limb(each[shown])) > _MAX_LIMB:
            text = f"the longest limb in the image is that of a person {limb:.1f} times as high: joints are exchanged"
            level = DOUBTFUL if limb < _WRONG_LIMB else NOT_USABLE
            yield Finding("impossible proportions", f"{camera}{text}, or none", level)


def _disorder(joints: FloatArray, times_s: FloatArray) -> float:
    """Return the distance between neighbouring frames over that between any two, of joints (F, J, 2) in heights: the
    median over the joints that move; 0 for a few of them, or for few frames."""
    if len(joints) < _MIN_FRAMES or np.median(np.diff(times_s)) > _MAX_STEP_S:
        return 0.0
    some = joints[some_frames(len(joints), _COMPARED_FRAMES)]
    one, other = np.triu_indices(len(some), 1)
    between_any = nan_median(np.linalg.norm(some[one] - some[other], axis=-1).T)
    steps = nan_median(np.linalg.norm(np.diff(joints, axis=0), axis=-1).T)
    moving = (between_any > _MIN_MOTION) & np.isfinite(steps)
    return float(np.median(steps[moving] / between_any[moving])) if moving.sum() >= _MIN_JOINTS else 0.0


def _speed(joints: FloatArray, times_s: FloatArray) -> float:
    """Return the speed of joints (F, J, 2) in heights over _SPEED_S, a median over joints and frames; 0 if unknown."""
    step_s = float(np.median(np.diff(times_s)))
    n = max(1, round(_SPEED_S / step_s))
    speeds = np.linalg.norm(joints[n:] - joints[:-n], axis=-1) / (times_s[n:] - times_s[:-n])[:, None]
    return float(np.nan_to_num(nan_median(nan_median(speeds))))


def _longest_limb(pixels: FloatArray) -> float:
    """Return the height by an average person's proportions of the longest limb of joints (F, J, 2), px, over their
    height, the median over the frames with head or shoulders and ankles; 0 without."""
    average = from_height(1.0)
    seen = np.isfinite(pixels[..., 0])
    whole = pixels[seen[:, _UPPER].any(axis=1) & seen[:, _ANKLES].any(axis=1)]
    if not len(whole):
        return 0.0
    limbs = [(getattr(average, limb), [joint_of(whole, f"{side}_{end}") for end in ends])
             for limb, ends in LIMBS.items() for side in SIDES]  # fmt: skip
    implied = np.stack([np.linalg.norm(a - b, axis=1) / length for length, (a, b) in limbs])
    longest = np.nan_to_num(implied).max(axis=0)
    return float(np.median(longest / np.maximum(height_px(whole), 1e-9)))
