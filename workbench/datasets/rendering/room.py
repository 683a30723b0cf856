"""A textured wall and floor, seen alike by any camera: what stands still behind the person of a stereo pair."""

from dataclasses import dataclass

import cv2
import numpy as np

from workbench.body.camera import Camera
from workbench.datasets.rendering.render import background, camera_rays
from workbench.datasets.rendering.sequence import Take
from workbench.motion.synthetic.gait import ANKLE_HEIGHT
from workbench.utils.arrays import FloatArray

TEXEL_M = 0.01
WALL_BEHIND_M = 1.5  # how far behind the person's way the wall stands
_WALL_SIZE, _FLOOR_SIZE = (500, 1600), (1200, 1600)
_SAMPLES = 2


@dataclass(frozen=True, eq=False)
class Room:
    """An upright wall and a floor with pictures on them, one texel a centimetre. forward, right: (3,) level directions
    across and along the wall. origin: (3,), m, a point of the wall's foot. wall, floor: (rows, columns) grey levels,
    upwards and towards the camera from the wall's foot, about the origin."""

    forward: FloatArray
    right: FloatArray
    origin: FloatArray
    wall: FloatArray
    floor: FloatArray


def room(take: Take, camera: Camera, rng: np.random.Generator, clutter: float = 1.0) -> Room:
    """A floor under a person's feet and a wall behind their way that faces a level camera."""
    forward, right = camera.rotation[2], camera.rotation[0]
    roots = take.motion.poses[:, :3]
    behind = camera.to_camera(roots)[:, 2].max() + WALL_BEHIND_M
    origin = camera.position + behind * forward
    origin[2] = take.places[..., 2].min() - ANKLE_HEIGHT * take.motion.shape.calf
    wall, floor = (background(*size, rng, clutter) for size in (_WALL_SIZE, _FLOOR_SIZE))
    return Room(forward, right, origin, wall, floor)


def empty_view(room: Room, camera: Camera) -> FloatArray:
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
    columns = (along / TEXEL_M + 0.5 * picture.shape[1]).astype(np.float32)
    rows = (across / TEXEL_M).astype(np.float32)
    seen = cv2.remap(picture.astype(np.float32), columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    return np.asarray(seen, dtype=np.float64)
