"""Calibration of one camera by a person of known height who stands at several places on a level floor.

Head and feet of an upright person are the ends of a vertical segment of known length. The lengths and positions of
such head–foot segments in the image determine the focal length, the tilt and roll of the camera and its height
(Criminisi, Reid & Zisserman, *Single View Metrology*, IJCV 2000; Lv, Zhao & Nevatia, *Camera Calibration from Video of
a Walking Human*, PAMI 2006). All parameters and the positions of all segments are estimated in one least-squares
problem, whose Jacobian gives standard deviations. Priors cover what the segments leave undetermined: with a level
camera or equal distances only the focal length over the distance is observable, and without segments nothing is.

World landmarks also measure the tilt by themselves, as they show a standing person in the axes of a camera that looks
at the person: a person whose head is nearer to the camera than the feet is seen from above.

Segments of detections come from frames in which the person is upright by the detector's world landmarks, because a
shorter segment is else taken for a larger distance, and in which head and feet are in the image. Where hardly any frame
is such, as landmarks of a person seen from above are poor, they come from all frames, with an uncertain length.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy

from workbench.body.shape import ANKLE_HEIGHT, HEAD_HEIGHT
from workbench.body.skeleton import JOINT_NAMES, joint_of, middle_of
from workbench.cameras.camera import N_ROW_POSE, Camera, level_rotation
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.errors import InputError

_MIN_SEGMENTS, _MAX_SEGMENTS = 3, 60
SIGMA_PX = 4.0
"""Standard deviation of annotations, until the residuals give it."""
FOCAL_MEDIAN, FOCAL_SPREAD = 1.0, 0.35
"""Median, in longer sides of the image, and standard deviation of the logarithm, of focal lengths of phones and
camcorders: 68 % within 0.70 and 1.42."""
_KNOWN_FOCAL_SPREAD = 1e-4
"""Of a calibrated lens, below the precision of any calibration, so that its focal length is not estimated again."""
_POSTURE_SPREAD, _UNKNOWN_POSTURE_SPREAD = 0.02, 0.15
"""Relative standard deviation of a person's length from ankles to head: shorter when walking than when standing; and of
a person in an unknown posture, in a chair for example 20 % shorter."""
_MEASUREMENT_SPREAD = 0.05
"""Relative standard deviation of a paced or measured distance."""
_CAMERA_HEIGHT_M, _CAMERA_HEIGHT_SPREAD = 1.4, 0.7
"""Median height above the floor, and standard deviation of its logarithm."""
_TILT_SPREAD, _ROLL_SPREAD = np.radians(15.0), np.radians(5.0)
"""Cameras that are set up to film people are about level; those on a wall or a mast look down by 20 to 45°."""
_LEAN_SPREAD = 0.03
"""Smallest standard deviation, rad, of the direction from feet to head from the vertical, which all segments share:
people lean forward while they walk and to a side while they stand."""
_INCLINATION_SPREAD = np.radians(8.0)
"""Of an upright person by world landmarks: two people, one before four calibrated cameras and one before one, were
measured with errors of 6° (root of the mean square) in the axes of the camera."""
_START_TILTS = (0.0, *np.radians([20.0, 40.0]))
"""Of the search, downwards."""
_DISTANCE_SPREAD = 1.0
"""Standard deviation of the logarithm of a distance, over the focal length, from that of a level camera: a factor of e.
The length of a segment determines it far better, unless the camera looks along the segment."""
_OUTLIER = 3.0
"""Standard deviations at which Huber's loss of an error becomes linear: confused joints are no evidence."""
_OUTLIER_SQUARE = _OUTLIER**2 / np.log(2.0)
"""Squared error of an outlier over the median, of two numbers: the other two of a segment determine its place."""
_TOLERANCE, _SEARCH_TOLERANCE = 1e-7, 1e-4
"""Of the solution, and of the search for where it starts."""
_STEP = 1e-6
"""Of the unknowns, for numerical derivatives."""
_N_SHARED = 7
"""Number of unknowns shared by all segments."""
_UPRIGHT_RATIO = 0.9
"""Smallest distance from the ankles' midpoint to the head over the length of legs, trunk and neck in between. It is
0.97 in stance and above 0.92 in a walk's longest step. Bent by 60° at the hips, or by 75° at the knees, a body of the
usual proportions has less."""
_SAME_PLACE = 0.03
"""Distance of feet at one place in the image, over the segment's length: two standard deviations of detected joints."""
_MIN_CONFIDENCE = 0.5
"""Of a head or foot that is evidence: below, the detector rates it as rather invisible."""


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
        """RMS distance of heads and feet; 0 without segments."""
        return float(np.sqrt(2.0 * np.mean(self.errors_px**2))) if len(self.errors_px) else 0.0


class Segments(NamedTuple):
    """Frames (F), feet (the mean of both ankles) and heads, (F, 2), px, and the relative standard deviation of the
    length from ankles to head that all share.

    inclination: median angle, rad, by which upright people's heads incline towards the camera, in the axes of a camera
    that looks at them, NaN if unknown. middle: (2,) median of their middles in the image, px.
    """

    frames: tuple[int, ...]
    feet: FloatArray
    heads: FloatArray
    posture_spread: float = _POSTURE_SPREAD
    inclination: float = np.nan
    middle: tuple[float, float] = (np.nan, np.nan)


def head_foot_segments(frames: IntArray, pixels: FloatArray, source: str) -> Segments:
    """Return the segments of the frames with all of these joints annotated.

    Parameters
    ----------
    frames : (T,) their numbers.
    pixels : (T, J, 2) of the joints, px; NaN where unknown.
    source : of the joints, for messages.

    Raises
    ------
    InputError
        For fewer than _MIN_SEGMENTS frames, and where a head is not above the feet.
    """
    rows = np.asarray(np.isfinite(_head_and_feet(pixels)).all(axis=(1, 2)), bool)
    if rows.sum() < _MIN_SEGMENTS:
        expected = f"both ankles and the head_centre annotated in {_MIN_SEGMENTS} frames or more"
        raise InputError(f"{source}: expected {expected}, found {rows.sum()}")
    segments = _segments(frames, pixels, rows)
    if (inverted := np.flatnonzero(segments.heads[:, 1] >= segments.feet[:, 1])).size:
        raise InputError(f"frame {segments.frames[inverted[0]]}: expected the head above the ankles, found it below")
    return segments


def detected_segments(
    frames: IntArray, pixels: FloatArray, confidence: FloatArray, world_landmarks: FloatArray | None
) -> Segments:
    """Return the segments of detections that show a person from head to feet, possibly none: of an upright one if at
    least _MIN_SEGMENTS frames show that, else of one in an unknown posture.

    Parameters
    ----------
    frames, pixels : as for `head_foot_segments`.
    confidence : (T, J), 0..1.
    world_landmarks : (T, J, 3), see `upright`; None: unknown, every person is taken for upright.
    """
    ends = _head_and_feet(pixels)
    shown = np.isfinite(ends).all(axis=(1, 2))
    confident = (_head_and_feet(confidence) >= _MIN_CONFIDENCE).all(axis=1)
    head_above = ends[:, 0, 1] < ends[:, 1:, 1].min(axis=1)
    rows, spread = shown & confident & head_above, _POSTURE_SPREAD
    inclination, middle = np.nan, (np.nan, np.nan)
    if world_landmarks is not None:
        stands = rows & upright(world_landmarks)
        rows, spread = (stands, spread) if stands.sum() >= _MIN_SEGMENTS else (rows, _UNKNOWN_POSTURE_SPREAD)
        inclination, middle = _inclination(world_landmarks[stands], pixels[stands])
    rows[rows] = _longest(ends[rows, 1:].mean(axis=1), ends[rows, 0])
    segments = _segments(frames, pixels, rows)
    return segments._replace(posture_spread=spread, inclination=inclination, middle=middle)


def _inclination(world_landmarks: FloatArray, pixels: FloatArray) -> tuple[float, tuple[float, float]]:
    """Return inclination and middle of `Segments` by the landmarks (T, J, 3) and pixels (T, J, 2) of upright people,
    NaN for fewer than _MIN_SEGMENTS."""
    if len(pixels) < _MIN_SEGMENTS:
        return np.nan, (np.nan, np.nan)
    ends = _head_and_feet(world_landmarks)
    up = np.median(ends[:, 0] - ends[:, 1:].mean(axis=1), axis=0)
    u, v = np.nanmedian(np.nanmean(pixels, axis=1), axis=0).tolist()
    return float(np.arctan2(-up[2], -up[1])), (u, v)


def in_image(pixels: FloatArray, size: tuple[int, int]) -> FloatArray:
    """Return detected joints' pixels (..., 2), NaN outside of images of a size (width, height), px, where they are the
    detector's guess."""
    inside = ((pixels >= 0.0) & (pixels <= np.array(size) - 1.0)).all(axis=-1, keepdims=True)
    return np.where(inside, pixels, np.nan)


def upright(world_landmarks: FloatArray) -> BoolArray:
    """Return in which frames (T,) of world landmarks (T, J, 3), m, the person is upright with straight legs.

    The distance from the ankles' midpoint to the head is then that over legs, trunk and neck, up to _UPRIGHT_RATIO. It
    is independent of the camera's attitude and of the landmarks' scale. False for unknown landmarks.
    """

    def length(first: FloatArray, last: FloatArray) -> FloatArray:
        return np.asarray(np.linalg.norm(last - first, axis=1))

    legs = [
        length(joint_of(world_landmarks, f"{side}_{first}"), joint_of(world_landmarks, f"{side}_{last}"))
        for side in ("left", "right")
        for first, last in (("hip", "knee"), ("knee", "ankle"))
    ]
    shoulders, hips, ankles = (middle_of(world_landmarks, name) for name in ("shoulder", "hip", "ankle"))
    head = joint_of(world_landmarks, "head_centre")
    along = 0.5 * np.sum(legs, axis=0) + length(hips, shoulders) + length(shoulders, head)
    return np.asarray(length(ankles, head) > _UPRIGHT_RATIO * along, bool)


def _head_and_feet(values: FloatArray) -> FloatArray:
    """Return the values (T, 3, ...) of head, left and right ankle among those of the joints (T, J, ...)."""
    names = ("head_centre", "left_ankle", "right_ankle")
    return values[:, [JOINT_NAMES.index(name) for name in names]]


def _longest(feet: FloatArray, heads: FloatArray) -> BoolArray:
    """Return the segments (F,) without those that have a longer one at the same place on the floor, within _SAME_PLACE.

    Every other posture of a person who stands still is shorter than the upright one.
    """
    lengths, longest = np.linalg.norm(heads - feet, axis=1), np.zeros(len(feet), bool)
    for k in np.argsort(-lengths, kind="stable"):
        distances = np.linalg.norm(feet[longest] - feet[k], axis=1)
        longest[k] = not (distances < _SAME_PLACE * lengths[longest]).any()
    return longest


def _segments(frames: IntArray, pixels: FloatArray, usable: BoolArray) -> Segments:
    """Return at most _MAX_SEGMENTS segments of the usable frames (T,), evenly spread."""
    rows = np.flatnonzero(usable)
    chosen = np.unique(np.linspace(0, len(rows) - 1, min(len(rows), _MAX_SEGMENTS)).round().astype(int))
    ends = _head_and_feet(pixels[rows[chosen]])
    return Segments(tuple(frames[rows[chosen]].tolist()), ends[:, 1:].mean(axis=1), ends[:, 0])


def calibrate_by_height(name: str, size: tuple[int, int], segments: Segments, data: Measurements) -> HeightCalibration:
    """Calibrate a camera with its principal point in the image's middle, square pixels and no distortion.

    Parameters
    ----------
    size : (width, height) of the images, px
    segments : without any, the camera is that of the priors: level at an assumed height.

    Raises
    ------
    InputError
        Where no camera above the floor explains the segments.
    """
    problem, (frames, feet, heads) = _Problem(size, segments, data), segments[:3]
    first = problem.search()
    sigma_px, lean = SIGMA_PX, _LEAN_SPREAD
    if frames:
        squares = np.sum(problem.errors(first.x) ** 2, axis=1)
        spread_px = np.sqrt(float(np.mean(squares[squares <= _OUTLIER_SQUARE * np.median(squares)])) / 2.0)
        length_px = float(np.median(np.linalg.norm(heads - feet, axis=1)))
        n_steps = min(max((frames[-1] - frames[0]) / data.step_frames, 1.0), len(frames))
        sigma_px = max(spread_px, data.gait * length_px, 1.0) * np.sqrt(len(frames) / n_steps)
        lean = max(lean, spread_px / length_px)
    solution = problem.fit(first.x, sigma_px, lean)
    errors = problem.errors(solution.x)
    if frames and np.median(np.abs(errors).max(axis=1)) > 0.25 * max(size):
        raise InputError(
            "height: no camera above a level floor explains the segments for this height; check the annotations"
        )
    jacobian = np.asarray(solution.jac, np.float64)
    covariance = np.linalg.inv(jacobian.T @ jacobian)[:4, :4]
    deviations = np.sqrt(np.diag(covariance))
    focal, tilt, roll, height = map(float, (np.exp(solution.x[0]), *solution.x[1:3], np.exp(solution.x[3])))
    names, degree = ("focal_px", "tilt_deg", "roll_deg", "height_m"), np.degrees(1.0)
    values = dict(zip(names, map(float, (focal, degree * tilt, degree * roll, height)), strict=True))
    sigma = dict(zip(names, (deviations * (focal, degree, degree, height)).tolist(), strict=True))
    information = 1.0 if data.focal_px else 1.0 - min(float(deviations[0] / FOCAL_SPREAD) ** 2, 1.0)
    uncertainty = problem.row_changes(solution.x, np.linalg.cholesky(covariance))
    camera = replace(problem.camera(solution.x), name=name, uncertainty=uncertainty)
    return HeightCalibration(camera, values, sigma, frames, errors, information)


def pose_by_height(lens: Camera, segments: Segments, data: Measurements) -> HeightCalibration:
    """Return the pose of a camera whose matrix and distortion are known, by `calibrate_by_height`.

    The segments are moved to where a camera without distortion, of the same focal length and with its principal point
    in the middle, has them. Raises InputError as `calibrate_by_height`.
    """
    size, focal_px = (lens.width, lens.height), float(lens.matrix[0, 0])
    middle = (np.array(size) - 1.0) / 2.0
    feet, heads, middles = (
        lens.undistorted(pixels) * focal_px + middle
        for pixels in (segments.feet, segments.heads, np.array([segments.middle]))
    )
    known = replace(data, focal_px=focal_px, focal_spread=_KNOWN_FOCAL_SPREAD)
    moved = segments._replace(feet=feet, heads=heads, middle=(float(middles[0, 0]), float(middles[0, 1])))
    estimate = calibrate_by_height(lens.name, size, moved, known)
    uncertainty = estimate.camera.uncertainty
    if uncertainty is not None:
        uncertainty = np.where(np.arange(uncertainty.shape[1]) < N_ROW_POSE, uncertainty, 0.0)
    rotation, translation = estimate.camera.rotation, estimate.camera.translation
    placed = replace(lens, rotation=rotation, translation=translation, uncertainty=uncertainty)
    return replace(estimate, camera=placed)


class _Problem:
    """Least squares over log focal length, px, tilt downwards and roll, rad, log height of the camera, m, log of the
    segments' relative length, their lean ahead and to the left, rad, and the places (F, 2) on the floor: log distance
    ahead, and left over ahead."""

    def __init__(self, size: tuple[int, int], segments: Segments, data: Measurements) -> None:
        self.size, self.data = size, data
        self.segments, self.feet, self.heads = segments, segments.feet, segments.heads
        self.focal_px = data.focal_px or FOCAL_MEDIAN * max(size)
        self.centre = (size[0] - 1) / 2, (size[1] - 1) / 2
        self.low, self.high = ANKLE_HEIGHT * data.height_m, HEAD_HEIGHT * data.height_m
        lengths_px = np.linalg.norm(self.heads - self.feet, axis=1).clip(min=1.0)
        self.log_ahead = np.log(self.focal_px * (self.high - self.low) / lengths_px)

    def initial(self, tilt: float) -> FloatArray:
        """Return a camera of this tilt, rad, with the expected focal length, and distances by the segments' lengths."""
        left, height = -(self.feet[:, 0] - self.centre[0]) / self.focal_px, _CAMERA_HEIGHT_M
        log_ahead = self.log_ahead + 2.0 * np.log(np.cos(tilt))  # of a segment and a line of sight that are inclined
        if len(self.feet):
            below = tilt + np.arctan((self.feet[:, 1] - self.centre[1]) / self.focal_px)
            height = max(float(np.median(self.low + np.exp(log_ahead) * np.tan(below))), 0.3)
        common = [np.log(self.focal_px), tilt, 0.0, np.log(height), 0.0, 0.0, 0.0]
        return np.concatenate([common, np.column_stack([log_ahead, left]).ravel()])

    def search(self) -> "scipy.optimize.OptimizeResult":
        """Return the best minimum from _START_TILTS, for errors of SIGMA_PX: a camera near the floor, tilted up, and
        one high above it, tilted down, both explain some segments."""
        tilts = _START_TILTS if len(self.feet) else (0.0,)
        fits = [self.fit(self.initial(tilt), SIGMA_PX, tolerance=_SEARCH_TOLERANCE) for tilt in tilts]
        return self.fit(min(fits, key=lambda fit: float(fit.cost)).x, SIGMA_PX)

    def fit(
        self, x: FloatArray, sigma_px: float, lean: float = _LEAN_SPREAD, tolerance: float = _TOLERANCE
    ) -> "scipy.optimize.OptimizeResult":
        """Return the minimum near x for errors and a lean of standard deviations sigma_px and lean, rad."""
        return scipy.optimize.least_squares(
            self.residuals, x, self.jacobian, x_scale="jac", args=(sigma_px, lean), ftol=tolerance, xtol=tolerance,
            gtol=tolerance, max_nfev=100,
        )  # fmt: skip

    def jacobian(self, x: FloatArray, sigma_px: float, lean: float = _LEAN_SPREAD) -> FloatArray:
        """Return the Jacobian of `residuals` by central differences, those of all places at once, as each changes the
        residuals of its own segment only."""
        n, n_errors = len(self.feet), 4 * len(self.feet)

        def difference(columns: slice) -> FloatArray:
            step = np.zeros(len(x))
            step[columns] = _STEP
            return (self.residuals(x + step, sigma_px, lean) - self.residuals(x - step, sigma_px, lean)) / (2.0 * _STEP)

        shared = np.column_stack([difference(slice(k, k + 1)) for k in range(_N_SHARED)])
        jacobian = np.concatenate([shared, np.zeros((len(shared), 2 * n))], axis=1)
        for k in range(2):
            columns, change = slice(_N_SHARED + k, None, 2), difference(slice(_N_SHARED + k, None, 2))
            jacobian[:n_errors, columns] = np.repeat(np.eye(n), 4, axis=0) * change[:n_errors, None]
            jacobian[-n:, columns] = np.diag(change[-n:]) if n else 0.0
        if self.data.distance_m is not None:  # of the first segment, and the only prior of a place
            row, place = len(jacobian) - n - 1, slice(_N_SHARED, _N_SHARED + 2)
            jacobian[row, place] = [difference(slice(c, c + 1))[row] for c in range(_N_SHARED, _N_SHARED + 2)]
        return jacobian

    def camera(self, x: FloatArray) -> Camera:
        """Return the camera of a solution."""
        focal, height, rotation = np.exp(x[0]), np.exp(x[3]), level_rotation(x[1], x[2])
        matrix = np.array([[focal, 0.0, self.centre[0]], [0.0, focal, self.centre[1]], [0.0, 0.0, 1.0]])
        return Camera("", *self.size, matrix, rotation, -rotation @ [0.0, 0.0, height], np.zeros(5))

    def row_changes(self, x: FloatArray, deviations: FloatArray) -> FloatArray:
        """Return the changes (G, 23) of `Camera.row` by the columns (4, G) of the first unknowns' deviations."""
        steps = np.zeros((deviations.shape[1], len(x)))
        steps[:, : len(deviations)] = _STEP * deviations.T
        changes = [self.camera(x + step).row - self.camera(x - step).row for step in steps]
        return np.stack(changes) / (2.0 * _STEP)

    def errors(self, x: FloatArray) -> FloatArray:
        """Return the residuals of heads and feet, (F, 4), px."""
        camera, ahead = self.camera(x), np.exp(x[_N_SHARED::2])
        feet = np.stack([ahead, x[_N_SHARED + 1 :: 2] * ahead, np.full(len(ahead), self.low)], axis=1)
        heads = feet + (self.high - self.low) * np.exp(x[4]) * np.array([x[5], x[6], 1.0])
        pixels = camera.pixels(camera.to_camera(np.stack([heads, feet])), -np.inf)
        return np.concatenate([pixels[0] - self.heads, pixels[1] - self.feet], axis=1)

    def residuals(self, x: FloatArray, sigma_px: float, lean: float = _LEAN_SPREAD) -> FloatArray:
        """Return whitened errors and whitened distances from priors and measurements."""
        height, spread = _CAMERA_HEIGHT_M, _CAMERA_HEIGHT_SPREAD
        if self.data.camera_height_m is not None:
            height, spread = self.data.camera_height_m, _MEASUREMENT_SPREAD
        focal_spread = self.data.focal_spread if self.data.focal_px else FOCAL_SPREAD
        prior = [
            (x[0] - np.log(self.focal_px)) / focal_spread, x[4] / self.segments.posture_spread,
            x[5] / lean, x[6] / lean, x[1] / _TILT_SPREAD, x[2] / _ROLL_SPREAD, (x[3] - np.log(height)) / spread,
        ]  # fmt: skip
        if np.isfinite(self.segments.inclination):
            below = np.arctan((self.segments.middle[1] - self.centre[1]) / np.exp(x[0]))
            prior.append((x[1] + below - self.segments.inclination) / _INCLINATION_SPREAD)
        if self.data.distance_m is not None:
            log_distance = x[_N_SHARED] + 0.5 * np.log1p(x[_N_SHARED + 1] ** 2)
            prior.append((log_distance - np.log(self.data.distance_m)) / _MEASUREMENT_SPREAD)
        distances = (x[_N_SHARED::2] - x[0] - self.log_ahead + np.log(self.focal_px)) / _DISTANCE_SPREAD
        return np.concatenate([_huber(self.errors(x).ravel() / sigma_px), prior, distances])


def _huber(errors: FloatArray) -> FloatArray:
    """Return residuals whose half squares are Huber's loss of whitened errors."""
    sizes = np.abs(errors)
    beyond = np.sign(errors) * np.sqrt(np.maximum(_OUTLIER * (2.0 * sizes - _OUTLIER), 0.0))
    return np.where(sizes <= _OUTLIER, errors, beyond)
