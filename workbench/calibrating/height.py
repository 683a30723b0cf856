"""One camera out of a person of known height who stands at several places on a level floor.

Where no board is at hand, feet and head of somebody upright are vertical sticks of known length: how long they look at
which place tells the focal length, the tilt and roll of the camera and its height (Criminisi, Reid & Zisserman, *Single
View Metrology*, IJCV 2000; Lv, Zhao & Nevatia, *Camera Calibration from Video of a Walking Human*, PAMI 2006). One
least-squares problem has the places of all sticks in it, and its Jacobian tells how sure each number is. What the
sticks leave open is as told or usual, and that is in it, too: the focal length, where all are equally far or the camera
is level, since f over the distance is all that is seen then.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from workbench.arrays import FloatArray
from workbench.body.camera import Camera
from workbench.body.shape import ANKLE_HEIGHT, HEAD_HEIGHT
from workbench.body.skeleton import JOINT_NAMES
from workbench.calibrating.rig import TO_LEVEL
from workbench.datasets.files.marks import Marks
from workbench.errors import InputError

LEAST_STICKS = 3
MOST_STICKS = 60
SIGMA_PX = 4.0
"""Of a mark by hand, until the residuals say more."""
USUAL_FOCAL, FOCAL_SPREAD = 1.0, 0.35
"""Median, in the image's longer sides, and standard deviation of the logarithm, of focal lengths of phones and
camcorders: 68 % within 0.70 and 1.42."""
POSTURE = 0.02
"""Standard deviation of a person's length from ankles to head, relative: who walks is shorter than who stands."""
DISTANCE_SIGMA = 0.05
"""Standard deviation of a paced or measured distance, relative."""
USUAL_HEIGHT_M, HEIGHT_SPREAD = 1.4, 0.7
"""Of a camera above the floor, and the standard deviation of its logarithm."""
TILT_SPREAD, ROLL_SPREAD = np.radians(10.0), np.radians(5.0)
"""Of cameras that somebody put up to film people: about level."""


@dataclass(frozen=True)
class Given:
    """What is known beforehand. height_m: of the person. focal_px: of the lens; None: a usual one. distance_m: from the
    camera to the person in the first frame, camera_height_m: of the camera above the floor; None: not measured."""

    height_m: float
    focal_px: float | None = None
    distance_m: float | None = None
    camera_height_m: float | None = None

    def __post_init__(self) -> None:
        if not 0.5 <= self.height_m <= 2.5:
            raise InputError(f"height: expected a person of 0.5 to 2.5 m, found {self.height_m:g} m")
        others = {"focal length": self.focal_px, "distance": self.distance_m, "camera height": self.camera_height_m}
        for name, value in others.items():
            if value is not None and not 0.0 < value < np.inf:
                raise InputError(f"height: expected a positive {name}, found {value:g}")


@dataclass(frozen=True, eq=False)
class ByHeight:
    """camera: in a world whose z axis is up, with its origin on the floor below the camera and x ahead. sigma: standard
    deviations by name: focal_px, tilt_deg, roll_deg, height_m. values: the same names. frames: of the sticks.
    errors_px: (F, 4), head and feet, [u, v], from where the camera has them. focal_learnt: 0 where the focal length is
    the usual one, up to 1 where marks and measurements tell it, or it was told."""

    camera: Camera
    values: dict[str, float]
    sigma: dict[str, float]
    frames: tuple[int, ...]
    errors_px: FloatArray
    focal_learnt: float

    @property
    def error_px(self) -> float:
        """Root mean square distance of heads and feet."""
        return float(np.sqrt(2.0 * np.mean(self.errors_px**2)))


def sticks(marks: Marks) -> tuple[tuple[int, ...], FloatArray, FloatArray]:
    """Return frames, and feet and heads (F, 2), px, of the frames in which both ankles and the head are marked.

    Feet are the middle of both ankles. Raises InputError for fewer than LEAST_STICKS.
    """
    ankles = [JOINT_NAMES.index(f"{side}_ankle") for side in ("left", "right")]
    feet, heads = marks.pixels[:, ankles].mean(axis=1), marks.pixels[:, JOINT_NAMES.index("head_centre")]
    whole = np.flatnonzero(np.isfinite(feet).all(axis=1) & np.isfinite(heads).all(axis=1))
    if len(whole) < LEAST_STICKS:
        words = f"both ankles and the head_centre marked in {LEAST_STICKS} frames or more"
        raise InputError(f"{marks.source}: expected {words}, found them in {len(whole)}")
    whole = whole[np.unique(np.linspace(0, len(whole) - 1, min(len(whole), MOST_STICKS)).round().astype(int))]
    return tuple(marks.frames[whole].tolist()), feet[whole], heads[whole]


def calibrate_height(
    name: str, size: tuple[int, int], frames: tuple[int, ...], feet: FloatArray, heads: FloatArray, given: Given
) -> ByHeight:
    """Find a camera with images of a size (width, height), px, from feet and heads (F, 2), px.

    The principal point is the image's middle, pixels are square, and there is no distortion. Raises InputError where
    heads are not above feet, and where no camera above the floor sees people so.
    """
    if (upside := np.flatnonzero(heads[:, 1] >= feet[:, 1])).size:
        raise InputError(f"frame {frames[upside[0]]}: expected the head above the ankles in the image, found it below")
    problem = _Problem(size, feet, heads, given)
    first = least_squares(problem.residuals, problem.start(), x_scale="jac", args=(SIGMA_PX,), max_nfev=2000)
    # of 4 numbers a stick 2 are used up by its place, hence the factor
    sigma_px = max(float(np.sqrt(2.0 * np.mean(problem.errors(first.x) ** 2))), 1.0)
    found = least_squares(problem.residuals, first.x, x_scale="jac", args=(sigma_px,), max_nfev=2000)
    errors = problem.errors(found.x)
    if not found.success or np.abs(errors).max() > 0.25 * max(size):
        raise InputError("height: no camera above a level floor sees a person of this height so: are the marks right?")
    jacobian = np.asarray(found.jac, np.float64)
    deviations = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    focal, tilt, roll, height = problem.numbers(found.x)
    values = {"focal_px": focal, "tilt_deg": np.degrees(tilt), "roll_deg": np.degrees(roll), "height_m": height}
    scales = (focal, np.degrees(1.0), np.degrees(1.0), height)
    sigma = {name: float(s * d) for name, s, d in zip(values, scales, deviations, strict=False)}
    learnt = 1.0 if given.focal_px else 1.0 - min((deviations[0] / problem.focal_spread) ** 2, 1.0)
    camera = replace(problem.camera(found.x), name=name)
    return ByHeight(camera, {k: float(v) for k, v in values.items()}, sigma, frames, errors, float(learnt))


class _Problem:
    """Unknown are log focal length, tilt, roll, log height of the camera, log of the sticks' length over the usual, and
    the places (F, 2) of all sticks on the floor: how far ahead (log) and to the left over that."""

    def __init__(self, size: tuple[int, int], feet: FloatArray, heads: FloatArray, given: Given) -> None:
        self.size, self.feet, self.heads, self.given = size, feet, heads, given
        self.usual_focal = given.focal_px or USUAL_FOCAL * max(size)
        self.focal_spread = 0.01 if given.focal_px else FOCAL_SPREAD
        self.low, self.high = ANKLE_HEIGHT * given.height_m, HEAD_HEIGHT * given.height_m

    def start(self) -> FloatArray:
        """Begin with a level camera at the usual height, before which sticks are as far off as they look."""
        tall = np.linalg.norm(self.heads - self.feet, axis=1)
        ahead = self.usual_focal * (self.high - self.low) / tall
        left = -(self.feet[:, 0] - (self.size[0] - 1) / 2) / self.usual_focal
        horizon = (self.size[1] - 1) / 2
        height = np.median(self.low + (self.feet[:, 1] - horizon) * ahead / self.usual_focal)
        unknown = [np.log(self.usual_focal), 0.0, 0.0, np.log(max(height, 0.3)), 0.0]
        return np.concatenate([unknown, np.column_stack([np.log(ahead), left]).ravel()])

    def numbers(self, x: FloatArray) -> tuple[float, float, float, float]:
        """Return focal length, px, tilt downwards and roll, rad, and height, m."""
        return float(np.exp(x[0])), float(x[1]), float(x[2]), float(np.exp(x[3]))

    def camera(self, x: FloatArray) -> Camera:
        """Return the camera of a solution."""
        focal, tilt, roll, height = self.numbers(x)
        c, s, cr, sr = np.cos(tilt), np.sin(tilt), np.cos(roll), np.sin(roll)
        down = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
        turn = np.array([[cr, -sr, 0.0], [sr, cr, 0.0], [0.0, 0.0, 1.0]])
        rotation = turn @ down @ TO_LEVEL
        centre = [(side - 1) / 2 for side in self.size]
        matrix = np.array([[focal, 0.0, centre[0]], [0.0, focal, centre[1]], [0.0, 0.0, 1.0]])
        return Camera("", *self.size, matrix, rotation, -rotation @ [0.0, 0.0, height], np.zeros(5))

    def errors(self, x: FloatArray) -> FloatArray:
        """Return how far heads and feet, (F, 4), px, are from where a solution has them."""
        camera, ahead = self.camera(x), np.exp(x[5::2])
        length = np.exp(x[4])
        feet = np.stack([ahead, x[6::2] * ahead, np.full(len(ahead), self.low)], axis=1)
        heads = feet + np.array([0.0, 0.0, (self.high - self.low) * length])
        off = [camera.pixels(camera.to_camera(points), -np.inf) for points in (heads, feet)]
        return np.concatenate([off[0] - self.heads, off[1] - self.feet], axis=1)

    def residuals(self, x: FloatArray, sigma_px: float) -> FloatArray:
        """Return whitened errors, and how far the solution is from what is usual or told."""
        given = self.given.camera_height_m
        height, spread = (USUAL_HEIGHT_M, HEIGHT_SPREAD) if given is None else (given, DISTANCE_SIGMA)
        prior = [(x[0] - np.log(self.usual_focal)) / self.focal_spread, x[4] / POSTURE]
        prior += [x[1] / TILT_SPREAD, x[2] / ROLL_SPREAD, (x[3] - np.log(height)) / spread]
        if self.given.distance_m is not None:
            far = x[5] + 0.5 * np.log1p(x[6] ** 2)
            prior.append((far - np.log(self.given.distance_m)) / DISTANCE_SIGMA)
        return np.concatenate([self.errors(x).ravel() / sigma_px, prior])
