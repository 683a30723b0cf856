"""Findings on a run: contradictions between its inputs, its observations, its estimate and its stated uncertainty."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from workbench.body.shape import FOREARM_OVER_HEIGHT, from_height
from workbench.body.skeleton import JOINT_NAMES
from workbench.body.stature import limb_lengths, usual_height
from workbench.cameras.calibration_findings import (
    HEIGHTS_M,
    check_calibration,
    distance,
    lens_findings,
    unit_of,
    upright,
)
from workbench.cameras.observed_joints import MIN_WEIGHT
from workbench.cameras.triangulation import triangulate
from workbench.evaluation.errors.track_loss import UNCERTAIN_MM
from workbench.evaluation.verdict.knee_bends import bends
from workbench.evaluation.verdict.run_measurements import RunMeasurements, foot_speeds, walking_velocity
from workbench.evaluation.verdict.track_outcome import depth_drift, has_values
from workbench.evaluation.verdict.video_findings import video_findings
from workbench.utils.arrays import BoolArray, FloatArray
from workbench.utils.crossings import WINDOW_FRAMES
from workbench.utils.finding import DOUBTFUL, NOT_USABLE, NOTE, Finding, level_of

MOVING_CAMERA = "moving camera"
"""Kind of the finding that the camera travels."""
_LIMB_TOLERANCE = 0.20
"""Tolerance of a single limb against the others: three deviations, and the error of a detector's joint."""
_MAX_JUMP = 5.0
"""Times the motion of the keypoints in the frames around. Even a kick at 30 Hz stays below twice, by the accelerations
that legs and arms are capable of."""
_MIN_JUMP_SPEED = 30.0 * FOREARM_OVER_HEIGHT
"""In heights per second, 2.2 m/s on average over all joints: a slower person may just begin to move."""
_JUMP_FRAMES = 10
_MIN_GAP_S = 0.25
"""Shortest reported gap in keypoints that are otherwise there in every frame: half a step of a walk."""
_MIN_OBSERVED_JOINTS = 0.5
"""Fraction of the 14 joints without the pelvis that must be observed in some frame."""
_MIN_INLIERS, _HARDLY_ANY_INLIERS = 0.5, 0.25
"""Fractions of the observations that must lie near the body; with fewer, most show the person elsewhere."""
_MIN_BENT_LEGS = 10
_RATE_TOLERANCE = 0.02
_MIN_COVERAGE = 0.42
"""Coverage of 90 % intervals of a normal distribution whose stated standard deviation is a third of the error's:
P(|z| < 1.645 / 3). A factor of two is usual, as joints are defined differently by people, bodies and detectors."""
_EXTENT_RATIO = 1.5
"""Extent of a person's points along another axis over that along z, from which on the person lies: arms and stride are
at most as long as the upright body."""
_EXTENTS_M = (0.4, 2.5)
"""Extent of the middle 90 % of a person's points: a trunk, and a tall adult with a raised arm."""
_MAX_SLIDING = 0.5
"""Median speed of the slower foot of a walking person over the pelvis' speed. One foot stands at any time of a walk,
and in two thirds of the time of a run."""
_MIN_WALK_FRAMES = 20
_MOSTLY_TRACKED, _HARDLY_TRACKED = 0.8, 0.4
"""Fractions of the frames that may show the person in which the person must be detected: with less than the first, more
than every fifth step is missing; with less than the second, most of the motion."""


@dataclass(frozen=True)
class RunInputs:
    """Configured inputs of a run.

    height_m: the person's. max_iterations: of a fit. rate_hz, source_rate_hz: configured rate of the frames, and the
    rate in their source's file. shows_person: the dataset has observations of the person. input_counts: of the frames
    in which a person was selected among the detected ones, see `TargetPerson`; empty without detections.
    camera_travels: the only camera changes its place.
    """

    height_m: float | None = None
    max_iterations: float | None = None
    rate_hz: float | None = None
    source_rate_hz: float | None = None
    shows_person: bool = True
    input_counts: Mapping[str, int] = field(default_factory=dict)
    camera_travels: bool = False


def coverage(inputs: RunInputs) -> Finding | None:
    """Return in how many frames of the video the person is detected; None if in all, or without detections.

    Frames that may show the person, but without a detection, lower the verdict; others, before the person enters or
    after the person leaves, do not.
    """
    n, unseen = inputs.input_counts.get("frames", 0), inputs.input_counts.get("frames_unseen", 0)
    if not unseen:
        return None
    lost = inputs.input_counts.get("frames_lost", 0)
    share = (n - unseen) / (n - unseen + lost)
    level = NOTE if share >= _MOSTLY_TRACKED else DOUBTFUL if share >= _HARDLY_TRACKED else NOT_USABLE
    text = f"tracked in {n - unseen} of {n} frames of the video"
    if 0 < lost < unseen:
        text += f", lost in {lost}"
    return Finding("person lost", text, level)


def run_findings(measured: RunMeasurements, inputs: RunInputs) -> Iterator[Finding]:
    """Yield the findings on a run, those on its inputs first."""
    of_inputs = [*_inputs(measured, inputs), *_times(measured, inputs)]
    yield from of_inputs
    if (covered := coverage(inputs)) is not None:
        yield covered
    yield from video_findings(inputs.input_counts)
    if inputs.camera_travels:
        yield Finding(MOVING_CAMERA, "the camera travels: positions are relative to the camera, not to the ground")
    if level_of(of_inputs) != NOT_USABLE:  # otherwise a consequence
        yield from _limbs(measured)
        yield from _walk(measured)
        yield from _place(measured)
    yield from _uncertainty(measured)
    inliers = measured.inlier_fraction[measured.observed_frames]
    if has_values(inliers) and (near := float(np.nanmean(inliers))) < _MIN_INLIERS:
        level = DOUBTFUL if near >= _HARDLY_ANY_INLIERS else NOT_USABLE
        text = f"only {near:.0%} of the observations lie near the body"
        yield Finding("observations far from the body", text, level)
    if inputs.max_iterations and measured.iterations >= inputs.max_iterations:
        used = f"the fit used all {inputs.max_iterations:g} iterations without converging"
        yield Finding("not converged", f"{used}, increase inference.max_iterations")


def _inputs(measured: RunMeasurements, inputs: RunInputs) -> Iterator[Finding]:
    """Yield the findings on cameras, keypoints and points."""
    if measured.has_keypoints:
        findings = check_calibration(measured.observed, inputs.height_m).findings
        yield from findings
        if level_of(findings) != NOT_USABLE:
            yield from _keypoints(measured)
        yield from _missing(measured)
    else:
        yield from (finding for camera in measured.observed.cameras for finding in lens_findings(camera))
    yield from _points(measured)


def _keypoints(measured: RunMeasurements) -> Iterator[Finding]:
    """Yield joints and cameras without keypoints, and exchanged sides."""
    observed = measured.observed
    joints_seen = np.asarray(np.isfinite(observed.pixels()[..., 0]).any(axis=(0, 1)))[1:]
    if joints_seen.sum() < _MIN_OBSERVED_JOINTS * len(joints_seen):
        seen = f"only {joints_seen.sum()} of {len(joints_seen)} joints are observed in any frame"
        yield Finding("too few observations", f"{seen}, the others follow the prior")
    in_image, has_person = measured.in_image.sum(axis=0), (measured.in_image & observed.shows_person).sum(axis=0)
    for v, name in enumerate(measured.cameras):
        if len(measured.cameras) > 1 and in_image[v] >= WINDOW_FRAMES and has_person[v] < 0.5 * in_image[v]:
            text = f"{name} has keypoints in {has_person[v]} of the {in_image[v]} frames that show the person"
            yield Finding("inconsistent cameras", text)
    if len(measured.cameras) > 1:
        bent = bends(triangulate(observed.cameras, observed.pixels(MIN_WEIGHT)))
        if len(bent) >= _MIN_BENT_LEGS and (backwards := float((bent < 0.0).mean())) > 0.5:
            text = f"knees bend backwards in {backwards:.0%} of {len(bent)} bent legs: left and right are exchanged"
            yield Finding("left–right swap", text, NOT_USABLE)


def _points(measured: RunMeasurements) -> Iterator[Finding]:
    """Compare the extents of the points with those of an upright person."""
    if not measured.has_points:
        return
    extent = np.nanmedian(measured.point_extent_m, axis=0)
    longest = int(np.argmax(extent))
    low, high = _EXTENTS_M
    if not low < extent[longest] < high:
        unit = unit_of(extent[longest] / 1.7)
        hint = f": the points are in {unit}, expected metres" if unit else f", expected {low:g} to {high:g} m"
        text = f"the points extend over {extent[longest]:.2f} m{hint}"
        yield Finding("unit of length" if unit else "height mismatch", text, NOT_USABLE if unit else DOUBTFUL)
    elif extent[longest] > _EXTENT_RATIO * extent[2]:
        axis = "xyz"[longest]
        text = f"the points extend over {extent[longest]:.2f} m along {axis} and {extent[2]:.2f} m along z"
        yield Finding("vertical", f"{text}: the axis that points up is {axis}, expected z, or the person lies")


def _times(measured: RunMeasurements, inputs: RunInputs) -> Iterator[Finding]:
    """Compare the frames' times with each other and with the rate."""
    rate_hz, file_hz, steps_s = inputs.rate_hz, inputs.source_rate_hz, np.diff(measured.times_s)
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


def _limbs(measured: RunMeasurements) -> Iterator[Finding]:
    """Compare the body's limbs, and the triangulated ones, with those of people of their height."""
    observed = measured.observed
    several = len(observed.cameras) > 1 and measured.has_keypoints
    triangulated = limb_lengths(triangulate(observed.cameras, observed.pixels(MIN_WEIGHT))) if several else {}
    height_m = usual_height(measured.lengths_m)
    if not HEIGHTS_M[0] < height_m < HEIGHTS_M[1]:
        low, high = HEIGHTS_M
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


def _walk(measured: RunMeasurements) -> Iterator[Finding]:
    """Compare the estimated walk with the ground and with the direction in which the person faces."""
    places, n = measured.estimated_joints, len(measured.frames)
    velocity = walking_velocity(places[:, 0], measured.times_s)
    walks = np.isfinite(velocity).all(axis=1) & measured.observed_frames
    if n < 2 or walks.sum() < _MIN_WALK_FRAMES or not has_values(places[walks]):
        return
    ankles = measured.pelvis_and_ankles[:, 1:]
    speed = np.linalg.norm(velocity[walks], axis=1)
    sliding = float(np.nanmedian(foot_speeds(ankles, measured.times_s)[walks].min(axis=1) / speed))
    if sliding > _MAX_SLIDING:
        text = f"the standing foot slides at {sliding:.0%} of the pelvis' speed of {np.median(speed):.2f} m/s"
        yield Finding("ground contact", text)
    across = _joint(places, "left_hip") - _joint(places, "right_hip")
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
    ankles = places[:, [JOINT_NAMES.index("left_ankle"), JOINT_NAMES.index("right_ankle")]]
    standing = np.take_along_axis(ankles, ankles[:, :, 2:].argmin(axis=1)[:, None], axis=1)[:, 0]
    axis = _joint(places, "neck") - standing
    if has_values(axis):
        yield upright(np.nanmean(axis, axis=0), "in the mean of the estimate")


def _uncertainty(measured: RunMeasurements) -> Iterator[Finding]:
    """Compare the stated uncertainty with the errors, and with UNCERTAIN_MM."""
    errors = {name: values[1:] for name, values in measured.errors.items()}
    coverage = errors.get("coverage_90", errors.get("coverage_90_joints", np.empty(0)))
    if has_values(coverage) and (covered := float(np.nanmean(coverage))) < _MIN_COVERAGE:
        text = f"the 90 % credible intervals cover {covered:.0%} of the true values"
        yield Finding("overconfident", text)
    drift = depth_drift(measured)
    if drift.exceeds.any():
        yield Finding("depth drift", drift.message)
    shown = measured.observed_frames
    uncertain = [groups for groups, valid in zip(measured.uncertain_groups, shown, strict=True) if groups and valid]
    if len(uncertain) > 0.5 * shown.sum():
        groups = ", ".join(sorted({group for each in uncertain for group in each}))
        text = f"the expected error of {groups} exceeds {UNCERTAIN_MM:g} mm in {len(uncertain)} frames"
        yield Finding("large expected error", text)
    depth_m = measured.depth_std_m[shown]
    known = all(camera.uncertainty is None for camera in measured.observed.cameras)  # otherwise the outcome states it
    if known and has_values(depth_m) and (std := float(np.nanmedian(depth_m))) > 1e-3 * UNCERTAIN_MM:
        yield Finding("uncertain depth", f"the person's depth is known to ± {std:.2f} m only")


def _missing(measured: RunMeasurements) -> Iterator[Finding]:
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


def _joint(places: FloatArray, name: str) -> FloatArray:
    return places[:, JOINT_NAMES.index(name)]
