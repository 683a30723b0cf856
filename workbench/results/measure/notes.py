"""Sentences on how a motion was measured, what was left out, and what limits the numbers."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from workbench.evaluation.gait.stretches import MAX_GAP_S
from workbench.evaluation.gait.strides import MAX_TURN_RAD, SLIDING_SPEED
from workbench.evaluation.gait.walk import Walk
from workbench.recording.read.reader import Run
from workbench.results.measure.recorded_motion import RecordedMotion
from workbench.utils.arrays import BoolArray
from workbench.utils.errors import InputError
from workbench.utils.finding import DOUBTFUL, NOT_USABLE

_FEW_STRIDES = 3
"""Number of strides of a foot below which their mean says little: single strides of one walk vary by 2 to 5 %."""
_USUAL_RATE_HZ = 25.0
"""Rate below which strikes are not known within 35 ms: they are to about a frame."""


def notes_of(
    run: Run, walk: Walk | None, motion: RecordedMotion, legs: BoolArray, hidden: Sequence[str]
) -> Iterator[str]:
    """Yield the sentences on the measures of a run.

    Parameters
    ----------
    walk : None if there is none.
    legs : (F,), frames in which both legs are known.
    hidden : parts of the body that are not measured.
    """
    verdict = run.properties.get("verdict", {})
    if verdict.get("level") in (DOUBTFUL, NOT_USABLE):
        yield f"The run is {verdict['message']}."
    if run.status != "complete":
        yield f"The run is not complete (status: {run.status}); only its frames are measured."
    yield from _no_walk(motion, legs) if walk is None else _walk(walk)
    yield from _omitted(motion, motion.tracked if walk is None else legs, walk is not None)
    if hidden:
        yield f"Not measured, as they are lost or not seen in most frames: {', '.join(hidden)}."
    yield from _limits(run, motion, walk is not None)


def _no_walk(motion: RecordedMotion, legs: BoolArray) -> Iterator[str]:
    seconds = motion.times_s[-1] - motion.times_s[0] if len(motion.times_s) else 0.0
    step_s = float(np.median(np.diff(motion.times_s))) if len(motion.times_s) > 1 else np.inf
    if not legs.any():
        reason = "no frame shows both legs"
    elif step_s > MAX_GAP_S:
        reason = f"the frames are {step_s:.2g} s apart, and foot strikes need {MAX_GAP_S:g} s or less"
    else:
        reason = f"no foot takes two steps in turn with the other in {seconds:.3g} s"
    yield f"No walk: {reason}. Ranges, speeds and repetitions of the joint angles are measured instead."


def _walk(walk: Walk) -> Iterator[str]:
    n_left, n_right = (len(each) for each in walk.strides)
    kind = "A run, as both feet leave the ground between steps" if walk.is_run else "A walk"
    yield f"{kind}: {n_left} strides of the left foot and {n_right} of the right one are measured."
    if min(n_left, n_right) < _FEW_STRIDES:
        yield f"Fewer than {_FEW_STRIDES} strides of a foot: they show these strides, not how the person usually walks."
    if walk.on_belt:
        yield (
            "The feet move backwards together while they stand, and the pelvis stays: a treadmill, or a camera that "
            "travels along. Speed and lengths are relative to the belt."
        )
    elif abs(walk.standing_speed) >= SLIDING_SPEED:
        yield (
            f"Standing feet slide at {abs(walk.standing_speed):.0%} of the walking speed; speed and lengths are of the "
            "pelvis and the places of the feet in the world, and uncertain by as much."
        )
    if walk.n_turning:
        turn = f"{np.degrees(MAX_TURN_RAD):.0f}°"
        yield f"Strides that are left out, as they turn by more than {turn}: {walk.n_turning}."
    if walk.n_irregular:
        yield (
            "Strides that are left out, as left and right do not step in turn, or as they are too long for a step: "
            f"{walk.n_irregular}."
        )


def _omitted(motion: RecordedMotion, known: BoolArray, walks: bool) -> Iterator[str]:
    n_lost = int((~known).sum())
    if n_lost and walks:
        yield f"In {n_lost} of {len(motion.frames)} frames a leg is lost or not seen; strides with a gap are left out."
    elif n_lost:
        yield f"In {n_lost} of {len(motion.frames)} frames the person is lost; they are left out."
    if len(motion.times_s) > 1:
        gaps_s = np.diff(motion.times_s)
        missing_s = float(gaps_s[gaps_s > 1.5 * np.median(gaps_s)].sum())
        if missing_s:
            yield f"The recording has no frames in {missing_s:.2g} s of its time; strides with a gap are left out."


def _limits(run: Run, motion: RecordedMotion, walks: bool) -> Iterator[str]:
    n_samples = len(motion.poses) - 1
    if n_samples:
        yield (
            f"Intervals are 90 % credible intervals from {n_samples} samples of the posterior of the motion, which "
            "include errors of the detector, the camera and the limbs' lengths."
        )
    else:
        yield "The recording has no samples of the posterior of the motion, and so there are no intervals."
    if (scale := _scale(run)) is not None:
        yield scale
    if len(motion.times_s) > 1 and (rate_hz := 1.0 / float(np.median(np.diff(motion.times_s)))) < _USUAL_RATE_HZ:
        what = "strikes and toe-offs are known to about a frame" if walks else "peak speeds are lower limits"
        yield f"At {rate_hz:.3g} frames per second {what}."
    if walks:
        yield (
            "Toe-offs are found by the ankles, in recorded walks 17 ± 8 ms early and in runs about 30 ms late, so that "
            "the stance of a run is too long."
        )
    yield "The torso is one rigid part: pelvis and trunk have the same angles."


def _scale(run: Run) -> str | None:
    """Return the sentence on what determines lengths of one camera; None with a calibration, or for another dataset."""
    try:
        dataset: Any = run.settings.get("dataset")
    except InputError:  # the numbers are known without it
        return None
    if not isinstance(dataset, dict) or "height_m" not in dataset or dataset.get("calibration_file") is not None:
        return None
    height_m = dataset["height_m"]
    known = f"{height_m:g} m" if isinstance(height_m, float) else "an average adult's, as none is given"
    return (
        f"One camera without a calibration file: lengths and speeds are in proportion to the person's height, {known}."
    )
