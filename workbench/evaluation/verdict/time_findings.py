"""Findings on a run's frames: their times, and stretches without observations of the person."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np

from workbench.body.shape import FOREARM_OVER_HEIGHT
from workbench.evaluation.verdict.joint_states import LOST
from workbench.evaluation.verdict.run_measurements import RunMeasurements
from workbench.utils.arrays import FloatArray
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
_EDGE = 0.25
"""Distance of the keypoints from the image's edge, in heights of the person, up to which the person may enter or leave:
joints lie up to 0.1 inside of the body, and a runner moves by 0.15 within 0.1 s."""
_RATE_TOLERANCE = 0.02
_MOSTLY_TRACKED, _HARDLY_TRACKED = 0.8, 0.4
"""Fractions of the frames that may show the person in which the person must be tracked: with less than the first, more
than every fifth step is missing; with less than the second, most of the motion."""


def tracked_frames(measured: RunMeasurements, input_counts: Mapping[str, int], states: Sequence[str]) -> str:
    """Return in how many frames of the video the person is tracked, "" without detections; see `lost_person`."""
    if not (n := input_counts.get("frames", 0)):
        return ""
    seen, empty = n - input_counts.get("frames_unseen", 0), input_counts.get("frames_empty", 0)
    tracked = seen - _n_lost(measured, states)
    text = f"tracked in {tracked} of {n} frames of the video"
    if tracked == n:
        return text
    return f"{text} (a person is detected in {n - empty}, this person in {seen}; {len(measured.frames)} are used)"


def lost_person(measured: RunMeasurements, input_counts: Mapping[str, int], states: Sequence[str]) -> Finding | None:
    """Return the finding that the person is lost in frames that may show the person; None if in a few.

    Frames before the person enters through the image's edge, or after the person leaves through it, do not count.

    Parameters
    ----------
    measured : measurements of the run.
    input_counts : as of `TargetPerson`; empty without detections.
    states : (F,) of the frames, see `Verdict`.
    """
    with_person = np.flatnonzero(measured.observed.shows_person.any(axis=1))
    seen = input_counts.get("frames", 0) - input_counts.get("frames_unseen", 0)
    if not seen or not len(with_person):
        return None
    may_show = seen + input_counts.get("frames_lost", 0)
    for t, name in ((with_person[0], "frames_before"), (with_person[-1], "frames_after")):
        may_show += 0 if _at_edge(measured, t) else input_counts.get(name, 0)
    tracked = seen - _n_lost(measured, states)
    level = level_of_share(tracked / may_show)
    text = f"the person is lost in {may_show - tracked} of the {may_show} frames that may show this person"
    return None if level == NOTE else Finding("person lost", text, level)


def _n_lost(measured: RunMeasurements, states: Sequence[str]) -> int:
    """Return the number of frames with keypoints of the person in which the estimate is lost."""
    return sum(state == LOST and shown for state, shown in zip(states, measured.observed_frames, strict=True))


def level_of_share(share: float) -> str:
    """Return the level of a finding by the fraction of the frames that are as they should be."""
    return NOTE if share >= _MOSTLY_TRACKED else DOUBTFUL if share >= _HARDLY_TRACKED else NOT_USABLE


def _at_edge(measured: RunMeasurements, t: int) -> bool:
    """Return whether a person in frame t may enter or leave the image: all cameras but one show the person near an
    edge; the only camera, too."""
    inside, in_frame = 0, measured.observed.keypoints[:, t]
    heights = measured.observed.heights_px[t]
    for camera, keypoints, height in zip(measured.observed.cameras, in_frame, heights, strict=True):
        pixels = keypoints[keypoints[:, 2] > 0.0, :2]
        if height > 0.0:
            margin = min(pixels.min(), *([camera.width, camera.height] - pixels.max(axis=0)))
            inside += margin > _EDGE * height
    return inside < min(2, len(measured.observed.cameras))


def time_findings(measured: RunMeasurements, rate_hz: float | None, file_hz: float | None) -> Iterator[Finding]:
    """Compare the frames' times with each other, with the configured rate, and this with the rate in the file."""
    steps_s = np.diff(measured.times_s)
    if (steps_s <= 0.0).any():
        k = int(np.flatnonzero(steps_s <= 0.0)[0])
        step = f"from {measured.times_s[k]:.3f} s to {measured.times_s[k + 1]:.3f} s"
        where = f"from frame {measured.frames[k]} to {measured.frames[k + 1]}"
        yield Finding("frame-rate mismatch", f"times do not increase, {where} they go {step}", NOT_USABLE)
        return
    measured_hz = 1.0 / np.median(steps_s) if len(steps_s) else np.nan
    if rate_hz and file_hz and abs(np.log(rate_hz / file_hz)) > _RATE_TOLERANCE:
        text = f"{rate_hz:g} Hz are configured and {file_hz:g} Hz are in the file, so that times and speeds are wrong"
        yield Finding("frame-rate mismatch", text)
    elif rate_hz and abs(np.log(measured_hz) - np.log(rate_hz)) > np.log(1.0 + _RATE_TOLERANCE):
        text = f"the frames' times have {measured_hz:.3g} Hz and {rate_hz:g} Hz are configured"
        yield Finding("frame-rate mismatch", f"{text}, so that speeds are wrong")


def missing_frames(measured: RunMeasurements) -> Iterator[Finding]:
    """Yield stretches without frames or keypoints, and jumps of the keypoints."""
    gaps = _gaps(measured)
    if gaps:
        seconds, where = max(gaps)
        more = f", and {len(gaps) - 1} shorter" if len(gaps) > 1 else ""
        yield Finding("missing frames or jumps", f"no keypoints {where}, {seconds:.2g} s{more}")
    motion = measured.observed.motion
    jumps = _jumps(motion, measured.times_s)
    if len(jumps):
        at, more = jumps[0], f" and {len(jumps) - 1} times more" if len(jumps) > 1 else ""
        moved = f"by {motion[at]:.0%} of the person's height"
        where = f"from frame {measured.frames[at - 1]} to {measured.frames[at]}"
        yield Finding("missing frames or jumps", f"the keypoints jump {moved} {where}{more}")


def _gaps(measured: RunMeasurements) -> list[tuple[float, str]]:
    """Return durations, s, and frames of the gaps in the keypoints: frames without any, or which the run omits."""
    shown = np.flatnonzero(measured.observed.shows_person.any(axis=1))
    if np.median(np.diff(shown, prepend=-1)) > 1.0:  # keypoints in a few frames have no gaps
        return []
    step_s = float(np.median(np.diff(measured.times_s))) if len(measured.times_s) > 1 else 0.0
    times_s = np.concatenate([[measured.times_s[0] - step_s], measured.times_s, [measured.times_s[-1] + step_s]])
    numbers = np.concatenate([[measured.frames[0] - 1], measured.frames, [measured.frames[-1] + 1]])
    gaps = []
    for a, b in pairwise([0, *(shown + 1).tolist(), len(times_s) - 1]):
        if (seconds := float(times_s[b] - times_s[a]) - step_s) >= _MIN_GAP_S:
            missing = numbers[b] - numbers[a] > 1
            where = f"in frames {numbers[a] + 1} to {numbers[b] - 1}" if missing else f"after frame {numbers[a]}"
            gaps.append((seconds, where))
    return gaps


def _jumps(motion: FloatArray, times_s: FloatArray) -> list[int]:
    """Return the frames at times (F,) whose motion (F,) since the last one is _MAX_JUMP times the median around them,
    and more than a forearm's width and than at _MIN_JUMP_SPEED."""
    jumps, steps_s = [], np.diff(times_s, prepend=times_s[:1])
    for t in np.flatnonzero(np.nan_to_num(motion) > np.maximum(FOREARM_OVER_HEIGHT, _MIN_JUMP_SPEED * steps_s)):
        around = np.delete(motion[max(t - _JUMP_FRAMES, 0) : t + _JUMP_FRAMES + 1], min(int(t), _JUMP_FRAMES))
        if np.isfinite(around).sum() >= WINDOW_FRAMES and motion[t] > _MAX_JUMP * np.nanmedian(around):
            jumps.append(int(t))
    return jumps
