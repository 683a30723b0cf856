"""What a calibration and the people it shows say about each other, in sentences."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.arrays import FloatArray
from workbench.body.camera import Camera
from workbench.body.shape import ANKLE_HEIGHT, HEAD_HEIGHT, LEG_LENGTH, SHOULDER_HEIGHT
from workbench.body.skeleton import JOINT_NAMES
from workbench.looking.geometry import UP, triangulated, upright
from workbench.looking.observed import Observed

MOST_OFF = 0.035
"""Of a person's height in the image: half the joints may be so far from where all cameras together place them. Of four
cameras of a laboratory, taken in twos, threes and fours, it is up to 0.029; with two of their videos exchanged it is
more than 0.04 in 22 of 24 cases, and 0.02 in two, of two cameras opposite each other."""
MOST_LEANING_DEG = 20.0
HEIGHTS_M = (1.2, 2.2)
"""Of people whose lengths are taken for right where their height is not told."""
HEIGHT_OFF = 0.1
"""Part by which somebody's measured legs may differ from what is usual at their height."""
USUAL_HEIGHT_M = 1.7
FOCAL_LENGTHS = (0.4, 5.0)
"""Of a lens, in its image's longer sides: wider ones have a field of view over 100°, longer ones below 11°."""
STEEP_DEG = 5.0
FAR_ENOUGH_M = 1.0
"""Feet have to be so far apart before they tell how a floor lies."""


@dataclass(frozen=True)
class Finding:
    """A sentence about one thing. fits: whether that is as it should be; None where nothing says so."""

    sentence: str
    fits: bool | None = True


@dataclass(frozen=True, eq=False)
class Looked:
    """What was found. joints: (F, J, 3), m, that the cameras together show, or, before one camera, where ankles and
    head of somebody upright would be, NaN else. floor_m: height of the floor under their feet; None: not known."""

    findings: tuple[Finding, ...]
    joints: FloatArray
    floor_m: float | None


def look(seen: Observed, height_m: float | None) -> Looked:
    """Judge a calibration by the people in front of it. height_m: how tall they are, where that is known."""
    lenses = tuple(finding for camera in seen.cameras for finding in _lens(camera))
    if not len(seen.frames):
        nothing = Finding("no joints are marked or detected in these frames, which would tell whether it fits", None)
        return Looked((*lenses, nothing), np.empty((0, len(JOINT_NAMES), 3)), None)
    found = _together(seen, height_m) if len(seen.cameras) > 1 else _alone(seen, height_m)
    return Looked((*lenses, *found.findings), found.joints, found.floor_m)


def _lens(camera: Camera) -> tuple[Finding, ...]:
    """Say what no usual lens is like."""
    focal, size = camera.matrix[[0, 1], [0, 1]], np.array([camera.width, camera.height])
    found = [Finding(f"{camera.name}: images of {camera.width}×{camera.height} px, as the calibration's", None)]
    sides, (least, most) = focal / size.max(), FOCAL_LENGTHS
    if not (least < sides.min() and sides.max() < most):
        words = f"{sides[0]:.2g} times the image's longer side, expected {least:g} to {most:g}"
        found.append(Finding(f"{camera.name}: a focal length of {focal[0]:.0f} px is {words}", False))
    off = (np.abs(camera.matrix[:2, 2] - (size - 1) / 2) / size).max()
    if off > 0.25:
        middle = ", ".join(f"{value:.0f}" for value in camera.matrix[:2, 2])
        words = f"the optical axis meets the image at {middle}, far from its middle"
        found.append(Finding(f"{camera.name}: {words}: a calibration of another size?", False))
    return tuple(found)


def _together(seen: Observed, height_m: float | None) -> Looked:
    """Judge several cameras by where their rays meet."""
    joints = triangulated(seen.cameras, seen.marks)
    if not np.isfinite(joints).any():
        none = "no joint is marked or detected by two cameras in one frame, which would tell whether they agree"
        return Looked((Finding(none, None),), joints, None)
    off = [_off(camera, marks, joints) for camera, marks in zip(seen.cameras, seen.marks, strict=True)]
    findings = [_camera_finding(seen, v, median, joints) for v, median in enumerate(off)]
    legs = np.nanmedian([_length(joints, side, "hip", "knee") + _length(joints, side, "knee", "ankle")
                         for side in ("left", "right")])  # fmt: skip
    findings.append(_size(float(legs) / LEG_LENGTH, height_m))
    ankles, shoulders = _middle(joints, "ankle"), _middle(joints, "shoulder")
    feet = _joint(joints, "left_ankle")[:, 2], _joint(joints, "right_ankle")[:, 2]
    findings.append(_standing(shoulders - ankles))
    tall = height_m or float(np.clip(legs / LEG_LENGTH, *HEIGHTS_M))
    lowest = np.concatenate(feet)[np.isfinite(np.concatenate(feet))]
    if not len(lowest):
        return Looked(tuple(findings), joints, None)
    floor = float(np.percentile(lowest, 5)) - ANKLE_HEIGHT * tall
    findings.append(Finding(f"their feet stand at a height of {floor:.2f} m", None))
    return Looked(tuple(findings), joints, floor)


def _camera_finding(seen: Observed, v: int, median: float, joints: FloatArray) -> Finding:
    """Say how far a camera's joints are from where all place them and, with three or more, where the others do."""
    name, tall = seen.cameras[v].name, _extent(seen.marks[v])
    others = [k for k in range(len(seen.cameras)) if k != v]
    if np.isnan(median):
        if seen.looked[v]:
            asked = "are video, joints and calibration its own?"
            return Finding(f"{name}: whom the other cameras show is not found in it: {asked}", False)
        return Finding(f"{name}: no joints are given that another camera shows, too", None)
    words = f"{name}: joints are {_px(median)} from where all cameras together have them"
    if len(others) > 1:
        elsewhere = triangulated([seen.cameras[k] for k in others], seen.marks[others])
        words += f", {_px(_off(seen.cameras[v], seen.marks[v], elsewhere))} from where the others have them"
    return Finding(f"{words}; the person is {_px(tall)} tall", bool(median <= MOST_OFF * tall))


def _alone(seen: Observed, height_m: float | None) -> Looked:
    """Judge one camera by people taken to stand upright, of the height told or of the usual one."""
    (camera,), marks, tall = seen.cameras, seen.marks[0], height_m or USUAL_HEIGHT_M
    feet, heads = _middle(marks, "ankle")[:, :2], _joint(marks, "head_centre")[:, :2]
    length = (HEAD_HEIGHT - ANKLE_HEIGHT) * tall
    if not np.isfinite(heads).any():
        heads, length = _middle(marks, "shoulder")[:, :2], (SHOULDER_HEIGHT - ANKLE_HEIGHT) * tall
    at = upright(camera, feet, heads, length)
    joints = np.full((*marks.shape[:2], 3), np.nan)
    known = np.isfinite(at).all(axis=1)
    if not known.any():
        none = "in no frame are both ankles and the head, or the shoulders, which would tell how the camera stands"
        return Looked((Finding(f"{camera.name}: {none}", None),), joints, None)
    for name in ("left_ankle", "right_ankle"):
        joints[:, JOINT_NAMES.index(name)] = at
    joints[:, JOINT_NAMES.index("head_centre")] = at + length * UP
    findings = [_upright(camera, feet[known], heads[known], at[known], length)]
    assumed = "" if height_m else ", taken to be 1.70 m tall: body=height body.height_m=… says how tall they are"
    distances = camera.to_camera(at[known])[:, 2]
    ankles, span = at[known, 2], f"{distances.min():.1f} to {distances.max():.1f} m"
    floor = float(np.median(ankles)) - ANKLE_HEIGHT * tall
    findings.append(Finding(f"{camera.name}: the person stands {span} away{assumed}", None))
    findings.append(Finding(f"their feet stand at a height of {floor:.2f} m, the camera at {camera.position[2]:.2f} m",
                            None if camera.position[2] > floor - 0.5 else False))  # fmt: skip
    if (slope := _slope(at[known])) is not None:
        findings.append(slope)
    return Looked(tuple(findings), joints, floor)


def _upright(camera: Camera, feet: FloatArray, heads: FloatArray, at: FloatArray, length_m: float) -> Finding:
    """Compare people in the image (F, 2) with the vertical there."""
    above = camera.project(at + length_m * UP) - camera.project(at)
    behind = ~np.isfinite(above).all(axis=1)
    if behind.any():
        words = f"in {behind.sum()} of {len(at)} frames the person would stand behind the camera"
        return Finding(f"{camera.name}: {words}: z does not point up", False)
    body = heads - feet
    cross, dot = above[:, 0] * body[:, 1] - above[:, 1] * body[:, 0], (above * body).sum(axis=1)
    lean = np.degrees(np.arctan2(cross.mean(), dot.mean()))
    words = f"the person leans by {abs(lean):.0f}° from the calibration's vertical"
    return Finding(f"{camera.name}: {words}, in the mean of {len(at)} frames", bool(abs(lean) <= MOST_LEANING_DEG))


def _slope(at: FloatArray) -> Finding | None:
    """Say how steep the floor under places (F, 3) would be along the way; None where they are too close together."""
    centred = at - at.mean(axis=0)
    _, _, axes = np.linalg.svd(centred[:, :2])
    way = centred[:, :2] @ axes[0]
    if len(at) < 3 or np.ptp(way) < FAR_ENOUGH_M:
        return None
    slope = float(way @ centred[:, 2] / (way @ way))
    error = np.sqrt(((centred[:, 2] - slope * way) ** 2).sum() / max(len(at) - 2, 1) / (way @ way))
    degrees, spread = np.degrees(np.arctan(slope)), np.degrees(np.arctan(error))
    words = f"over {np.ptp(way):.1f} m of their way the floor rises or falls by {abs(degrees):.1f} ± {spread:.1f}°"
    return Finding(words, bool(abs(degrees) <= STEEP_DEG + 2.0 * spread))


def _size(found_m: float, told_m: float | None) -> Finding:
    """Compare the height that legs are usual at with what is told, or with people's."""
    if not np.isfinite(found_m):
        return Finding("no leg is seen by two cameras, which would tell the unit of length", None)
    words = f"their legs are as long as those of somebody {found_m:.2f} m tall"
    if told_m is None:
        fits = HEIGHTS_M[0] < found_m < HEIGHTS_M[1]
        return Finding(words + ("" if fits else ": is the unit of length, or the board's square, right?"), fits)
    fits = abs(found_m / told_m - 1.0) <= HEIGHT_OFF
    return Finding(f"{words}, of whom is told {told_m:.2f} m", fits)


def _standing(bodies: FloatArray) -> Finding:
    """Say how far the mean of vectors (F, 3), m, from ankles to shoulders is from z."""
    bodies = bodies[np.isfinite(bodies).all(axis=1)]
    if not len(bodies):
        return Finding("ankles and shoulders are not seen together, which would tell where up is", None)
    up = bodies.mean(axis=0)
    lean = float(np.degrees(np.arccos(np.clip(up[2] / np.linalg.norm(up), -1.0, 1.0))))
    words = f"the person stands {lean:.0f}° off the z axis, in the mean of {len(bodies)} frames"
    return Finding(words, lean <= MOST_LEANING_DEG)


def _off(camera: Camera, marks: FloatArray, joints: FloatArray) -> float:
    """Return the median distance, px, of marks (F, J, 3) from joints (F, J, 3), m; those behind count as endless."""
    both = np.isfinite(marks[..., 0]) & np.isfinite(joints[..., 0])
    if not both.any():
        return float("nan")
    off = np.linalg.norm(camera.project(joints[both]) - marks[both][:, :2], axis=1)
    return float(np.median(np.nan_to_num(off, nan=np.inf)))


def _extent(marks: FloatArray) -> float:
    """Return how tall the person is in one camera's marks (F, J, 3), px: the median of the larger sides."""
    there = marks[np.isfinite(marks[..., 0]).sum(axis=1) > 1]
    if not len(there):
        return float("nan")
    return float(np.median((np.nanmax(there, axis=1) - np.nanmin(there, axis=1))[:, :2].max(axis=1)))


def _joint(values: FloatArray, name: str) -> FloatArray:
    return values[:, JOINT_NAMES.index(name)]


def _middle(values: FloatArray, name: str) -> FloatArray:
    return 0.5 * (_joint(values, f"left_{name}") + _joint(values, f"right_{name}"))


def _length(joints: FloatArray, side: str, upper: str, lower: str) -> float:
    """Return the median length, m, of a limb."""
    limb = np.linalg.norm(_joint(joints, f"{side}_{upper}") - _joint(joints, f"{side}_{lower}"), axis=1)
    return float(np.median(limb[np.isfinite(limb)])) if np.isfinite(limb).any() else float("nan")


def _px(value: float) -> str:
    return "unknown px" if np.isnan(value) else "behind it, endless px" if np.isinf(value) else f"{value:.1f} px"


def fits(findings: Sequence[Finding]) -> bool | None:
    """Tell whether all that could be judged fits; None where nothing could."""
    judged = [finding.fits for finding in findings if finding.fits is not None]
    return all(judged) if judged else None
