"""Calibration of one camera by a person of known height who stands at several places on a level floor.

Head and feet of an upright person are the ends of a vertical segment of known length. The lengths and positions of
such head–foot segments in the image determine the focal length, the tilt and roll of the camera and its height
(Criminisi, Reid & Zisserman, *Single View Metrology*, IJCV 2000; Lv, Zhao & Nevatia, *Camera Calibration from Video of
a Walking Human*, PAMI 2006). All parameters and the positions of all segments are estimated in one least-squares
problem, whose Jacobian gives standard deviations. Priors cover what the segments leave undetermined: with a level
camera or equal distances only the focal length over the distance is observable.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from workbench.body.shape import ANKLE_HEIGHT, HEAD_HEIGHT
from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.camera import TO_LEVEL, Camera
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

_MIN_SEGMENTS, _MAX_SEGMENTS = 3, 60
SIGMA_PX = 4.0
"""Standard deviation of annotations, until the residuals give it."""
FOCAL_MEDIAN, FOCAL_SPREAD = 1.0, 0.35
"""Median, in longer sides of the image, and standard deviation of the logarithm, of focal lengths of phones and
camcorders: 68 % within 0.70 and 1.42."""
_KNOWN_FOCAL_SPREAD = 1e-4
"""Of a calibrated lens, below the precision of any calibration, so that its focal length is not estimated again."""
_POSTURE_SPREAD = 0.02
"""Relative standard deviation of a person's length from ankles to head: shorter when walking than when standing."""
_MEASUREMENT_SPREAD = 0.05
"""Relative standard deviation of a paced or measured distance."""
_CAMERA_HEIGHT_M, _CAMERA_HEIGHT_SPREAD = 1.4, 0.7
"""Median height above the floor, and standard deviation of its logarithm."""
_TILT_SPREAD, _ROLL_SPREAD = np.radians(10.0), np.radians(5.0)
"""Cameras that are set up to film people are about level."""


@dataclass(frozen=True)
class Measurements:
    """Measured quantities; None: not measured. height_m: of the person. focal_px: of the lens. distance_m: from the
    camera to the person in the first frame. camera_height_m: above the floor. gait: standard deviation of the heads and
    feet of a walking person about those of an upright one, over the length in between; it is the same within about
    step_frames frames. focal_spread: relative standard deviation of focal_px."""

    height_m: float
    focal_px: float | None = None
    distance_m: float | None = None
    camera_height_m: float | None = None
    gait: float = 0.0
    step_frames: float = 1.0
    focal_spread: float = 0.01

    def __post_init__(self) -> None:
        if not 0.5 <= self.height_m <= 2.5:
            raise InputError(f"height: expected a person of 0.5 to 2.5 m, found {self.height_m:g} m")
        others = {"focal length": self.focal_px, "distance": self.distance_m, "camera height": self.camera_height_m}
        for name, value in others.items():
            if value is not None and not 0.0 < value < np.inf:
                raise InputError(f"height: expected a positive {name}, found {value:g}")


@dataclass(frozen=True, eq=False)
class HeightCalibration:
    """camera: in a world with z up, its origin on the floor below the camera, x ahead. values, sigma: estimates and
    standard deviations of focal_px, tilt_deg, roll_deg, height_m. frames: of the segments. errors_px: (F, 4), residuals
    of head and feet, [u, v]. focal_information: 0 where the prior alone determines the focal length, up to 1 where
    annotations and measurements do."""

    camera: Camera
    values: dict[str, float]
    sigma: dict[str, float]
    frames: tuple[int, ...]
    errors_px: FloatArray
    focal_information: float

    @property
    def error_px(self) -> float:
        """RMS distance of heads and feet."""
        return float(np.sqrt(2.0 * np.mean(self.errors_px**2)))


def head_foot_segments(
    frames: IntArray, pixels: FloatArray, source: str
) -> tuple[tuple[int, ...], FloatArray, FloatArray]:
    """Return frames, feet (the mean of both ankles) and heads, (F, 2), px, of frames with all of these joints.

    Parameters
    ----------
    frames : (T,) their numbers.
    pixels : (T, J, 2) of the joints, px; NaN where unknown.
    source : of the joints, for messages.

    Raises
    ------
    InputError
        For fewer than _MIN_SEGMENTS frames.
    """
    ankles = [JOINT_NAMES.index(f"{side}_ankle") for side in ("left", "right")]
    feet, heads = pixels[:, ankles].mean(axis=1), pixels[:, JOINT_NAMES.index("head_centre")]
    rows = np.flatnonzero(np.isfinite(feet + heads).all(axis=1))
    if len(rows) < _MIN_SEGMENTS:
        expected = f"both ankles and the head_centre annotated in {_MIN_SEGMENTS} frames or more"
        raise InputError(f"{source}: expected {expected}, found {len(rows)}")
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(len(rows), _MAX_SEGMENTS)).round().astype(int))]
    return tuple(frames[rows].tolist()), feet[rows], heads[rows]


def calibrate_by_height(
    name: str, size: tuple[int, int], frames: tuple[int, ...], feet: FloatArray, heads: FloatArray, data: Measurements
) -> HeightCalibration:
    """Calibrate a camera with its principal point in the image's middle, square pixels and no distortion.

    Parameters
    ----------
    size : (width, height) of the images, px
    frames, feet, heads : of F segments; feet and heads (F, 2), px

    Raises
    ------
    InputError
        Where a head is not above the feet, and where no camera above the floor explains the segments.
    """
    if (inverted := np.flatnonzero(heads[:, 1] >= feet[:, 1])).size:
        raise InputError(f"frame {frames[inverted[0]]}: expected the head above the ankles, found it below")
    problem = _Problem(size, feet, heads, data)
    first = least_squares(problem.residuals, problem.initial(), x_scale="jac", args=(SIGMA_PX,), max_nfev=2000)
    # two of the four numbers of a segment determine its place, hence the factor
    rms_px = float(np.sqrt(2.0 * np.mean(problem.errors(first.x) ** 2)))
    n_steps = min(max((frames[-1] - frames[0]) / data.step_frames, 1.0), len(frames))
    gait_px = data.gait * float(np.median(np.linalg.norm(heads - feet, axis=1))) * np.sqrt(len(frames) / n_steps)
    sigma_px = max(rms_px, float(gait_px), 1.0)
    solution = least_squares(problem.residuals, first.x, x_scale="jac", args=(sigma_px,), max_nfev=2000)
    errors = problem.errors(solution.x)
    if not solution.success or np.abs(errors).max() > 0.25 * max(size):
        raise InputError(
            "height: no camera above a level floor explains the segments for this height; check the annotations"
        )
    jacobian = np.asarray(solution.jac, np.float64)
    deviations = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    focal, tilt, roll, height = np.exp(solution.x[0]), *solution.x[1:3], np.exp(solution.x[3])
    names, degree = ("focal_px", "tilt_deg", "roll_deg", "height_m"), np.degrees(1.0)
    values = dict(zip(names, map(float, (focal, degree * tilt, degree * roll, height)), strict=True))
    sigma = dict(zip(names, (deviations[:4] * (focal, degree, degree, height)).tolist(), strict=True))
    information = 1.0 if data.focal_px else 1.0 - min(float(deviations[0] / FOCAL_SPREAD) ** 2, 1.0)
    camera = replace(problem.camera(solution.x), name=name)
    return HeightCalibration(camera, values, sigma, frames, errors, information)


def pose_by_height(
    lens: Camera, frames: tuple[int, ...], feet: FloatArray, heads: FloatArray, data: Measurements
) -> HeightCalibration:
    """Return the pose of a camera whose matrix and distortion are known, by `calibrate_by_height`.

    The segments are moved to where a camera without distortion, of the same focal length and with its principal point
    in the middle, has them. Raises InputError as `calibrate_by_height`.
    """
    size, focal_px = (lens.width, lens.height), float(lens.matrix[0, 0])
    middle = (np.array(size) - 1.0) / 2.0
    feet, heads = (lens.undistorted(pixels) * focal_px + middle for pixels in (feet, heads))
    known = replace(data, focal_px=focal_px, focal_spread=_KNOWN_FOCAL_SPREAD)
    estimate = calibrate_by_height(lens.name, size, frames, feet, heads, known)
    placed = replace(lens, rotation=estimate.camera.rotation, translation=estimate.camera.translation)
    return replace(estimate, camera=placed)


class _Problem:
    """Least squares over log focal length, px, tilt downwards and roll, rad, log height of the camera, m, log of the
    segments' relative length, and the places (F, 2) on the floor: log distance ahead, and left over ahead."""

    def __init__(self, size: tuple[int, int], feet: FloatArray, heads: FloatArray, data: Measurements) -> None:
        self.size, self.feet, self.heads, self.data = size, feet, heads, data
        self.focal_px = data.focal_px or FOCAL_MEDIAN * max(size)
        self.centre = (size[0] - 1) / 2, (size[1] - 1) / 2
        self.low, self.high = ANKLE_HEIGHT * data.height_m, HEAD_HEIGHT * data.height_m

    def initial(self) -> FloatArray:
        """Return a level camera with the expected focal length, and distances from the lengths of the segments."""
        ahead = self.focal_px * (self.high - self.low) / np.linalg.norm(self.heads - self.feet, axis=1)
        left = -(self.feet[:, 0] - self.centre[0]) / self.focal_px
        height = np.median(self.low + (self.feet[:, 1] - self.centre[1]) * ahead / self.focal_px)
        common = [np.log(self.focal_px), 0.0, 0.0, np.log(max(height, 0.3)), 0.0]
        return np.concatenate([common, np.column_stack([np.log(ahead), left]).ravel()])

    def camera(self, x: FloatArray) -> Camera:
        """Return the camera of a solution."""
        focal, height, (c, cr), (s, sr) = np.exp(x[0]), np.exp(x[3]), np.cos(x[1:3]), np.sin(x[1:3])
        tilt = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
        roll = np.array([[cr, -sr, 0.0], [sr, cr, 0.0], [0.0, 0.0, 1.0]])
        rotation = roll @ tilt @ TO_LEVEL
        matrix = np.array([[focal, 0.0, self.centre[0]], [0.0, focal, self.centre[1]], [0.0, 0.0, 1.0]])
        return Camera("", *self.size, matrix, rotation, -rotation @ [0.0, 0.0, height], np.zeros(5))

    def errors(self, x: FloatArray) -> FloatArray:
        """Return the residuals of heads and feet, (F, 4), px."""
        camera, ahead = self.camera(x), np.exp(x[5::2])
        feet = np.stack([ahead, x[6::2] * ahead, np.full(len(ahead), self.low)], axis=1)
        heads = feet + np.array([0.0, 0.0, (self.high - self.low) * np.exp(x[4])])
        pixels = [camera.pixels(camera.to_camera(points), -np.inf) for points in (heads, feet)]
        return np.concatenate([pixels[0] - self.heads, pixels[1] - self.feet], axis=1)

    def residuals(self, x: FloatArray, sigma_px: float) -> FloatArray:
        """Return whitened errors and whitened distances from priors and measurements."""
        height, spread = _CAMERA_HEIGHT_M, _CAMERA_HEIGHT_SPREAD
        if self.data.camera_height_m is not None:
            height, spread = self.data.camera_height_m, _MEASUREMENT_SPREAD
        focal_spread = self.data.focal_spread if self.data.focal_px else FOCAL_SPREAD
        prior = [
            (x[0] - np.log(self.focal_px)) / focal_spread, x[4] / _POSTURE_SPREAD,
            x[1] / _TILT_SPREAD, x[2] / _ROLL_SPREAD, (x[3] - np.log(height)) / spread,
        ]  # fmt: skip
        if self.data.distance_m is not None:
            log_distance = x[5] + 0.5 * np.log1p(x[6] ** 2)
            prior.append((log_distance - np.log(self.data.distance_m)) / _MEASUREMENT_SPREAD)
        return np.concatenate([self.errors(x).ravel() / sigma_px, prior])
