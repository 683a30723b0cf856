"""Surroundings of a person: floor, wall, bins and a bar in point clouds, a textured room, and a moving occluder."""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from workbench.body.limbs import Body, Limbs
from workbench.cameras.camera import Camera
from workbench.datasets.rendering.render import background, camera_rays
from workbench.datasets.rendering.sequence import RenderedSequence
from workbench.datasets.rendering.visible import first_depth, inside, surface_points
from workbench.motion.synthetic.gait import ANKLE_HEIGHT
from workbench.utils.arrays import FloatArray, IntArray

BOX_M = np.array([0.8, 0.8, 1.1])
"""Half sizes of the box around the root that contains clutter and outliers, as a tracker would crop them."""
WALL_M, _BINS_M = 0.65, 0.5  # distance of the wall and the bins behind the person's path
_BIN_RADIUS_M, _BIN_HEIGHT_M, _BAR_HEIGHT_M = 0.12, 0.7, 3.0
_CANDIDATES = 12
_TEXEL_M = 0.01
_WALL_BEHIND_M = 1.5  # distance of the room's wall behind the person's path
_WALL_SIZE, _FLOOR_SIZE = (500, 1600), (1200, 1600)
_SAMPLES = 2
OCCLUDER_WIDTH, OCCLUDER_HEIGHT = (0.15, 0.3), (0.5, 1.1)
"""Range of the occluder's size, as fractions of the person's height in the image."""
_OCCLUDER_SPEED = (0.03, 0.06)
"""Range of its speed relative to the person, in the same fractions per frame at 30 Hz."""
_OCCLUDER_PASSES = (0.35, 0.65)
"""Range of the time at which it is in front of the person's middle, as a fraction of the sequence."""
_OCCLUDER_RATE_HZ = 30.0


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Surroundings in point clouds. floor_m: height of the floor. wall_m: depth of a wall parallel to the image. bins:
    upright cylinders as a body."""

    floor_m: float
    wall_m: float
    bins: Body


def surroundings(sequence: RenderedSequence, camera: Camera) -> Surroundings:
    """Return a floor below the feet, a wall behind the path, and two bins in between."""
    roots = sequence.motion.poses[:, :3]
    floor = float(sequence.places[..., 2].min() - ANKLE_HEIGHT * sequence.motion.shape.calf)
    forward = camera.rotation[2]
    behind = roots[[len(roots) // 4, 3 * len(roots) // 4]] + _BINS_M * forward
    behind[:, 2] = floor
    wall = float(camera.to_camera(roots)[:, 2].max()) + WALL_M
    return Surroundings(floor, wall, _uprights(sequence.body, behind, _BIN_RADIUS_M, _BIN_HEIGHT_M))


def occluding_bar(sequence: RenderedSequence, camera: Camera, width_m: float) -> Body:
    """Return an upright bar half-way between the camera and the person's position half-way through the sequence."""
    foot = 0.5 * (camera.position + sequence.motion.poses[len(sequence.motion) // 2, :3])
    foot[2] -= 0.5 * _BAR_HEIGHT_M
    return _uprights(sequence.body, foot[None], 0.5 * width_m, _BAR_HEIGHT_M)


def _uprights(body: Body, feet: FloatArray, radius_m: float, height_m: float) -> Body:
    """Return upright cylinders with their feet (M, 3) fixed in the world, as limbs of a body whose pose is zero."""
    n = len(feet)
    limbs = Limbs(
        names=tuple(f"upright_{i}" for i in range(n)), joints=np.zeros(n, dtype=np.int64), starts=feet,
        ends=feet + np.array([0.0, 0.0, height_m]), radii=np.full((n, 2, 2), radius_m), spheres=np.zeros(n, dtype=bool),
    )  # fmt: skip
    return replace(body, limbs=limbs)


def in_box(centre: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
    """Return n points (n, 3), uniform in the box around a root at `centre` (3,)."""
    return centre + BOX_M * rng.uniform(-1.0, 1.0, (n, 3))


def clutter_points(
    surroundings: Surroundings, centre: FloatArray, camera: Camera, n: int, rng: np.random.Generator
) -> FloatArray:
    """Draw up to n points (n, 3), m, of floor, wall and bins in the box around `centre` that the bins do not occlude.

    Each of the three has equally many candidates, so that the small bins are represented.
    """
    n_candidates = _CANDIDATES * n
    floor, wall = in_box(centre, n_candidates, rng), in_box(centre, n_candidates, rng)
    floor[:, 2] = surroundings.floor_m
    wall += np.outer(surroundings.wall_m - camera.to_camera(wall)[:, 2], camera.rotation[2])
    standing = np.zeros(len(surroundings.bins.skeleton.dof_names))
    bins = surface_points(surroundings.bins, standing, n_candidates, rng)
    points = rng.permutation(np.concatenate([floor, wall, bins]))
    points = points[(np.abs(points - centre) <= BOX_M).all(axis=1) & inside(camera, points)]
    points = points[points[:, 2] >= surroundings.floor_m - 1e-9]
    points = points[camera.to_camera(points)[:, 2] <= surroundings.wall_m + 1e-9]
    return unoccluded(points, camera, surroundings.bins, standing)[:n]


def unoccluded(points: FloatArray, camera: Camera, body: Body, pose: FloatArray) -> FloatArray:
    """Return those of points (K, 3) that a body in a pose (P,) does not occlude."""
    if not len(points):
        return points
    return points[first_depth(body, pose, camera, points) > camera.to_camera(points)[:, 2] - 1e-3]


@dataclass(frozen=True, eq=False)
class _SceneRoom:
    """A textured upright wall and floor, one texel per centimetre.

    Parameters
    ----------
    forward, right : (3,) horizontal directions across and along the wall.
    origin : (3,), m, a point of the wall's foot.
    wall, floor : (rows, columns) grey levels, upwards and towards the camera from the wall's foot, centred at origin.
    """

    forward: FloatArray
    right: FloatArray
    origin: FloatArray
    wall: FloatArray
    floor: FloatArray


def room(sequence: RenderedSequence, camera: Camera, rng: np.random.Generator, clutter: float = 1.0) -> _SceneRoom:
    """Return a textured floor below the feet, and a wall behind the path that faces a level camera."""
    forward, right = camera.rotation[2], camera.rotation[0]
    roots = sequence.motion.poses[:, :3]
    behind = camera.to_camera(roots)[:, 2].max() + _WALL_BEHIND_M
    origin = camera.position + behind * forward
    origin[2] = sequence.places[..., 2].min() - ANKLE_HEIGHT * sequence.motion.shape.calf
    wall, floor = (background(*size, rng, clutter) for size in (_WALL_SIZE, _FLOOR_SIZE))
    return _SceneRoom(forward, right, origin, wall, floor)


def empty_view(room: _SceneRoom, camera: Camera) -> FloatArray:
    """Render the room for a camera before the wall and above the floor, (height, width) grey levels without noise;
    beyond their edges the textures are mirrored."""
    directions = camera_rays(camera, _SAMPLES).directions
    rays = np.concatenate([directions, np.ones((*directions.shape[:2], 1))], axis=2) @ camera.rotation
    centre = camera.position - room.origin
    with np.errstate(divide="ignore"):
        to_floor = np.where(rays[..., 2] < 0.0, -centre[2] / rays[..., 2], np.inf)
        to_wall = -(centre @ room.forward) / (rays @ room.forward)
    on_floor = to_floor < to_wall
    at = centre + np.minimum(to_floor, to_wall)[..., None] * rays
    along, up, out = at @ room.right, at[..., 2], -(at @ room.forward)
    values = np.where(on_floor, _texels(room.floor, along, out), _texels(room.wall, along, up))
    return values.reshape(camera.height, _SAMPLES, camera.width, _SAMPLES).mean(axis=(1, 3))


def _texels(texture: FloatArray, along: FloatArray, across: FloatArray) -> FloatArray:
    """Return grey levels of a texture at metres along and across from the middle of its first row."""
    columns = (along / _TEXEL_M + 0.5 * texture.shape[1]).astype(np.float32)
    rows = (across / _TEXEL_M).astype(np.float32)
    values = cv2.remap(texture.astype(np.float32), columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    return np.asarray(values, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Occluder:
    """An upright textured rectangle. texture: (h, w) grey levels. corners: (F, 2), whole px, row and column of its
    upper left corner in each frame, possibly outside the image."""

    texture: FloatArray
    corners: IntArray

    def cover(self, image: FloatArray, frame: int) -> FloatArray:
        """Return the image (height, width) of a frame with the occluder drawn over it."""
        top, left = self.corners[frame]
        height, width = self.texture.shape
        rows = np.arange(max(top, 0), min(top + height, image.shape[0]))
        columns = np.arange(max(left, 0), min(left + width, image.shape[1]))
        covered = image.copy()
        covered[np.ix_(rows, columns)] = self.texture[np.ix_(rows - top, columns - left)]
        return covered


def passing_occluder(pixels: FloatArray, rate_hz: float, rng: np.random.Generator) -> Occluder:
    """Draw an occluder that passes once in front of a person with joints at pixels (F, J, 2), from either side.

    Its speed relative to the person is constant, so that it passes a person walking in either direction. It extends
    upwards from below the feet, and may or may not occlude the head.
    """
    low, high = pixels.min(axis=1), pixels.max(axis=1)
    tall = float(np.median(high[:, 1] - low[:, 1]))
    width, height = (max(1, round(tall * rng.uniform(*span))) for span in (OCCLUDER_WIDTH, OCCLUDER_HEIGHT))
    side, speed = rng.choice([-1.0, 1.0]), tall * rng.uniform(*_OCCLUDER_SPEED) * _OCCLUDER_RATE_HZ / rate_hz
    passing = rng.uniform(*_OCCLUDER_PASSES) * (len(pixels) - 1)
    middle = 0.5 * (low[:, 0] + high[:, 0]) + side * speed * (np.arange(len(pixels)) - passing)
    bottom = np.full(len(pixels), np.median(high[:, 1]) + 0.05 * tall)
    corners = np.stack([bottom - height, middle - 0.5 * width], axis=1).round().astype(np.int64)
    return Occluder(background(height, width, rng), corners)
