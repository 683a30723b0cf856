"""Checks of a calibration against the people in front of the cameras."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.body.camera import Camera
from workbench.body.shape import ANKLE_HEIGHT, HEAD_HEIGHT, LEG_LENGTH, SHOULDER_HEIGHT
from workbench.body.skeleton import JOINT_NAMES
from workbench.camera_calibration.observed_joints import ObservedJoints
from workbench.evaluation.multiview_consistency import height_px, limb_lengths, triangulate_rays
from workbench.utils.arrays import FloatArray

_MIN_WEIGHT = 0.3
"""Detected joints of lower confidence are ignored."""
_MAX_ERROR = 0.035
"""Median distance, in heights of the person in the image, of joints from those of all cameras. For two, three and four
cameras of a laboratory it is up to 0.029; with two videos exchanged it exceeds 0.04 in 22 of 24 cases, and is
0.02 in two, where the cameras are opposite each other."""
_MAX_LEAN_DEG, _MAX_SLOPE_DEG = 20.0, 5.0
_HEIGHTS_M, _AVERAGE_HEIGHT_M = (1.2, 2.2), 1.7
"""Plausible heights, and the assumed one, of a person whose height is not set."""
_MAX_HEIGHT_ERROR = 0.1
"""Relative difference between measured legs and those of an average person of this height."""
_FOCAL_LENGTHS = (0.4, 5.0)
"""In longer sides of the image: below, the field of view exceeds 100°, above, it is less than 11°."""
_MIN_WALK_M = 1.0
"""Distance over which feet determine the slope of the floor."""
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class CalibrationFinding:
    """Result of one check. message: text for the user. fits: whether the value is as expected; None: undetermined."""

    message: str
    fits: bool | None = None


@dataclass(frozen=True, eq=False)
class CalibrationCheck:
    """joints: (F, J, 3), m, by all cameras or, for one camera, ankles and head of an upright person; NaN for others.
    floor_m: height of the floor under the feet; None: unknown."""

    findings: tuple[CalibrationFinding, ...]
    joints: FloatArray
    floor_m: float | None = None

    @property
    def fits(self) -> bool | None:
        """Whether all determined findings fit; None without any."""
        determined = [finding.fits for finding in self.findings if finding.fits is not None]
        return all(determined) if determined else None


def check_calibration(observed: ObservedJoints, height_m: float | None) -> CalibrationCheck:
    """Return the findings on a calibration, from people in front of the cameras; height_m: their height, if known."""
    lenses = [finding for camera in observed.cameras for finding in _lens(camera)]
    unknown = np.full((*observed.keypoints.shape[1:3], 3), np.nan)
    if not len(unknown):
        lenses.append(CalibrationFinding("no joints are annotated or detected in these frames"))
        return CalibrationCheck(tuple(lenses), unknown)
    several = len(observed.cameras) > 1
    check = _check_several(observed, height_m) if several else _check_single(observed, height_m, unknown)
    return CalibrationCheck((*lenses, *check.findings), check.joints, check.floor_m)


def _lens(camera: Camera) -> list[CalibrationFinding]:
    size, focal = np.array([camera.width, camera.height]), camera.matrix[[0, 1], [0, 1]]
    findings = [CalibrationFinding(f"{camera.name}: images are {size[0]}×{size[1]} px, as in the calibration")]
    ratios, (low, high) = focal / size.max(), _FOCAL_LENGTHS
    if not (low < ratios.min() and ratios.max() < high):
        text = f"is {ratios[0]:.2g} times the image's longer side, expected {low:g} to {high:g}"
        findings.append(CalibrationFinding(f"{camera.name}: the focal length, {focal[0]:.0f} px, {text}", False))
    centre = camera.matrix[:2, 2]
    if (np.abs(centre - (size - 1) / 2) / size).max() > 0.25:
        text = f"the principal point ({centre[0]:.0f}, {centre[1]:.0f}) is far from the image's middle"
        findings.append(CalibrationFinding(f"{camera.name}: {text}: a calibration for another image size?", False))
    return findings


def _check_several(observed: ObservedJoints, height_m: float | None) -> CalibrationCheck:
    """Check several cameras by triangulated joints."""
    joints = triangulate(observed.cameras, observed.keypoints)
    if not np.isfinite(joints).any():
        text = "no joint is annotated or detected by two cameras in one frame, so that their agreement is unknown"
        return CalibrationCheck((CalibrationFinding(text),), joints)
    findings = [_reprojection(observed, v, joints) for v in range(len(observed.cameras))]
    limbs = limb_lengths(joints)
    leg_m = limbs.get("thigh", np.nan) + limbs.get("calf", np.nan)
    findings.append(_size(leg_m / LEG_LENGTH, height_m))
    bodies = _middle(joints, "shoulder") - _middle(joints, "ankle")
    bodies = bodies[np.isfinite(bodies).all(axis=1)]
    if len(bodies):
        up = bodies.mean(axis=0)
        lean = float(np.degrees(np.arccos(np.clip(up[2] / np.linalg.norm(up), -1.0, 1.0))))
        text = f"the person leans by {lean:.0f}° from the z axis, in the mean of {len(bodies)} frames"
        findings.append(CalibrationFinding(text, lean <= _MAX_LEAN_DEG))
    else:
        text = "ankles and shoulders are never triangulated together: the vertical is unknown"
        findings.append(CalibrationFinding(text))
    heights = np.concatenate([_joint(joints, f"{side}_ankle")[:, 2] for side in ("left", "right")])
    if not np.isfinite(heights).any():
        return CalibrationCheck(tuple(findings), joints)
    tall = height_m or float(np.clip(leg_m / LEG_LENGTH, *_HEIGHTS_M))
    floor_m = float(np.nanpercentile(heights, 5)) - ANKLE_HEIGHT * (_AVERAGE_HEIGHT_M if np.isnan(tall) else tall)
    findings.append(CalibrationFinding(f"the feet stand at a height of {floor_m:.2f} m"))
    return CalibrationCheck(tuple(findings), joints, floor_m)


def triangulate(cameras: Sequence[Camera], keypoints: FloatArray) -> FloatArray:
    """Return points (F, J, 3), m, nearest to the rays of keypoints (V, F, J, 3), [u, v, weight]; NaN for
    fewer than two."""
    pixels = np.where(np.nan_to_num(keypoints[..., 2:]) >= _MIN_WEIGHT, keypoints[..., :2], np.nan)
    points = triangulate_rays([(camera, one.reshape(-1, 2)) for camera, one in zip(cameras, pixels, strict=True)])
    return points.reshape(*keypoints.shape[1:3], 3)


def _reprojection(observed: ObservedJoints, v: int, joints: FloatArray) -> CalibrationFinding:
    """Compare a camera's keypoints with the joints from all cameras, and from the others if these are several."""
    camera, keypoints = observed.cameras[v], observed.keypoints[v]
    others = [k for k in range(len(observed.cameras)) if k != v]
    error = _error_px(camera, keypoints, joints)
    if np.isnan(error):
        if observed.searched[v]:
            text = (
                "the person in the other cameras is not found; check that video, joints and calibration belong together"
            )
            return CalibrationFinding(f"{camera.name}: {text}", False)
        return CalibrationFinding(f"{camera.name}: no joint is also detected in another camera")
    text = f"{camera.name}: joints are {_px(error)} from those of all cameras together"
    if len(others) > 1:
        from_others = triangulate([observed.cameras[k] for k in others], observed.keypoints[others])
        text += f", {_px(_error_px(camera, keypoints, from_others))} from those of the others"
    heights = [height_px(frame[:, :2]) for frame in keypoints]
    tall = float(np.median([height for height in heights if height > 0.0] or [np.nan]))
    return CalibrationFinding(f"{text}; the person is {_px(tall)} tall", bool(error <= _MAX_ERROR * tall))


def _error_px(camera: Camera, keypoints: FloatArray, joints: FloatArray) -> float:
    """Return the median distance, px, of keypoints (F, J, 3) from joints (F, J, 3), m, infinite behind the camera; NaN
    without common ones."""
    common = np.isfinite(keypoints[..., 0]) & np.isfinite(joints[..., 0])
    if not common.any():
        return float("nan")
    distances = np.linalg.norm(camera.project(joints[common]) - keypoints[common][:, :2], axis=1)
    return float(np.median(np.nan_to_num(distances, nan=np.inf)))


def _size(measured_m: float, height_m: float | None) -> CalibrationFinding:
    """Compare the height of an average person with the measured legs with height_m, or with plausible heights."""
    if not np.isfinite(measured_m):
        return CalibrationFinding("no leg is triangulated: the unit of length is unknown")
    text = f"the legs are as long as those of a person of {measured_m:.2f} m"
    if height_m is None:
        is_plausible = _HEIGHTS_M[0] < measured_m < _HEIGHTS_M[1]
        question = "" if is_plausible else "; check the unit of length, or the side of the checkerboard's squares"
        return CalibrationFinding(text + question, is_plausible)
    return CalibrationFinding(
        f"{text}; expected {height_m:.2f} m", abs(measured_m / height_m - 1.0) <= _MAX_HEIGHT_ERROR
    )


def _check_single(observed: ObservedJoints, height_m: float | None, joints: FloatArray) -> CalibrationCheck:
    """Check one camera by people assumed upright, of height_m or the average height."""
    (camera,), keypoints, tall = observed.cameras, observed.keypoints[0], height_m or _AVERAGE_HEIGHT_M
    feet, heads = _middle(keypoints, "ankle")[:, :2], _joint(keypoints, "head_centre")[:, :2]
    length_m = (HEAD_HEIGHT - ANKLE_HEIGHT) * tall
    if not np.isfinite(heads).any():
        heads, length_m = _middle(keypoints, "shoulder")[:, :2], (SHOULDER_HEIGHT - ANKLE_HEIGHT) * tall
    complete = np.isfinite(feet + heads).all(axis=1)
    if not complete.any():
        text = "no frame has both ankles and the head or the shoulders: the camera's pose is unknown"
        return CalibrationCheck((CalibrationFinding(f"{camera.name}: {text}"),), joints)
    places = stand_upright(camera, feet[complete], heads[complete], length_m)
    for name in ("left_ankle", "right_ankle"):
        joints[complete, JOINT_NAMES.index(name)] = places
    joints[complete, JOINT_NAMES.index("head_centre")] = places + length_m * UP
    distances = camera.to_camera(places)[:, 2]
    floor_m = float(np.median(places[:, 2])) - ANKLE_HEIGHT * tall
    assumed = "" if height_m else ", assumed 1.70 m tall: set the height by body=height body.height_m=…"
    stands = f"the person stands {distances.min():.1f} to {distances.max():.1f} m away{assumed}"
    heights = f"the feet stand at a height of {floor_m:.2f} m, the camera at {camera.position[2]:.2f} m"
    findings = [
        _lean(camera, heads[complete] - feet[complete], places, length_m),
        CalibrationFinding(f"{camera.name}: {stands}"),
        CalibrationFinding(heights, None if camera.position[2] > floor_m - 0.5 else False),
        *_slope(places),
    ]
    return CalibrationCheck(tuple(findings), joints, floor_m)


def stand_upright(camera: Camera, feet: FloatArray, heads: FloatArray, length_m: float) -> FloatArray:
    """Return feet in the world, (F, 3), m, from pixels of feet (F, 2) and of heads (F, 2) length_m vertically above.

    With the rays a to the feet and b to the head, s a + length up = t b in the least-squares sense.
    """
    flat = camera.undistorted(np.concatenate([feet, heads]))
    a, b = np.split(np.column_stack([flat, np.ones(len(flat))]) @ camera.rotation, 2)
    s = np.linalg.pinv(np.stack([a, -b], axis=-1))[:, 0] @ (-length_m * UP)
    return camera.position + s[:, None] * a


def _lean(camera: Camera, bodies: FloatArray, places: FloatArray, length_m: float) -> CalibrationFinding:
    """Compare the directions of bodies in the image (F, 2), px, with the vertical there."""
    up = camera.project(places + length_m * UP) - camera.project(places)
    behind = ~np.isfinite(up).all(axis=1)
    if behind.any():
        text = f"in {behind.sum()} of {len(places)} frames the person would stand behind the camera: z is not up"
        return CalibrationFinding(f"{camera.name}: {text}", False)
    cross, dot = up[:, 0] * bodies[:, 1] - up[:, 1] * bodies[:, 0], (up * bodies).sum(axis=1)
    lean = abs(float(np.degrees(np.arctan2(cross.mean(), dot.mean()))))
    text = f"the person leans by {lean:.0f}° from the calibration's vertical, in the mean of {len(places)} frames"
    return CalibrationFinding(f"{camera.name}: {text}", lean <= _MAX_LEAN_DEG)


def _slope(places: FloatArray) -> list[CalibrationFinding]:
    """Estimate the slope of the floor along the walk over places (F, 3), m; empty where the walk is too short."""
    centred = places - places.mean(axis=0)
    walk = centred[:, :2] @ np.linalg.svd(centred[:, :2])[2][0]
    if len(places) < 3 or np.ptp(walk) < _MIN_WALK_M:
        return []
    slope = float(walk @ centred[:, 2] / (walk @ walk))
    error = np.sqrt(((centred[:, 2] - slope * walk) ** 2).sum() / (len(places) - 2) / (walk @ walk))
    degrees, sigma = abs(float(np.degrees(np.arctan(slope)))), float(np.degrees(np.arctan(error)))
    text = f"over {np.ptp(walk):.1f} m of walk the floor has a slope of {degrees:.1f} ± {sigma:.1f}°"
    return [CalibrationFinding(text, degrees <= _MAX_SLOPE_DEG + 2.0 * sigma)]


def _joint(values: FloatArray, name: str) -> FloatArray:
    return values[:, JOINT_NAMES.index(name)]


def _middle(values: FloatArray, name: str) -> FloatArray:
    return 0.5 * (_joint(values, f"left_{name}") + _joint(values, f"right_{name}"))


def _px(value: float) -> str:
    return "an unknown number of px" if np.isnan(value) else "behind it" if np.isinf(value) else f"{value:.1f} px"
