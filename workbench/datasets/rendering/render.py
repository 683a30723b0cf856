"""Ray casting of a body in a pose over a cluttered background.

Limbs are the elliptical truncated cones and spheres of `workbench.body.limbs`, not the planar patches of likelihoods:
images and likelihoods have only the body's geometry in common. Open ends are capped with half an ellipsoid, so that
joints have no holes.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import cv2
import numpy as np
import scipy

from workbench.body.kinematics import forward
from workbench.body.limbs import Body
from workbench.body.skeleton import without_side
from workbench.cameras.camera import Camera
from workbench.utils.arrays import ByteArray, Float32Array, FloatArray, IntArray
from workbench.utils.kernel_cache import kernel

TEXTURE_GREY = 24.0  # standard deviation of the clothes' texture at contrast 1, grey levels before shading
CLUTTER_GREY = 35.0  # standard deviation of the background at clutter 1, grey levels
_AMBIENT = 0.6
_LIGHT = np.array([0.25, -0.45, 0.86]) / np.linalg.norm([0.25, -0.45, 0.86])  # towards the light, in the world
_NEAR_M = 0.02
_RATIO_TOLERANCE = 1e-9  # of the ratio of semi-axes along a limb, for rounding
VOXEL_M = 0.0125
_SHIRT, _TROUSERS = ("torso", "upper_arm"), ("thigh", "calf", "foot")


@dataclass(frozen=True, eq=False)
class Rays:
    """A camera's rays, `samples` × `samples` per pixel, in its own frame. directions: (height · samples, width ·
    samples, 2), (x, y) at depth 1, without lens distortion."""

    samples: int
    directions: Float32Array

    @cached_property
    def across(self) -> Float32Array:
        """The smallest and the largest x of every column, (2, width · samples)."""
        return np.stack([self.directions[..., 0].min(axis=0), self.directions[..., 0].max(axis=0)])

    @cached_property
    def down(self) -> Float32Array:
        """The smallest and the largest y of every row, (2, height · samples)."""
        return np.stack([self.directions[..., 1].min(axis=1), self.directions[..., 1].max(axis=1)])


@dataclass(frozen=True, eq=False)
class Hits:
    """Intersections of rays with a body. Outside the rectangle of rays with its corner at (top, left) there are none.

    depth: (h, w) along the camera's axis, m, inf for none. limb: (h, w) index of the body's limb, -1 for none.
    """

    top: int
    left: int
    depth: FloatArray
    limb: IntArray


@dataclass(frozen=True, eq=False)
class Texture:
    """One person's clothes, fixed to the limbs: a noise volume, evaluated at the limbs' surfaces.

    Parameters
    ----------
    volume : (n, n, n) periodic band-limited noise of unit variance, in voxels of 12.5 mm.
    offsets : (L, 3) position of each limb in the volume, voxels.
    grey : (L,) mean grey levels of the limbs.
    contrast : grey levels per unit of noise.
    """

    volume: Float32Array
    offsets: FloatArray
    grey: FloatArray
    contrast: float


@dataclass(frozen=True, eq=False)
class RenderedScene:
    """The constant part of a scene. background: (height, width) grey levels."""

    body: Body
    camera: Camera
    texture: Texture
    background: FloatArray

    @property
    def rays(self) -> Rays:
        """The camera's rays."""
        return camera_rays(self.camera)


@dataclass(frozen=True, eq=False)
class _PlacedLimbs:
    """Limbs in relation to a camera. A limb's frame has its origin at the axis' start, and z along the axis.

    Parameters
    ----------
    rotations : (L, 3, 3) camera to limb.
    centres : (L, 3) the camera's centre in the limb's frame, m.
    sizes : (L, 5) length of the axis and semi-axes x, y at its start, x, y at its end, m.
    """

    rotations: FloatArray
    centres: FloatArray
    sizes: FloatArray


@lru_cache(maxsize=2)
def camera_rays(camera: Camera, samples: int = 2) -> Rays:
    """Return the camera's rays, `samples` × `samples` on a regular grid in every pixel.

    Those of the last two cameras are cached, because they take longer to compute than an image.
    """
    u, v = ((np.arange(size * samples) + 0.5) / samples - 0.5 for size in (camera.width, camera.height))
    if camera.distortion.any():
        directions = camera.undistorted(np.stack(np.meshgrid(u, v), axis=-1))
    else:
        x = (u - camera.matrix[0, 2]) / camera.matrix[0, 0]
        y = (v - camera.matrix[1, 2]) / camera.matrix[1, 1]
        directions = np.stack(np.meshgrid(x, y), axis=-1)
    return Rays(samples, np.ascontiguousarray(directions, dtype=np.float32))


def clothes(body: Body, rng: np.random.Generator, contrast: float = 1.0) -> Texture:
    """Draw a random outfit: uniform shirt, trousers and skin, each with noise of wavelengths of about 5 to 25 cm."""
    n = 64
    frequency = np.stack(np.meshgrid(*[np.fft.fftfreq(n, VOXEL_M)] * 2, np.fft.rfftfreq(n, VOXEL_M), indexing="ij"))
    octaves = np.log2(np.maximum(np.linalg.norm(frequency, axis=0), 1e-9) * 0.11)
    spectrum = np.fft.rfftn(rng.standard_normal((n, n, n))) * np.exp(-((octaves / 0.8) ** 2))
    volume = np.fft.irfftn(spectrum, s=(n, n, n), axes=(0, 1, 2))
    shirt, trousers, skin = rng.uniform(80, 190), rng.uniform(50, 130), rng.uniform(150, 200)
    names = [without_side(name) for name in body.limbs.names]
    return Texture(
        volume=(volume / volume.std()).astype(np.float32),
        offsets=rng.uniform(0.0, n, (len(names), 3)),
        grey=np.array([shirt if name in _SHIRT else trousers if name in _TROUSERS else skin for name in names]),
        contrast=contrast * TEXTURE_GREY,
    )


def background(height: int, width: int, rng: np.random.Generator, clutter: float = 1.0) -> FloatArray:
    """Draw a cluttered wall, (height, width) grey levels: noise at five scales, and rectangles with sharp edges."""
    wall: FloatArray = np.zeros((height, width))
    for octave in range(2, 7):
        coarse = rng.standard_normal((height // 2**octave + 2, width // 2**octave + 2))
        wall += (0.5 + 0.1 * octave) * cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    for _ in range(90):
        centre, size = rng.uniform((0, 0), (width, height)), rng.uniform(0.01, 0.15, 2) * width
        angle = rng.choice([0.0, 0.0, 0.0, rng.uniform(0.0, 90.0)])
        corners = cv2.boxPoints((tuple(centre), tuple(size), angle)).astype(np.int32)
        mask = cv2.fillPoly(np.zeros((height, width), np.uint8), [corners], 1).astype(bool)
        wall[mask] = 0.3 * wall[mask] + rng.normal(0.0, 2.0)
    wall = (wall - wall.mean()) / wall.std()
    return np.clip(125.0 + clutter * CLUTTER_GREY * wall, 0.0, 255.0)


def render(scene: RenderedScene, pose: FloatArray) -> FloatArray:
    """Return the noiseless image (height, width), grey levels 0 to 255, of the body in a pose (P,)."""
    placed = _place(scene.body, pose, scene.camera)
    hits, n, image = _cast_placed(placed, scene.rays), scene.rays.samples, scene.background.copy()
    height, width = hits.depth.shape[0] // n, hits.depth.shape[1] // n
    window = image[hits.top // n :, hits.left // n :][:height, :width]
    fine = np.repeat(np.repeat(window, n, axis=0), n, axis=1)
    hit = hits.limb >= 0
    fine[hit] = _shade(scene, placed, hits, hit)
    window[:] = fine.reshape(height, n, width, n).mean(axis=(1, 3))
    return image


def with_noise(image: FloatArray, sigma: float, rng: np.random.Generator) -> ByteArray:
    """Return an image with Gaussian sensor noise of `sigma` grey levels, rounded and clipped to 8 bits."""
    noisy = image + sigma * rng.standard_normal(image.shape, dtype=np.float32)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def cast(body: Body, pose: FloatArray, camera: Camera, rays: Rays) -> Hits:
    """Return depth and limb of the intersections of the camera's rays with the body in a pose (P,)."""
    return _cast_placed(_place(body, pose, camera), rays)


def _place(body: Body, pose: FloatArray, camera: Camera) -> _PlacedLimbs:
    limbs = body.limbs
    frames = forward(body.skeleton, pose[None])
    from_joint, at = frames.rotations[0, limbs.joints], frames.positions[0, limbs.joints]
    to_limb = limbs.axes.transpose(0, 2, 1) @ from_joint.transpose(0, 2, 1)
    starts = at + np.einsum("lij,lj->li", from_joint, limbs.starts)
    return _PlacedLimbs(
        rotations=np.ascontiguousarray(to_limb @ camera.rotation.T),
        centres=np.einsum("lij,lj->li", to_limb, camera.position - starts),
        sizes=np.column_stack([limbs.lengths, limbs.radii.reshape(-1, 4)]),
    )


def _cast_placed(placed: _PlacedLimbs, rays: Rays) -> Hits:
    boxes = np.array([_box(placed, k, rays) for k in range(len(placed.sizes))])
    used = boxes[boxes[:, 1] > boxes[:, 0]]
    if len(used) == 0:
        return Hits(0, 0, np.empty((0, 0)), np.empty((0, 0), dtype=np.int64))
    n = rays.samples  # the rectangle holds whole pixels
    top, left = used[:, 0].min() // n * n, used[:, 2].min() // n * n
    bottom, right = -(-used[:, 1].max() // n) * n, -(-used[:, 3].max() // n) * n
    depth = np.full((bottom - top, right - left), np.inf)
    limb = np.full(depth.shape, -1)
    _cast(rays.directions, placed.rotations, placed.centres, placed.sizes, boxes, top, left, depth, limb)
    return Hits(int(top), int(left), depth, limb)


def _box(placed: _PlacedLimbs, k: int, rays: Rays) -> tuple[int, int, int, int]:
    """Return rows and columns (from, to, from, to) of the rays through a cube at each end of limb k."""
    from_limb = placed.rotations[k].T
    length, *radii = placed.sizes[k]
    ends = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, length]]) - placed.centres[k]
    cube = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), axis=-1).reshape(8, 3)
    half_sides = np.array([max(radii[:2]), max(radii[2:])])
    corners = ((ends @ from_limb.T)[:, None] + half_sides[:, None, None] * cube).reshape(16, 3)
    if corners[:, 2].max() <= _NEAR_M:
        return 0, 0, 0, 0
    if corners[:, 2].min() <= _NEAR_M:
        return 0, rays.directions.shape[0], 0, rays.directions.shape[1]
    projected = corners[:, :2] / corners[:, 2:]
    low, high = projected.min(axis=0), projected.max(axis=0)
    columns = np.flatnonzero((rays.across[1] >= low[0]) & (rays.across[0] <= high[0]))
    rows = np.flatnonzero((rays.down[1] >= low[1]) & (rays.down[0] <= high[1]))
    if len(rows) == 0 or len(columns) == 0:
        return 0, 0, 0, 0
    return int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1


def _shade(scene: RenderedScene, placed: _PlacedLimbs, hits: Hits, hit: Any) -> FloatArray:
    """Return grey levels of the rays in the mask `hit` (h, w): texture times Lambert's law with ambient light."""
    rows, columns = np.nonzero(hit)
    limb, depth = hits.limb[rows, columns], hits.depth[rows, columns]
    direction = scene.rays.directions[rows + hits.top, columns + hits.left]
    towards = np.column_stack([direction, np.ones(len(direction))]) * depth[:, None]
    grey, light, texture = np.empty(len(limb)), scene.camera.rotation @ _LIGHT, scene.texture
    for k in np.unique(limb):
        of_limb = np.flatnonzero(limb == k)
        points = placed.centres[k] + towards[of_limb] @ placed.rotations[k].T
        voxels = (points / VOXEL_M + texture.offsets[k]).T
        pattern = scipy.ndimage.map_coordinates(texture.volume, voxels, order=1, mode="grid-wrap")
        lit = np.maximum(_normals(points, placed.sizes[k]) @ (placed.rotations[k] @ light), 0.0)
        grey[of_limb] = (texture.grey[k] + texture.contrast * pattern) * (_AMBIENT + (1.0 - _AMBIENT) * lit)
    return np.clip(grey, 0.0, 255.0)


def _normals(points: FloatArray, size: FloatArray) -> FloatArray:
    """Return unit normals (M, 3) of one limb's surface at points (M, 3) on it, in its frame."""
    length, ax, ay, bx, by = size
    on_side = (points[:, 2] >= 0.0) & (points[:, 2] <= length) & (length > 0.0)
    t = np.clip(points[:, 2] / length, 0.0, 1.0) if length > 0.0 else np.zeros(len(points))
    rx, ry = ax + t * (bx - ax), ay + t * (by - ay)
    x, y, beyond = points[:, 0], points[:, 1], points[:, 2] - t * length
    slope = -(x**2 * (bx - ax) / rx**3 + y**2 * (by - ay) / ry**3) / (length if length > 0.0 else 1.0)
    z = np.where(on_side, slope, beyond / np.minimum(rx, ry) ** 2)
    normals = np.stack([x / rx**2, y / ry**2, z], axis=1)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


@kernel()
def _cast(
    directions: Any, rotations: Any, centres: Any, sizes: Any, boxes: Any, top: int, left: int, depth: Any, limb: Any
) -> None:
    for k in range(sizes.shape[0]):
        m, centre, size = rotations[k], centres[k], sizes[k]
        for row in range(boxes[k, 0], boxes[k, 1]):
            for column in range(boxes[k, 2], boxes[k, 3]):
                x, y = np.float64(directions[row, column, 0]), np.float64(directions[row, column, 1])
                dx = m[0, 0] * x + m[0, 1] * y + m[0, 2]
                dy = m[1, 0] * x + m[1, 1] * y + m[1, 2]
                dz = m[2, 0] * x + m[2, 1] * y + m[2, 2]
                s = _limb_depth(centre, dx, dy, dz, size)
                if s < depth[row - top, column - left]:
                    depth[row - top, column - left] = s
                    limb[row - top, column - left] = k


@kernel()
def _limb_depth(centre: Any, dx: float, dy: float, dz: float, size: Any) -> float:
    ox, oy, oz = centre[0], centre[1], centre[2]
    length, ax, ay, bx, by = size[0], size[1], size[2], size[3], size[4]
    depth = min(_cap_depth(ox, oy, oz, dx, dy, dz, ax, ay), _cap_depth(ox, oy, oz - length, dx, dy, dz, bx, by))
    if length == 0.0:
        return depth
    gx, gy = (bx - ax) / length, (by - ay) / length
    # With a constant ratio of the semi-axes, k = (rx / ry)², the surface is a quadric. Where the ratio varies, that at
    # the ray's nearest point to the axis, on a limb thicker by a tenth, starts Newton's method outside.
    t = min(max((oz - dz * (ox * dx + oy * dy) / (dx * dx + dy * dy)) / length, 0.0), 1.0)
    k = ((ax + t * (bx - ax)) / (ay + t * (by - ay))) ** 2
    exact = abs(ax * by - ay * bx) < _RATIO_TOLERANCE * ax * by
    scale = 1.0 if exact else 1.1
    r, g = scale * (ax + gx * oz), scale * gx
    a, b = dx * dx + k * dy * dy - (g * dz) ** 2, ox * dx + k * oy * dy - g * dz * r
    s = _entry(a, b, ox * ox + k * oy * oy - r * r)
    converged = exact or s == np.inf
    for _ in range(8):
        if converged:
            break
        x, y, t = ox + s * dx, oy + s * dy, min(max((oz + s * dz) / length, 0.0), 1.0)
        rx, ry = ax + t * (bx - ax), ay + t * (by - ay)
        f = (x / rx) ** 2 + (y / ry) ** 2 - 1.0
        rate = x * (dx - x * gx * dz / rx) / rx**2 + y * (dy - y * gy * dz / ry) / ry**2
        converged = abs(f) < 1e-7
        if not converged:
            if rate >= 0.0:  # beyond the point nearest to the axis: the ray misses
                return depth
            s -= 0.5 * f / rate
    z = oz + s * dz
    return min(s, depth) if converged and 0.0 <= z <= length else depth


@kernel()
def _cap_depth(ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, rx: float, ry: float) -> float:
    rz = min(rx, ry)
    ox, oy, oz, dx, dy, dz = ox / rx, oy / ry, oz / rz, dx / rx, dy / ry, dz / rz
    return _entry(dx * dx + dy * dy + dz * dz, ox * dx + oy * dy + oz * dz, ox * ox + oy * oy + oz * oz - 1.0)


@kernel()
def _entry(a: float, b: float, c: float) -> float:
    square = b * b - a * c
    if square < 0.0:
        return np.inf
    below = np.sqrt(square) - b
    return c / below if c * below > 0.0 else np.inf
