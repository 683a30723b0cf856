"""The image as layers: every pixel shows the nearest cell of the person that lies there, or else the scene. This judges
the same pixels for every pose, so that poses far apart can be compared: the points that `Alignment` judges move along,
and limbs that hide behind others cost it nothing."""

from dataclasses import dataclass
from typing import Any, TypeAlias

import numba
import numpy as np

from workbench.arrays import BoolArray, Float32Array, FloatArray, IntArray
from workbench.body.camera import Camera
from workbench.body.kinematics import JointFrames
from workbench.body.lanes import inlined_exactly
from workbench.body.limbs import Limbs
from workbench.likelihoods.alignment.cells import ALONG, AROUND, Cells
from workbench.likelihoods.image_motion.kernel import camera_row
from workbench.threads import over_threads

ODD = 0.2
"""Share of a cell's pixels that show something else than the cell did before."""
_WIDER = 1.2  # so that the squares about a sphere's cells leave no gaps
_NEAREST_M, _LARGEST_PX = 0.05, 200.0  # of facets that are drawn
_STEP = 8  # poses that a thread takes at once

Layer: TypeAlias = tuple[IntArray, FloatArray]
"""(height, width) of cells, −1 where there is none, and of their depths, m."""


@dataclass(frozen=True, eq=False)
class Facets:
    """K quadrangles that cover the limbs, one for a cell. corners: (K, 4, 3) in their joints' frames, m, once around as
    seen from outside. cells, joints: (K,)."""

    corners: FloatArray
    cells: IntArray
    joints: IntArray

    def on(self, joints: BoolArray) -> "Facets":
        """Those that hang on some of the joints (J,)."""
        own = joints[self.joints]
        return Facets(self.corners[own], self.cells[own], self.joints[own])


@dataclass(frozen=True, eq=False)
class Shown:
    """What one camera shows and what is known of it. image: (height, width) grey levels, a little smoothed. ratio: log
    ratio of a person of any grey level to the scene. free: where nothing passes. texture, n: (S,) the cells' levels and
    how many frames they stand for. sigma: grey levels."""

    image: Float32Array
    ratio: Float32Array
    free: BoolArray
    texture: FloatArray
    n: FloatArray
    sigma: float


def surface_facets(limbs: Limbs, cells: Cells) -> Facets:
    """Cover the cells of the limbs' surfaces; those of a sphere by squares, which overlap."""
    parts = [_squares(limbs, k, cells) if limbs.spheres[k] else _mantle(limbs, k) for k in range(len(limbs))]
    return Facets(np.concatenate(parts), np.arange(len(cells.joints)), cells.joints)


def _mantle(limbs: Limbs, k: int) -> FloatArray:
    u, angle = np.arange(ALONG + 1) / ALONG, 2.0 * np.pi * np.arange(AROUND + 1) / AROUND
    u, angle = (each[..., None] for each in np.meshgrid(u, angle, indexing="ij"))
    radii = limbs.radii[k, 0] + (limbs.radii[k, 1] - limbs.radii[k, 0]) * u
    circle = np.concatenate([np.cos(angle), np.sin(angle)], axis=-1)
    grid = limbs.starts[k] + (limbs.ends[k] - limbs.starts[k]) * u + (circle * radii) @ limbs.axes[k][:, :2].T
    return np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], axis=2).reshape(-1, 4, 3)


def _squares(limbs: Limbs, k: int, cells: Cells) -> FloatArray:
    own = cells.limbs == k
    centres, normals = cells.points[own], cells.normals[own]
    side = np.cross(normals, [0.3, 0.5, 0.8])  # any direction; a cell that faces just there has a square of no size
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-9)
    half = _WIDER * np.sqrt(np.pi / own.sum()) * limbs.radii[k, 0, 0]
    a, b = half * side, half * np.cross(normals, side)
    return np.stack([centres - a - b, centres + a - b, centres + a + b, centres - a + b], axis=1)


def drawn(facets: Facets, frames: JointFrames, camera: Camera, shape: tuple[int, int]) -> Layer:
    """Draw facets in the first of some poses, given by its joints' frames, nearer ones before farther ones."""
    cells, depths = np.full(shape, -1, dtype=np.int64), np.full(shape, np.inf)
    _draw_all(*_table(facets), frames.rotations[0], frames.positions[0], camera_row(camera), cells, depths)
    return cells, depths


def log_ratios(behind: Layer, facets: Facets, frames: JointFrames, camera: Camera, shown: Shown) -> FloatArray:
    """By how much (N,) likelier an image is with facets in N poses, given by their joints' frames, among what is drawn
    already, `behind`, than without: the sum over the pixels on which they are the nearest."""
    found = np.zeros(len(frames.positions))
    placed = frames.rotations, frames.positions, camera_row(camera)
    arguments: tuple[Any, ...] = (*behind, *_table(facets), *placed, *_values(shown), found)
    over_threads(lambda first, last: _log_ratios(first, last, *arguments), len(found), _STEP)
    return found


def drawn_reference(facets: Facets, frames: JointFrames, camera: Camera, behind: Layer) -> Layer:
    """Draw facets among what is drawn already in plain NumPy, pixel by pixel."""
    cells, depths = behind[0].copy(), behind[1].copy()
    turned, origins = frames.rotations[0][facets.joints], frames.positions[0][facets.joints]
    seen = camera.to_camera(np.einsum("kij,kcj->kci", turned, facets.corners) + origins[:, None])
    y, x = np.mgrid[: cells.shape[0], : cells.shape[1]]
    for corners, cell, z in zip(camera.pixels(seen, 1e-6), facets.cells, seen[..., 2], strict=True):
        following = np.roll(corners, -1, axis=0)
        size = np.ptp(corners, axis=0).max()
        area = (corners[:, 0] * following[:, 1] - following[:, 0] * corners[:, 1]).sum()
        if not (z.min() > _NEAREST_M and area < 0.0 and size < _LARGEST_PX):
            continue
        (ax, ay), (bx, by) = corners.T[:, :, None, None], following.T[:, :, None, None]
        inside = ((bx - ax) * (y - ay) - (by - ay) * (x - ax) <= 0.0).all(axis=0) & (z.mean() < depths)
        cells[inside], depths[inside] = cell, z.mean()
    return cells, depths


def log_ratio_reference(layer: Layer, shown: Shown) -> float:
    """By how much likelier an image is with a layer than with the scene alone, in plain NumPy."""
    cells = layer[0]
    there, known = shown.free & (cells >= 0), shown.free & (cells >= 0) & (shown.n[cells] > 0.0)
    sigma = shown.sigma * np.sqrt(1.0 + 1.0 / shown.n[cells[known]])
    misses = (shown.image[known] - shown.texture[cells[known]]) / sigma
    normal = 256.0 / (np.sqrt(2.0 * np.pi) * sigma) * np.exp(-0.5 * misses**2)
    return float(shown.ratio[there].sum() + np.log(ODD + (1.0 - ODD) * normal).sum())


def _table(facets: Facets) -> tuple[FloatArray, IntArray, IntArray]:
    return facets.corners, facets.cells, facets.joints


def _values(shown: Shown) -> tuple[Any, ...]:
    return shown.image, shown.ratio, shown.free, shown.texture, shown.n, shown.sigma


@inlined_exactly
def _corners(corners: Any, rotation: Any, position: Any, camera: Any, pixels: Any) -> float:
    """Write the pixels (4, 2) of a facet's corners (4, 3) and return its mean depth, 0 where it is not to be drawn."""
    depth, nearest, area = 0.0, np.inf, 0.0
    for a in range(4):
        x, y, z = corners[a, 0], corners[a, 1], corners[a, 2]
        wx = rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z + position[0]
        wy = rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z + position[1]
        wz = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z + position[2]
        cz = camera[6] * wx + camera[7] * wy + camera[8] * wz + camera[11]
        u = (camera[0] * wx + camera[1] * wy + camera[2] * wz + camera[9]) / cz
        v = (camera[3] * wx + camera[4] * wy + camera[5] * wz + camera[10]) / cz
        depth, nearest, r2 = depth + 0.25 * cz, min(nearest, cz), u * u + v * v
        radial = 1.0 + r2 * (camera[16] + r2 * (camera[17] + r2 * camera[20]))
        bent_u = u * radial + 2.0 * camera[18] * u * v + camera[19] * (r2 + 2.0 * u * u)
        bent_v = v * radial + camera[18] * (r2 + 2.0 * v * v) + 2.0 * camera[19] * u * v
        pixels[a, 0], pixels[a, 1] = bent_u * camera[12] + camera[14], bent_v * camera[13] + camera[15]
    for a in range(4):
        b = (a + 1) % 4
        area += pixels[a, 0] * pixels[b, 1] - pixels[b, 0] * pixels[a, 1]
    wide = max(pixels[:, 0].max() - pixels[:, 0].min(), pixels[:, 1].max() - pixels[:, 1].min())
    return depth if nearest > _NEAREST_M and area < 0.0 and wide < _LARGEST_PX else 0.0


@inlined_exactly
def _draw(pixels: Any, depth: float, cell: int, top: int, left: int, cells: Any, depths: Any) -> None:
    """Draw a facet into the part of an image that begins at (top, left)."""
    height, width = cells.shape
    low, high = pixels[:, 1].min() - top, pixels[:, 1].max() - top
    first, last = pixels[:, 0].min() - left, pixels[:, 0].max() - left
    if not (high >= 0.0 and low <= height - 1.0 and last >= 0.0 and first <= width - 1.0):
        return
    for y in range(int(np.ceil(max(low, 0.0))), int(np.floor(min(high, height - 1.0))) + 1):
        for x in range(int(np.ceil(max(first, 0.0))), int(np.floor(min(last, width - 1.0))) + 1):
            inside = depth < depths[y, x]
            for a in range(4):
                if inside:
                    b = (a + 1) % 4
                    along_x, along_y = pixels[b, 0] - pixels[a, 0], pixels[b, 1] - pixels[a, 1]
                    inside = along_x * (y + top - pixels[a, 1]) - along_y * (x + left - pixels[a, 0]) <= 0.0
            if inside:
                cells[y, x], depths[y, x] = cell, depth


@inlined_exactly
def _ratio(cell: int, y: int, x: int, image: Any, ratio: Any, texture: Any, n: Any, sigma: float) -> float:
    """Log ratio of what a pixel shows with a cell there to without."""
    if cell < 0:
        return 0.0
    if not n[cell] > 0.0:
        return float(ratio[y, x])
    own = sigma * np.sqrt(1.0 + 1.0 / n[cell])
    miss = (image[y, x] - texture[cell]) / own
    normal = 256.0 / (np.sqrt(2.0 * np.pi) * own) * np.exp(-0.5 * miss * miss)
    return float(ratio[y, x]) + np.log(ODD + (1.0 - ODD) * normal)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _draw_all(
    corners: Any, of: Any, joints: Any, rotations: Any, positions: Any, camera: Any, cells: Any, depths: Any
) -> None:
    pixels = np.empty((4, 2))
    for k in range(len(of)):
        depth = _corners(corners[k], rotations[joints[k]], positions[joints[k]], camera, pixels)
        if depth > 0.0:
            _draw(pixels, depth, of[k], 0, 0, cells, depths)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _log_ratios(
    first: int, last: int, behind: Any, behind_depths: Any, corners: Any, of: Any, joints: Any, rotations: Any,
    positions: Any, camera: Any, image: Any, ratio: Any, free: Any, texture: Any, n: Any, sigma: float, found: Any,
) -> None:  # fmt: skip
    height, width = behind.shape
    pixels, depths = np.empty((len(of), 4, 2)), np.empty(len(of))
    for i in range(first, last):
        x0, x1, y0, y1 = np.inf, -np.inf, np.inf, -np.inf
        for k in range(len(of)):
            depths[k] = _corners(corners[k], rotations[i, joints[k]], positions[i, joints[k]], camera, pixels[k])
            if depths[k] > 0.0:
                x0, x1 = min(x0, pixels[k, :, 0].min()), max(x1, pixels[k, :, 0].max())
                y0, y1 = min(y0, pixels[k, :, 1].min()), max(y1, pixels[k, :, 1].max())
        if not (x1 >= 0.0 and x0 <= width - 1.0 and y1 >= 0.0 and y0 <= height - 1.0):
            continue
        left, right = int(np.floor(max(x0, 0.0))), int(np.ceil(min(x1, width - 1.0)))
        top, bottom = int(np.floor(max(y0, 0.0))), int(np.ceil(min(y1, height - 1.0)))
        nearest = np.full((bottom - top + 1, right - left + 1), -1, dtype=np.int64)
        near = behind_depths[top : bottom + 1, left : right + 1].copy()
        for k in range(len(of)):
            if depths[k] > 0.0:
                _draw(pixels[k], depths[k], of[k], top, left, nearest, near)
        total = 0.0
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                if nearest[y - top, x - left] >= 0 and free[y, x]:
                    total += _ratio(nearest[y - top, x - left], y, x, image, ratio, texture, n, sigma)
                    total -= _ratio(behind[y, x], y, x, image, ratio, texture, n, sigma)
        found[i] = total
