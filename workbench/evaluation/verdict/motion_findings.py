"""Findings on a run's estimate: limbs, walk, and place."""

from collections.abc import Iterator

import numpy as np

from workbench.body.shape import from_height
from workbench.body.skeleton import joint_of
from workbench.body.stature import limb_lengths, usual_height
from workbench.cameras.calibration_findings import HEIGHTS_M, MAX_HEIGHT_ERROR, distance, upright
from workbench.cameras.observed_joints import MIN_WEIGHT, some_frames
from workbench.cameras.triangulation import triangulate
from workbench.evaluation.verdict.run_measurements import RunMeasurements, foot_speeds, walking_velocity
from workbench.evaluation.verdict.track_outcome import has_values
from workbench.evaluation.verdict.walk_ratio import steps_of
from workbench.utils.finding import Finding

_LIMB_TOLERANCE = 0.25
"""Tolerance of a single limb against the others. The limbs of ten people in motion capture deviate from those of an
average person of their height by up to 23 %, 9 % on average."""
_MAX_SLIDING = 0.5
"""Speed of the slower foot of a walking person over the pelvis' speed, as exceeded in _SWINGING of the time."""
_SWINGING = 2 / 3
"""Fraction of the time in which no foot of a person in motion needs to stand: one stands always in a walk, in two
thirds of the time of a run, and in a third of a sprint."""
_MIN_WALK_FRAMES = 20
_MAX_WALK_RATIO = 1.6
"""Factor of the walk ratio over the usual one, and its inverse. In 63 walks of motion capture it is 0.85 to 1.4; a rate
that is wrong by two changes it by two."""


def motion_findings(measured: RunMeasurements, height_m: float | None = None) -> Iterator[Finding]:
    """Yield the findings on the estimated limbs, walk and place; height_m: the person's, if it is configured."""
    yield from _limbs(measured, height_m)
    yield from _steps(measured)
    yield from _walk(measured)
    yield from _place(measured)


def _limbs(measured: RunMeasurements, given_m: float | None) -> Iterator[Finding]:
    """Compare the body's limbs, and the triangulated ones, with those of people of their height.

    The height of an infant is expected where it is configured, and where the cameras measure it. A configured height
    within those expected is not doubted because the limbs are slightly shorter or longer than usual.
    """
    observed = measured.observed
    several = len(observed.cameras) > 1 and measured.has_keypoints
    pixels = observed.pixels(MIN_WEIGHT)[:, some_frames(len(measured.frames))]
    triangulated = limb_lengths(triangulate(observed.cameras, pixels)) if several else {}
    height_m = usual_height(measured.lengths_m)
    if given_m and _agree(height_m, given_m):
        height_m = given_m
    is_measured = given_m and triangulated and _agree(usual_height(triangulated), given_m)
    low, high = HEIGHTS_M
    if not is_measured and not low <= height_m <= high:
        text = f"the body has the limbs of a person of {height_m:.2f} m, expected {low:g} to {high:g} m"
        yield Finding("height mismatch", text)
    for lengths, source in ((measured.lengths_m, "the body has"), (triangulated, "the cameras measure")):
        if len(lengths) < len(measured.lengths_m) or not 0.5 < (height := usual_height(lengths)) < 2.5:
            continue
        for limb, length in lengths.items():
            expected = float(getattr(from_height(height), limb))
            if abs(np.log(length / expected)) > np.log1p(_LIMB_TOLERANCE):
                actual, normal = f"{100.0 * length:.0f} cm", f"{100.0 * expected:.0f} cm (of {height:.2f} m)"
                text = f"{source} a {limb.replace('_', ' ')} of {actual}, usual are {normal}"
                yield Finding("implausible limb lengths", text)
                return


def _agree(first_m: float, second_m: float) -> bool:
    """Return whether heights differ by no more than those of people with the same limbs."""
    return bool(abs(np.log(first_m / second_m)) <= np.log1p(MAX_HEIGHT_ERROR))


def _steps(measured: RunMeasurements) -> Iterator[Finding]:
    """Compare the steps' length with their cadence, and by that the rate of the frames."""
    steps = steps_of(measured.estimated_joints, measured.times_s, usual_height(measured.lengths_m))
    if steps is not None and abs(np.log(steps.relative_ratio)) > np.log(_MAX_WALK_RATIO):
        ratio = steps.relative_ratio
        text = f"steps of {steps.length_m:.2f} m at {steps.cadence_per_min:.0f} per minute"
        long, rate = ("long", "low") if ratio > 1.0 else ("short", "high")
        why = (
            f"are {max(ratio, 1 / ratio):.1f} times too {long} for their cadence: the rate of the frames is too {rate}"
        )
        yield Finding("frame-rate mismatch", f"{text} {why}")


def _walk(measured: RunMeasurements) -> Iterator[Finding]:
    """Compare the estimated walk with the ground and with the direction in which the person faces."""
    places, n = measured.estimated_joints, len(measured.frames)
    velocity = walking_velocity(places[:, 0], measured.times_s)
    walks = np.isfinite(velocity).all(axis=1) & measured.observed_frames
    if n < 2 or walks.sum() < _MIN_WALK_FRAMES or not has_values(places[walks]):
        return
    ankles = measured.pelvis_and_ankles[:, 1:]
    speed = np.linalg.norm(velocity[walks], axis=1)
    relative = foot_speeds(ankles, measured.times_s)[walks].min(axis=1) / speed
    sliding = float(np.nanquantile(relative, 1.0 - _SWINGING))
    if sliding > _MAX_SLIDING:
        text = f"the standing foot slides at {sliding:.0%} of the pelvis' speed of {np.median(speed):.2f} m/s"
        yield Finding("ground contact", text)
    across = joint_of(places, "left_hip") - joint_of(places, "right_hip")
    ahead = np.stack([across[:, 1], -across[:, 0]], axis=1)[walks]  # of an upright person
    cosine = (ahead * velocity[walks]).sum(axis=1) / np.maximum(np.linalg.norm(ahead, axis=1) * speed, 1e-12)
    backwards = float((cosine < -0.5).mean())
    if backwards > 0.5:
        text = f"the person walks backwards in {backwards:.0%} of the frames: left and right may be exchanged"
        yield Finding("left–right swap", text)


def _place(measured: RunMeasurements) -> Iterator[Finding]:
    """Compare the estimate's place and attitude with the cameras and with z."""
    places = measured.estimated_joints
    if has_values(places[:, 0]):
        yield from (distance(camera, places[:, 0]) for camera in measured.observed.cameras)
    ankles = measured.pelvis_and_ankles[:, 1:]
    standing = np.take_along_axis(ankles, ankles[:, :, 2:].argmin(axis=1)[:, None], axis=1)[:, 0]
    body, trunk = (joint_of(places, "neck") - each for each in (standing, places[:, 0]))
    if has_values(body + trunk):
        yield upright(np.nanmean(body, axis=0), np.nanmean(trunk, axis=0), "in the mean of the estimate")
