"""Findings on a run's frames: their times, and stretches without observations of the person."""

from collections.abc import Iterator, Mapping

import numpy as np

from workbench.body.shape import FOREARM_OVER_HEIGHT
from workbench.evaluation.verdict.run_measurements import RunMeasurements
from workbench.utils.arrays import BoolArray, FloatArray
from workbench.utils.crossings import WINDOW_FRAMES
from workbench.utils.finding import DOUBTFUL, NOT_USABLE, NOTE, Finding

_MAX_JUMP = 5.0
"""Times the motion of the keypoints in the frames around. Even a kick at 30 Hz stays below twice, by the accelerations
that legs and arms are capable of."""
_MIN_JUMP_SPEED = 30.0 * FOREARM_OVER_HEIGHT
"""In heights per second, 2.2 m/s on average over all joints: a slower person may just begin to move."""
_JUMP_FRAMES = 10
_MIN_GAP_S = 0.25
"""Shortest reported gap in keypoints that are otherwise there in every frame: half a step of a walk."""
_RATE_TOLERANCE = 0.02
_MOSTLY_TRACKED, _HARDLY_TRACKED = 0.8, 0.4
"""Fractions of the frames that may show the person in which the person must be detected: with less than the first, more
than every fifth step is missing; with less than the second, most of the motion."""


def coverage(input_counts: Mapping[str, int]) -> Finding | None:
    """Return in how many frames of the video the person is detected; None if in all, or without detections.

    Frames that may show the person, but without a detection, lower the verdict; others, before the person enters or
    after the person leaves, do not. input_counts: as of `TargetPerson`.
    """
    n, unseen = input_counts.get("frames", 0), input_counts.get("frames_unseen", 0)
    if not unseen:
        return None
    lost = input_counts.get("frames_lost", 0)
    share = (n - unseen) / (n - unseen + lost)
    level = NOTE if share >= _MOSTLY_TRACKED else DOUBTFUL if share >= _HARDLY_TRACKED else NOT_USABLE
    text = f"tracked in {n - unseen} of {n} frames of the video"
    if 0 < lost < unseen:
        text += f", lost in {lost}"
    return Finding("person lost", text, level)


def time_findings(measured: RunMeasurements, rate_hz: float | None, file_hz: float | None) -> Iterator[Finding]:
    """Compare the frames' times with each other, with the configured rate, and this with the rate in the file."""
    steps_s = np.diff(measured.times_s)
    if (steps_s <= 0.0).any():
        k = int(np.flatnonzero(steps_s <= 0.0)[0])
        step = f"from {measured.times_s[k]:.3f} s to {measured.times_s[k + 1]:.3f} s"
        where = f"from frame {measured.frames[k]} to {measured.frames[k + 1]}"
        yield Finding("frame-rate mismatch", f"times do not increase, {where} they go {step}", NOT_USABLE)
        return
    if rate_hz and file_hz and abs(np.log(rate_hz / file_hz)) > _RATE_TOLERANCE:
        text = f"{rate_hz:g} Hz are configured and {file_hz:g} Hz are in the file, so that times and speeds are wrong"
        yield Finding("frame-rate mismatch", text)
    elif (
        rate_hz
        and len(steps_s)
        and abs(np.log(measured_hz := 1.0 / np.median(steps_s)) - np.log(rate_hz)) > np.log(1.0 + _RATE_TOLERANCE)
    ):
        text = f"the frames' times have {measured_hz:.3g} Hz and {rate_hz:g} Hz are configured"
        yield Finding("frame-rate mismatch", f"{text}, so that speeds are wrong")


def missing_frames(measured: RunMeasurements) -> Iterator[Finding]:
    """Yield stretches of frames without keypoints, and jumps of the keypoints."""
    empty: BoolArray = ~np.any(measured.observed.shows_person, axis=1)
    if np.median(np.diff(np.flatnonzero(~empty), prepend=-1)) <= 1.0:  # keypoints in a few frames have no gaps
        for first, last in _stretches(empty):
            end = min(last + 1, len(empty) - 1)
            if (seconds := measured.times_s[end] - measured.times_s[first]) >= _MIN_GAP_S:
                where = f"frames {measured.frames[first]} to {measured.frames[last]}"
                yield Finding("missing frames or jumps", f"no keypoints in {where}, {seconds:.2g} s")
    motion = measured.observed.motion
    jumps = _jumps(motion, measured.times_s)
    if len(jumps):
        at, more = jumps[0], f" and {len(jumps) - 1} times more" if len(jumps) > 1 else ""
        moved = f"by {motion[at]:.0%} of the person's height"
        where = f"from frame {measured.frames[at - 1]} to {measured.frames[at]}"
        yield Finding("missing frames or jumps", f"the keypoints jump {moved} {where}{more}")


def _jumps(motion: FloatArray, times_s: FloatArray) -> list[int]:
    """Return the frames at times (F,) whose motion (F,) since the last one is _MAX_JUMP times the median around them,
    and more than a forearm's width and than at _MIN_JUMP_SPEED."""
    jumps, steps_s = [], np.diff(times_s, prepend=times_s[:1])
    for t in np.flatnonzero(np.nan_to_num(motion) > np.maximum(FOREARM_OVER_HEIGHT, _MIN_JUMP_SPEED * steps_s)):
        around = np.delete(motion[max(t - _JUMP_FRAMES, 0) : t + _JUMP_FRAMES + 1], min(int(t), _JUMP_FRAMES))
        if np.isfinite(around).sum() >= WINDOW_FRAMES and motion[t] > _MAX_JUMP * np.nanmedian(around):
            jumps.append(int(t))
    return jumps


def _stretches(chosen: BoolArray) -> list[tuple[int, int]]:
    """Return the first and last index of every stretch of True in (F,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(np.int8)))
    return [(int(first), int(end) - 1) for first, end in zip(edges[::2], edges[1::2], strict=True)]
