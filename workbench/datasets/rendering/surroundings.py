"""What is seen around a person: floor, wall, bins and a bar in points, a textured room, and a board carried by."""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from workbench.body.camera import Camera
from workbench.body.limbs import Body, Limbs
from workbench.datasets.rendering.render import background, camera_rays
from workbench.datasets.rendering.sequence import Take
from workbench.datasets.rendering.visible import first_depth, inside, surface_points
from workbench.motion.synthetic.gait import ANKLE_HEIGHT
from workbench.utils.arrays import FloatArray, IntArray

BOX_M = np.array([0.8, 0.8, 1.1])
"""Half sizes of the box about the root in which clutter and outliers are kept, as a tracker would."""
WALL_M, _BINS_M = 0.65, 0.5  # how far behind the person's way the wall and the bins are
_BIN_RADIUS_M, _BIN_HEIGHT_M, _BAR_HEIGHT_M = 0.12, 0.7, 3.0
_CANDIDATES = 12
_TEXEL_M = 0.01
_WALL_BEHIND_M = 1.5  # how far behind the person's way the wall stands
_WALL_SIZE, _FLOOR_SIZE = (500, 1600), (1200, 1600)
_SAMPLES = 2
BOARD_WIDTH, BOARD_HEIGHT = (0.15, 0.3), (0.5, 1.1)
"""Of the board, drawn between these, in parts of the person's height in the image."""
_BOARD_SPEED = (0.03, 0.06)
"""At which it passes the person, a frame at 30 Hz, in the same parts."""
_BOARD_PASSES = (0.35, 0.65)
"""When it is in front of their middle, in parts of the clip."""
_BOARD_RATE_HZ = 30.0


@dataclass(frozen=True, eq=False)
class Surroundings:
    """floor_m: height of the floor. wall_m: depth of a wall facing the camera. bins: upright cylinders as a body."""

    floor_m: float
    wall_m: float
    bins: Body


def surroundings(take: Take, camera: Camera) -> Surroundings:
    """A floor under the feet, a wall behind the way, and two bins between wall and way."""
    roots = take.motion.poses[:, :3]
    floor = float(take.places[..., 2].min() - ANKLE_HEIGHT * take.motion.shape.calf)
    forward = camera.rotation[2]
    behind = roots[[len(roots) // 4, 3 * len(roots) // 4]] + _BINS_M * forward
    behind[:, 2] = floor
    wall = float(camera.to_camera(roots)[:, 2].max()) + WALL_M
    return Surroundings(floor, wall, _uprights(take.body, behind, _BIN_RADIUS_M, _BIN_HEIGHT_M))


def bar(take: Take, camera: Camera, width_m: float) -> Body:
    """An upright bar of that width half-way between the camera and where the person is half-way through."""
    foot = 0.5 * (camera.position + take.motion.poses[len(take.motion) // 2, :3])
    foot[2] -= 0.5 * _BAR_HEIGHT_M
    return _uprights(take.body, foot[None], 0.5 * width_m, _BAR_HEIGHT_M)


def _uprights(body: Body, feet: FloatArray, radius_m: float, height_m: float) -> Body:
    """Upright cylinders with their feet (M, 3) fixed in the world, as the limbs of a body whose pose is all zeros."""
    n = len(feet)
    limbs = Limbs(
        names=tuple(f"upright_{i}" for i in range(n)), joints=np.zeros(n, dtype=np.int64), starts=feet,
        ends=feet + np.array([0.0, 0.0, height_m]), radii=np.full((n, 2, 2), radius_m), spheres=np.zeros(n, dtype=bool),
    )  # fmt: skip
    return replace(body, limbs=limbs)


def in_box(centre: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
    """n points (n, 3) anywhere in the box about a root at `centre` (3,)."""
    return centre + BOX_M * rng.uniform(-1.0, 1.0, (n, 3))


def clutter_points(
    around: Surroundings, centre: FloatArray, camera: Camera, n: int, rng: np.random.Generator
) -> FloatArray:
    """Draw up to n points (n, 3), m, of floor, wall and bins in the box about `centre` that these do not hide, from as
    many candidates on each of the three, so that the small bins are not lost."""
    many = _CANDIDATES * n
    floor, wall = in_box(centre, many, rng), in_box(centre, many, rng)
    floor[:, 2] = around.floor_m
    wall += np.outer(around.wall_m - camera.to_camera(wall)[:, 2], camera.rotation[2])
    standing = np.zeros(len(around.bins.skeleton.dof_names))
    bins = surface_points(around.bins, standing, many, rng)
    points = rng.permutation(np.concatenate([floor, wall, bins]))
    points = points[(np.abs(points - centre) <= BOX_M).all(axis=1) & inside(camera, points)]
    points = points[points[:, 2] >= around.floor_m - 1e-9]
    points = points[camera.to_camera(points)[:, 2] <= around.wall_m + 1e-9]
    return not_hidden(points, camera, around.bins, standing)[:n]


def not_hidden(points: FloatArray, camera: Camera, body: Body, pose: FloatArray) -> FloatArray:
    """Select those of points (K, 3) that a body in a pose (P,) does not hide from the camera."""
    if not len(points):
        return points
    return points[first_depth(body, pose, camera, points) > camera.to_camera(points)[:, 2] - 1e-3]


@dataclass(frozen=True, eq=False)
class _SceneRoom:
    """An upright wall and a floor with pictures on them, one texel a centimetre. forward, right: (3,) level directions
    across and along the wall. origin: (3,), m, a point of the wall's foot. wall, floor: (rows, columns) grey levels,
    upwards and towards the camera from the wall's foot, about the origin."""

    forward: FloatArray
    right: FloatArray
    origin: FloatArray
    wall: FloatArray
    floor: FloatArray


def room(take: Take, camera: Camera, rng: np.random.Generator, clutter: float = 1.0) -> _SceneRoom:
    """A floor under a person's feet and a wall behind their way that faces a level camera."""
    forward, right = camera.rotation[2], camera.rotation[0]
    roots = take.motion.poses[:, :3]
    behind = camera.to_camera(roots)[:, 2].max() + _WALL_BEHIND_M
    origin = camera.position + behind * forward
    origin[2] = take.places[..., 2].min() - ANKLE_HEIGHT * take.motion.shape.calf
    wall, floor = (background(*size, rng, clutter) for size in (_WALL_SIZE, _FLOOR_SIZE))
    return _SceneRoom(forward, right, origin, wall, floor)


def empty_view(room: _SceneRoom, camera: Camera) -> FloatArray:
    """Render the room as a camera before the wall and above the floor sees it, (height, width) grey levels without
    noise; beyond their edges the pictures go on mirrored."""
    directions = camera_rays(camera, _SAMPLES).directions
    rays = np.concatenate([directions, np.ones((*directions.shape[:2], 1))], axis=2) @ camera.rotation
    eye = camera.position - room.origin
    with np.errstate(divide="ignore"):
        to_floor = np.where(rays[..., 2] < 0.0, -eye[2] / rays[..., 2], np.inf)
        to_wall = -(eye @ room.forward) / (rays @ room.forward)
    on_floor = to_floor < to_wall
    at = eye + np.minimum(to_floor, to_wall)[..., None] * rays
    along, up, out = at @ room.right, at[..., 2], -(at @ room.forward)
    seen = np.where(on_floor, _texels(room.floor, along, out), _texels(room.wall, along, up))
    return seen.reshape(camera.height, _SAMPLES, camera.width, _SAMPLES).mean(axis=(1, 3))


def _texels(picture: FloatArray, along: FloatArray, across: FloatArray) -> FloatArray:
    """The grey levels at metres along and across from the middle of a picture's first row."""
    columns = (along / _TEXEL_M + 0.5 * picture.shape[1]).astype(np.float32)
    rows = (across / _TEXEL_M).astype(np.float32)
    seen = cv2.remap(picture.astype(np.float32), columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    return np.asarray(seen, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Board:
    """An upright rectangle with a pattern. picture: (h, w) grey levels. corners: (F, 2), whole px, the row and column
    of its upper left corner in each frame, which may lie outside the image."""

    picture: FloatArray
    corners: IntArray

    def cover(self, image: FloatArray, frame: int) -> FloatArray:
        """Return the image (height, width) with what of the board is in it in a frame drawn over it."""
        top, left = self.corners[frame]
        height, width = self.picture.shape
        rows = np.arange(max(top, 0), min(top + height, image.shape[0]))
        columns = np.arange(max(left, 0), min(left + width, image.shape[1]))
        covered = image.copy()
        covered[np.ix_(rows, columns)] = self.picture[np.ix_(rows - top, columns - left)]
        return covered


def passing_board(pixels: FloatArray, rate_hz: float, rng: np.random.Generator) -> Board:
    """Draw a board that passes once in front of a person whose joints are at pixels (F, J, 2), from either side.

    It keeps its pace beside the person, so that it passes whoever walks with or against it: before and after its
    passage it is beside them. It reaches from below the person upwards, and may hide the head or leave it free.
    """
    low, high = pixels.min(axis=1), pixels.max(axis=1)
    tall = float(np.median(high[:, 1] - low[:, 1]))
    width, height = (max(1, round(tall * rng.uniform(*span))) for span in (BOARD_WIDTH, BOARD_HEIGHT))
    side, pace = rng.choice([-1.0, 1.0]), tall * rng.uniform(*_BOARD_SPEED) * _BOARD_RATE_HZ / rate_hz
    passing = rng.uniform(*_BOARD_PASSES) * (len(pixels) - 1)
    middle = 0.5 * (low[:, 0] + high[:, 0]) + side * pace * (np.arange(len(pixels)) - passing)
    bottom = np.full(len(pixels), np.median(high[:, 1]) + 0.05 * tall)
    corners = np.stack([bottom - height, middle - 0.5 * width], axis=1).round().astype(np.int64)
    return Board(background(height, width, rng), corners)
