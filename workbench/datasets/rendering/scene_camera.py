"""A camera placed so that it sees the whole of a motion."""

import warnings

import numpy as np

from workbench.body.camera import Camera, plain_camera
from workbench.body.skeleton import POSE_NAMES
from workbench.datasets.rendering.miscalibration import calibrated
from workbench.datasets.rendering.sequence import Scene, Take
from workbench.motion.pose_sequence import Motion
from workbench.utils.arrays import FloatArray

_MARGIN = 0.05  # part of the image's width and height that the automatic camera keeps free on every side


def automatic_camera(
    scene: Scene, motion: Motion, places: FloatArray, distance_m: float, name: str = "automatic"
) -> tuple[Camera, float]:
    """A level camera at the height of the belly that keeps all joints `places` (F, J, 3) in view, and its distance, m.
    It looks at the scene's view_deg to the motion's direction from distance_m to where the person is half-way through,
    or from further away where the whole motion would not fit into width × height. Distances obey u = f x / z for every
    joint of every frame: each asks for the camera to be so far away at least."""
    width, height, focal_px = scene.width, scene.height, scene.focal_px
    angle = _direction(motion) + np.radians(scene.view_deg)
    forward, right = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([np.sin(angle), -np.cos(angle), 0.0])
    middle = motion.poses[len(motion) // 2]
    sideways, depth = places @ right, places @ forward - middle[:3] @ forward
    centre = 0.5 * (sideways.min() + sideways.max())
    level = motion.poses[:, 2].mean() + 0.1 * standing_height(motion, places)
    thickness = motion.shape.head_radius
    half_width, half_height = np.array([width, height]) * (0.5 - _MARGIN)
    distance = max(
        distance_m,
        ((np.abs(sideways - centre) + thickness) * focal_px / half_width - depth).max(),
        ((np.abs(places[..., 2] - level) + thickness) * focal_px / half_height - depth).max(),
        1.0 - depth.min(),  # nobody comes nearer than a metre
    )
    target = centre * right + (middle[:3] @ forward) * forward + [0.0, 0.0, level]
    x, y, z = target - distance * forward
    return plain_camera(width, height, focal_px, (x, y, z), tuple(target), name=name), float(distance)


def take_camera(scene: Scene, take: Take, distance_m: float, name: str = "automatic") -> Camera:
    """The automatic camera of a take, with a warning where it has to be further away than distance_m."""
    camera, distance = automatic_camera(scene, take.motion, take.places, distance_m, name)
    if distance > 1.01 * distance_m:
        away = f"{distance:.1f} m away instead of {distance_m:g}"
        words = f"{scene.kind}: the camera is {away}, so that the whole motion fits into its image"
        warnings.warn(words, stacklevel=2)
    return camera


def told_camera(scene: Scene, take: Take, camera: Camera) -> Camera:
    """Tell what a tracker is told of the camera of a take, see `calibrated`."""
    off, middle = scene.departure, take.motion.poses[len(take.motion) // 2, :3]
    return calibrated(camera, middle, off["camera"], off["camera_deg"], scene.seed)


def standing_height(motion: Motion, places: FloatArray) -> float:
    """Tell how tall the person is, m, half-way through a motion whose joints are at `places` (F, J, 3)."""
    standing = places[len(motion) // 2, :, 2]
    return float(np.ptp(standing) + motion.shape.head_radius + motion.shape.calf_radii[1])


def _direction(motion: Motion) -> float:
    """The angle, rad, from the world's x to where the person gets, or faces where they stay within 10 cm."""
    way = motion.poses[-1, :2] - motion.poses[0, :2]
    if np.linalg.norm(way) < 0.1:
        return float(motion.poses[len(motion) // 2, POSE_NAMES.index("root_heading")])
    return float(np.arctan2(way[1], way[0]))
