"""Things beside the person that a camera sees points of: a floor, a wall and bins about a person, a bar before them."""

from dataclasses import dataclass, replace

import numpy as np

from workbench.body.camera import Camera
from workbench.body.limbs import Body, Limbs
from workbench.datasets.rendering.sequence import Take
from workbench.datasets.rendering.visible import first_depth, inside, surface_points
from workbench.motion.synthetic.gait import ANKLE_HEIGHT
from workbench.utils.arrays import FloatArray

BOX_M = np.array([0.8, 0.8, 1.1])
"""Half sizes of the box about the root in which clutter and outliers are kept, as a tracker would."""
WALL_M, BINS_M = 0.65, 0.5  # how far behind the person's way the wall and the bins are
_BIN_RADIUS_M, _BIN_HEIGHT_M, _BAR_HEIGHT_M = 0.12, 0.7, 3.0
_CANDIDATES = 12


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
    behind = roots[[len(roots) // 4, 3 * len(roots) // 4]] + BINS_M * forward
    behind[:, 2] = floor
    wall = float(camera.to_camera(roots)[:, 2].max()) + WALL_M
    return Surroundings(floor, wall, uprights(take.body, behind, _BIN_RADIUS_M, _BIN_HEIGHT_M))


def bar(take: Take, camera: Camera, width_m: float) -> Body:
    """An upright bar of that width half-way between the camera and where the person is half-way through."""
    foot = 0.5 * (camera.position + take.motion.poses[len(take.motion) // 2, :3])
    foot[2] -= 0.5 * _BAR_HEIGHT_M
    return uprights(take.body, foot[None], 0.5 * width_m, _BAR_HEIGHT_M)


def uprights(body: Body, feet: FloatArray, radius_m: float, height_m: float) -> Body:
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
