"""Checks of a calibration against the people in front of the cameras."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.body.shape import ANKLE_HEIGHT, HEAD_HEIGHT, SHOULDER_HEIGHT
from workbench.body.skeleton import JOINT_NAMES, joint_of, middle_of
from workbench.body.stature import limb_lengths, usual_height
from workbench.body.units import TYPICAL_M, UNIT_NAMES, is_person, unit_of_person
from workbench.cameras.camera import Camera
from workbench.cameras.camera_agreement import camera_findings
from workbench.cameras.image_height import height_px
from workbench.cameras.observed_joints import MIN_WEIGHT, ObservedJoints, some_frames
from workbench.cameras.triangulation import triangulate
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.finding import DOUBTFUL, NOT_USABLE, NOTE, TRUSTWORTHY, Finding, level_of

_MAX_ERROR = 0.035
"""Median distance, in heights of the person in the image, of joints from those of all cameras. For two, three and four
cameras of a laboratory it is up to 0.029; with two videos exchanged it exceeds 0.04 in 22 of 24 cases, and is
0.02 in two, where the cameras are opposite each other."""
_WRONG_ERROR = 0.12
"""The same from which on the cameras do not show the same person: a trunk's depth, so that joints lie
outside of the body."""
_MAX_LEAN_DEG, _MAX_SLOPE_DEG = 20.0, 5.0
_LYING_DEG = 60.0
"""Angle between the person's long axis and z from which on another axis is nearer to it."""
HEIGHTS_M = (1.2, 2.2)
"""Expected heights of a person whose height is not set, who is assumed to be of TYPICAL_M."""
MAX_HEIGHT_ERROR, _WRONG_HEIGHT_ERROR = 0.1, 0.25
"""Relative difference between the configured height and that of an average person with the measured limbs. Lengths over
the height differ by 5 % (one standard deviation) between people, and between a detector's joints and an anatomist's.
Beyond the second one, no adult has the other's limbs."""
_FOCAL_LENGTHS = (0.4, 5.0)
"""In longer sides of the image: below, the field of view exceeds 100°, above, it is less than 11°."""
_MAX_OFF_CENTRE = 0.12
"""Offset of the principal point from the image's middle, over the image's size. A calibration at r times the size is
off by |r - 1| / 2, at least 0.125 for the usual sizes (r = 3/4, 2/3, 1/2 and their inverses)."""
_DISTANCES_M = (0.3, 100.0)
"""Plausible distances of a person from a camera. At the second one, an adult is 30 px tall for 1700 px of focal
length."""
_FLOOR_M, _FLOOR_RELATIVE = 0.15, 0.1
"""Tolerance of the floor under the feet against z = 0: a stair, and the camera's height times the tolerance of the
person's height, which scales one camera's distances."""
_MAX_CLEARANCE = 0.1
"""Height of a walk's swinging ankle above the standing one, over the person's height."""
_MIN_HIPS = 0.41
"""Least height of an upright person's hips above the ankles, over the height: 0.49 by average proportions, 0.45 by a
detector's hips, and 0.30 of a person in a chair whose head is taken for that of an upright one."""
_MIN_WALK_M = 1.0
"""Distance over which feet determine the slope of the floor."""
_KILOMETRE = 1000.0
"""The only longer unit, in which a camera's height is more than zero and less than the precision of any rig."""
UP = np.array([0.0, 0.0, 1.0])
_SMALL_M = 0.01
"""Length of a vertical at a distance of 1 m whose image is nearly its tangent."""


@dataclass(frozen=True, eq=False)
class CalibrationCheck:
    """joints: (F, J, 3), m, by all cameras or, for one camera, ankles and head of an upright person; NaN for others.
    floor_m: height of the floor under the feet; None: unknown."""

    findings: tuple[Finding, ...]
    joints: FloatArray
    floor_m: float | None = None

    @property
    def level(self) -> str:
        """The worst level of the findings."""
        return level_of(self.findings)


def check_calibration(observed: ObservedJoints, height_m: float | None) -> CalibrationCheck:
    """Return the findings on a calibration, from people in front of the cameras; height_m: their height, if known."""
    lenses = [finding for camera in observed.cameras for finding in lens_findings(camera)]
    unknown = np.full((*observed.keypoints.shape[1:3], 3), np.nan)
    if not np.isfinite(observed.keypoints[..., 0]).any():
        lenses.append(Finding("calibration", "no joints are annotated or detected in these frames"))
        return CalibrationCheck(tuple(lenses), unknown)
    in_image = [each for v in range(len(observed.cameras)) for each in _in_image(observed, v)]
    if any(each.level == NOT_USABLE for each in in_image):
        return CalibrationCheck((*lenses, *in_image), unknown)
    several = len(observed.cameras) > 1
    check = _check_several(observed, height_m) if several else _check_single(observed, height_m, unknown)
    return CalibrationCheck((*lenses, *in_image, *check.findings), check.joints, check.floor_m)


def _in_image(observed: ObservedJoints, v: int) -> Iterator[Finding]:
    """Compare a camera's keypoints with its image: whether they are pixels, and lie inside."""
    camera, pixels = observed.cameras[v], observed.pixels()[v].reshape(-1, 2)
    source = (pixels[np.isfinite(pixels).all(axis=1)] + 0.5) / observed.scale - 0.5
    size = np.array([camera.width, camera.height]) / observed.scale
    if not len(source):
        return
    outside = float(((source < -0.5) | (source > size - 0.5)).any(axis=1).mean())
    if (np.abs(source - 0.5) <= 1.0).all():
        text = "all keypoints lie between 0 and 1: they are fractions of the image, expected pixels"
        yield Finding("keypoints outside the image", f"{camera.name}: {text}", NOT_USABLE)
    elif outside > 0.5:
        text = f"{outside:.0%} of the keypoints lie outside of the image of {size[0]:.0f}×{size[1]:.0f} px"
        yield Finding("keypoints outside the image", f"{camera.name}: {text}", NOT_USABLE)


def lens_findings(camera: Camera) -> list[Finding]:
    """Return the findings on a camera's image size, focal length and principal point."""
    size, focal = np.array([camera.width, camera.height]), camera.matrix[[0, 1], [0, 1]]
    text = f"{camera.name}: images are {size[0]}×{size[1]} px, as in the calibration"
    findings = [Finding("image size", text, NOTE)]
    ratios, (low, high) = focal / size.max(), _FOCAL_LENGTHS
    if not (low < ratios.min() and ratios.max() < high):
        text = f"is {ratios[0]:.2g} times the image's longer side, expected {low:g} to {high:g}"
        findings.append(Finding("focal length", f"{camera.name}: the focal length, {focal[0]:.0f} px, {text}"))
    centre = camera.matrix[:2, 2]
    if (np.abs(centre - (size - 1) / 2) / size).max() > _MAX_OFF_CENTRE:
        text = f"the principal point ({centre[0]:.0f}, {centre[1]:.0f}) is far from the image's middle"
        findings.append(Finding("image size", f"{camera.name}: {text}: a calibration for another image size?"))
    return findings


def _check_several(observed: ObservedJoints, height_m: float | None) -> CalibrationCheck:
    """Check several cameras by triangulated joints."""
    joints = triangulate(observed.cameras, observed.pixels(MIN_WEIGHT))
    if not np.isfinite(joints).any():
        text = "no joint is annotated or detected by two cameras in one frame, so that their agreement is unknown"
        return CalibrationCheck((Finding("inconsistent cameras", text),), joints)
    each = [_reprojection(observed, v, joints) for v in range(len(observed.cameras))]
    explained = list(camera_findings(observed, explain=any(finding.is_problem for finding in each)))
    findings = [*explained, *(replace(one, level=NOTE) if explained and one.is_problem else one for one in each)]
    if any(finding.level == NOT_USABLE for finding in findings):
        return CalibrationCheck(tuple(findings), joints)
    limbs = limb_lengths(joints)
    findings.append(_size(limbs, height_m))
    findings.append(_upright(joints))
    heights = np.concatenate([joint_of(joints, f"{side}_ankle")[:, 2] for side in ("left", "right")])
    if not np.isfinite(heights).any():
        return CalibrationCheck(tuple(findings), joints)
    tall = height_m or (float(np.clip(usual_height(limbs), *HEIGHTS_M)) if limbs else TYPICAL_M)
    floor_m = float(np.nanpercentile(heights, 5)) - ANKLE_HEIGHT * tall
    if not any(finding.is_problem for finding in findings):
        findings.append(_floor(floor_m, observed.cameras, "the feet stand"))
    return CalibrationCheck(tuple(findings), joints, floor_m)


def _upright(joints: FloatArray) -> Finding:
    """Compare the mean directions from ankles and hips to shoulders, of joints (F, J, 3), m, with z."""
    ends = [middle_of(joints, name) for name in ("shoulder", "ankle", "hip")]
    ends = [each[np.isfinite(ends).all(axis=(0, 2))] for each in ends]
    if not len(ends[0]):
        text = "ankles, hips and shoulders are never triangulated together: the vertical is unknown"
        return Finding("vertical", text, NOTE)
    body, trunk = ((ends[0] - each).mean(axis=0) for each in ends[1:])
    return upright(body, trunk, f"in the mean of {len(ends[0])} frames")


def upright(body: FloatArray, trunk: FloatArray, where: str) -> Finding:
    """Compare a person's axes (3,), from the feet and from the hips upwards, with z; where: of which observations.

    A person who sits has an upright trunk, and one who bends has feet below the head: the less inclined axis counts.
    People lie, so that an axis at right angles to z is doubtful; upside down it is not usable.
    """
    axis = max(body, trunk, key=lambda each: float(each[2] / np.linalg.norm(each)))
    lean = float(np.degrees(np.arccos(np.clip(axis[2] / np.linalg.norm(axis), -1.0, 1.0))))
    text = f"the person leans by {lean:.0f}° from the z axis, {where}"
    if lean < _LYING_DEG:
        return Finding("vertical", text, TRUSTWORTHY if lean <= _MAX_LEAN_DEG else DOUBTFUL)
    largest = int(np.argmax(np.abs(axis)))
    sign = "-" if axis[largest] < 0.0 else ""
    up = f"the axis that points up is {sign}{'xyz'[largest]}, expected z"
    if lean < 180.0 - _LYING_DEG:
        return Finding("vertical", f"{text}: {up}, or the person lies")
    return Finding("vertical", f"{text}: {up}", NOT_USABLE)


def _floor(floor_m: float, cameras: Sequence[Camera], subject: str) -> Finding:
    """Compare the height of the floor under the feet with z = 0; a world whose origin is a camera has no floor."""
    text = f"{subject} at a height of {floor_m:.2f} m"
    heights = [camera.position[2] for camera in cameras]
    if min(float(np.linalg.norm(camera.position)) for camera in cameras) < _FLOOR_M:
        return Finding("ground contact", text, NOTE)
    tolerance = _FLOOR_M + _FLOOR_RELATIVE * max(map(abs, heights))
    if abs(floor_m) <= tolerance:
        return Finding("ground contact", text, TRUSTWORTHY)
    where = "above" if floor_m > 0.0 else "below"
    return Finding("ground contact", f"{text}, {abs(floor_m):.2f} m {where} the calibration's floor z = 0")


def _reprojection(observed: ObservedJoints, v: int, joints: FloatArray) -> Finding:
    """Compare a camera's keypoints with the joints from all cameras, and from the others if these are several."""
    rows, kind = some_frames(len(joints)), "inconsistent cameras"
    camera, keypoints, joints = observed.cameras[v], observed.keypoints[v, rows], joints[rows]
    others = [k for k in range(len(observed.cameras)) if k != v]
    error = _error_px(camera, keypoints, joints)
    if np.isnan(error):
        if observed.searched[v]:
            text = (
                "the person in the other cameras is not found; check that video, joints and calibration belong together"
            )
            return Finding(kind, f"{camera.name}: {text}", NOT_USABLE)
        return Finding(kind, f"{camera.name}: no joint is also detected in another camera", NOTE)
    text = f"{camera.name}: joints are {_px(error)} from those of all cameras together"
    if len(others) > 1:
        from_others = triangulate([observed.cameras[k] for k in others], observed.pixels(MIN_WEIGHT)[others, rows])
        text += f", {_px(_error_px(camera, keypoints, from_others))} from those of the others"
    heights = height_px(keypoints[..., :2])
    tall = float(np.median(heights[heights > 0.0])) if (heights > 0.0).any() else float("nan")
    text += f", and the person is {_px(tall)} tall"
    limits = {TRUSTWORTHY: _MAX_ERROR * tall, DOUBTFUL: _WRONG_ERROR * tall}
    return Finding(kind, text, next((level for level, limit in limits.items() if error <= limit), NOT_USABLE))


def _error_px(camera: Camera, keypoints: FloatArray, joints: FloatArray) -> float:
    """Return the median distance, px, of keypoints (F, J, 3) from joints (F, J, 3), m, infinite behind the camera; NaN
    without common ones."""
    common = np.isfinite(keypoints[..., 0]) & np.isfinite(joints[..., 0])
    if not common.any():
        return float("nan")
    distances = np.linalg.norm(camera.project(joints[common]) - keypoints[common][:, :2], axis=1)
    return float(np.median(np.nan_to_num(distances, nan=np.inf)))


def _size(limbs: Mapping[str, float], height_m: float | None) -> Finding:
    """Compare the height of an average person with the measured limbs, m, with height_m, or with plausible heights."""
    if not limbs:
        return Finding("height mismatch", "no limb is triangulated: the unit of length is unknown", NOTE)
    measured_m = usual_height(limbs)
    expected_m = height_m or TYPICAL_M
    lengths = ", ".join(f"{limb.replace('_', ' ')} {100.0 * length:.0f}" for limb, length in limbs.items())
    text = f"the limbs are as long as those of a person of {measured_m:.2f} m ({lengths} cm)"
    if unit := unit_of(measured_m / expected_m):
        return Finding("unit of length", f"{text}: the calibration is in {unit}, expected metres", NOT_USABLE)
    if height_m is None:
        if HEIGHTS_M[0] < measured_m < HEIGHTS_M[1]:
            return Finding("height mismatch", text, TRUSTWORTHY)
        text += ": check the unit of length, or the side of the checkerboard's squares"
        level = DOUBTFUL if 0.5 * HEIGHTS_M[0] < measured_m < 1.5 * HEIGHTS_M[1] else NOT_USABLE
        return Finding("height mismatch", text, level)
    difference = abs(np.log(measured_m / height_m))
    limits = {TRUSTWORTHY: MAX_HEIGHT_ERROR, DOUBTFUL: _WRONG_HEIGHT_ERROR}
    level = next((level for level, limit in limits.items() if difference <= np.log1p(limit)), NOT_USABLE)
    return Finding("height mismatch", f"{text}, expected {height_m:.2f} m", level)


def unit_of(ratio: float) -> str | None:
    """Return the name of the unit in which a length that is `ratio` times the expected one is given instead of metres,
    or None: the one in which a typical person of that length is of a plausible size."""
    if is_person(_KILOMETRE * ratio * TYPICAL_M):
        return "kilometres"
    unit = unit_of_person(ratio * TYPICAL_M, UNIT_NAMES)
    return None if unit is None else UNIT_NAMES[unit]


def _check_single(observed: ObservedJoints, height_m: float | None, joints: FloatArray) -> CalibrationCheck:
    """Check one camera by people assumed upright, of height_m or the average height."""
    (camera,), tall = observed.cameras, height_m or TYPICAL_M
    keypoints = (observed.keypoints if observed.in_cameras is None else observed.in_cameras)[0]
    feet, heads = middle_of(keypoints, "ankle")[:, :2], joint_of(keypoints, "head_centre")[:, :2]
    length_m = (HEAD_HEIGHT - ANKLE_HEIGHT) * tall
    if not np.isfinite(heads).any():
        heads, length_m = middle_of(keypoints, "shoulder")[:, :2], (SHOULDER_HEIGHT - ANKLE_HEIGHT) * tall
    rows: IntArray = np.flatnonzero(np.isfinite(feet + heads).all(axis=1))
    if not len(rows):
        text = "no frame has both ankles and the head or the shoulders: the camera's pose is unknown"
        return CalibrationCheck((Finding("vertical", f"{camera.name}: {text}", NOTE),), joints)
    places = stand_upright(camera, feet[rows], heads[rows], length_m)
    floor_m = float(np.median(places[:, 2])) - ANKLE_HEIGHT * tall
    lean = _lean(camera, feet[rows], heads[rows])
    if lean.is_problem:
        return CalibrationCheck((lean,), joints, floor_m)
    erect = ~(_hip_heights(camera, places, middle_of(keypoints[rows], "hip")[:, :2]) < _MIN_HIPS * tall)
    if not erect.any():
        text = "the person is never upright, so that the distance and the floor under the feet are unknown"
        return CalibrationCheck((lean, Finding("distance", f"{camera.name}: {text}", NOTE)), joints)
    rows, places = rows[erect], places[erect]
    for name in ("left_ankle", "right_ankle"):
        joints[rows, JOINT_NAMES.index(name)] = places
    joints[rows, JOINT_NAMES.index("head_centre")] = places + length_m * UP
    floor_m = float(np.median(places[:, 2])) - ANKLE_HEIGHT * tall
    assumed = "" if height_m else ", assumed 1.70 m tall: set the height by body=height body.height_m=…"
    findings = [lean, distance(camera, places, assumed), _camera_height(camera, floor_m)]
    if camera.uncertainty is None:  # an estimated camera follows from the same heads and feet
        findings += _slope(places[_stands(keypoints[rows])], camera)
    return CalibrationCheck(tuple(findings), joints, floor_m)


def distance(camera: Camera, places: FloatArray, remark: str = "") -> Finding:
    """Compare the distances of places (F, 3), m, from a camera with plausible ones."""
    distances = camera.to_camera(places)[:, 2]
    low, high = np.nanpercentile(distances, [5.0, 95.0])
    text = f"{camera.name}: the person stands {low:.1f} to {high:.1f} m away{remark}"
    if _DISTANCES_M[0] < np.nanmedian(distances) < _DISTANCES_M[1]:
        return Finding("distance", text, TRUSTWORTHY)
    nearest, farthest = _DISTANCES_M
    return Finding("distance", f"{text}, expected {nearest:g} to {farthest:g} m", NOT_USABLE)


def _camera_height(camera: Camera, floor_m: float) -> Finding:
    """Compare the floor under the feet with z = 0 and with the camera, whose height above it is independent of the
    calibration's unit."""
    z_m, above_m = float(camera.position[2]), float(camera.position[2]) - floor_m
    if above_m > 0.0 and (unit := unit_of(abs(z_m) / above_m)):
        text = f"{camera.name}: the camera is {above_m:.2f} m above the feet, and at z = {z_m:.4g}"
        return Finding("unit of length", f"{text}: the calibration is in {unit}, expected metres", NOT_USABLE)
    finding = _floor(floor_m, [camera], f"{camera.name}: the camera is at a height of {z_m:.2f} m, and the feet stand")
    return replace(finding, level=DOUBTFUL) if above_m < -0.5 else finding


def stand_upright(camera: Camera, feet: FloatArray, heads: FloatArray, length_m: float) -> FloatArray:
    """Return feet in the world, (F, 3), m, from pixels of feet (F, 2) and of heads (F, 2) length_m vertically above.

    With the rays a to the feet and b to the head, s a + length up = t b in the least-squares sense.
    """
    flat = camera.undistorted(np.concatenate([feet, heads]))
    a, b = np.split(np.column_stack([flat, np.ones(len(flat))]) @ camera.rotation, 2)
    s = np.linalg.pinv(np.stack([a, -b], axis=-1))[:, 0] @ (-length_m * UP)
    return camera.position + s[:, None] * a


def _hip_heights(camera: Camera, places: FloatArray, hips: FloatArray) -> FloatArray:
    """Return the heights (F,), m, of hips in the image (F, 2), px, above upright people's feet at places (F, 3); NaN at
    NaN. The vertical line above the feet and the ray of the hips are nearest to each other there."""
    rays, to_camera = camera.directions(camera.undistorted(hips)), camera.position - places
    slant = rays @ UP
    height = to_camera @ UP - slant * (to_camera * rays).sum(axis=1)
    return np.asarray(height / np.maximum(1.0 - slant**2, 1e-9))


def _lean(camera: Camera, feet: FloatArray, heads: FloatArray) -> Finding:
    """Compare the mean direction from feet (F, 2) to heads (F, 2), px, with that of the vertical at the feet.

    The vertical's direction in the image does not depend on the distance of the feet, so that it is also known where
    the person is upside down, in all frames or, by a wrong keypoint, in one.
    """
    flat = np.column_stack([camera.undistorted(feet), np.ones(len(feet))])
    places = camera.position + flat @ camera.rotation  # at a depth of 1 m
    up, bodies = camera.project(places + _SMALL_M * UP) - camera.project(places), heads - feet
    cross, dot = up[:, 0] * bodies[:, 1] - up[:, 1] * bodies[:, 0], (up * bodies).sum(axis=1)
    lean = abs(float(np.degrees(np.arctan2(cross.mean(), dot.mean()))))
    text = f"the person leans by {lean:.0f}° from the calibration's vertical, in the mean of {len(places)} frames"
    limits = {TRUSTWORTHY: _MAX_LEAN_DEG, DOUBTFUL: 180.0 - _LYING_DEG}
    level = next((level for level, limit in limits.items() if lean <= limit), NOT_USABLE)
    return Finding("vertical", f"{camera.name}: {text}", level)


def _stands(keypoints: FloatArray) -> BoolArray:
    """Return in which frames (F,) of keypoints (F, J, 3) both feet are near the ground and the trunk is over them.

    The ankles' heights in the image differ by less than 0.1 of the person's, the clearance of a walk's swinging foot,
    and the neck is nearly above their middle.
    """
    ankles = np.stack([joint_of(keypoints, f"{side}_ankle")[:, :2] for side in ("left", "right")])
    trunk = middle_of(keypoints, "shoulder")[:, :2] - ankles.mean(axis=0)
    heights = np.linalg.norm(trunk, axis=1) / (SHOULDER_HEIGHT - ANKLE_HEIGHT)
    together = np.abs(ankles[0, :, 1] - ankles[1, :, 1]) < _MAX_CLEARANCE * heights
    angles = np.degrees(np.arctan2(trunk[:, 0], -trunk[:, 1]))
    return np.asarray(together & (np.abs(angles - np.nanmedian(angles)) < 0.5 * _MAX_LEAN_DEG))


def _slope(places: FloatArray, camera: Camera) -> list[Finding]:
    """Estimate the slope of the floor along the walk over places (F, 3), m; empty where the walk is too short.

    A person who bends seems to walk away, along the ray through the feet. These rays meet a level floor in one place.
    """
    if len(places) < 3:
        return []
    centred = places - places.mean(axis=0)
    direction = np.linalg.svd(centred[:, :2])[2][0]
    walk, rays = centred[:, :2] @ direction, places - camera.position
    with np.errstate(divide="ignore", invalid="ignore"):  # rays that are level do not meet the floor
        on_floor = rays[:, :2] @ direction * np.median(rays[:, 2]) / rays[:, 2]
    if np.ptp(walk) < _MIN_WALK_M or np.ptp(on_floor) < _MIN_WALK_M:
        return []
    slope = float(walk @ centred[:, 2] / (walk @ walk))
    error = np.sqrt(((centred[:, 2] - slope * walk) ** 2).sum() / (len(places) - 2) / (walk @ walk))
    degrees, sigma = abs(float(np.degrees(np.arctan(slope)))), float(np.degrees(np.arctan(error)))
    text = f"over {np.ptp(walk):.1f} m of walk the floor has a slope of {degrees:.1f} ± {sigma:.1f}°"
    return [Finding("ground contact", text, TRUSTWORTHY if degrees <= _MAX_SLOPE_DEG + 2.0 * sigma else DOUBTFUL)]


def _px(value: float) -> str:
    return "an unknown number of px" if np.isnan(value) else "behind it" if np.isinf(value) else f"{value:.1f} px"
