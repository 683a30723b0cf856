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
from workbench.threads import over_threads

ODD = 0.2
"""Share of a cell's pixels that show something else than the cell did before."""
_WIDER = 1.2  # so that the squares about a sphere's cells leave no gaps
_NEAREST_M, _LARGEST_PX = 0.05, 200.0  # of facets that are drawn
_LOGGED = 64  # likelihoods that are multiplied before a logarithm is taken: no product leaves what a number can be
_STEP, _ROWS = 8, 32  # poses, and rows of an image, that a thread takes at once

Layer: TypeAlias = tuple[IntArray, FloatArray]
"""(height, width) of cells, −1 where there is none, and of their depths, m."""


@dataclass(frozen=True, eq=False)
class Facets:
    """K quadrangles that cover the limbs, one for a cell, with V corners in all. points: (V, 3), the corners in their
    joints' frames, m. joints: (V,). corners: (K, 4), once around as seen from outside. cells: (K,)."""

    points: FloatArray
    joints: IntArray
    corners: IntArray
    cells: IntArray

    def on(self, joints: BoolArray) -> "Facets":
        """Those that hang on some of the joints (J,)."""
        kept = joints[self.joints]
        renumbered, own = np.cumsum(kept) - 1, kept[self.corners[:, 0]]
        return Facets(self.points[kept], self.joints[kept], renumbered[self.corners[own]], self.cells[own])


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
    sizes = [len(points) for points, _ in parts]
    firsts = np.cumsum([0, *sizes[:-1]])
    corners = np.concatenate([own + first for (_, own), first in zip(parts, firsts, strict=True)])
    points = np.concatenate([points for points, _ in parts])
    return Facets(points, np.repeat(limbs.joints, sizes), corners, np.arange(len(cells.joints)))


def _mantle(limbs: Limbs, k: int) -> tuple[FloatArray, IntArray]:
    """Corners (V, 3) and facets (K, 4) of a cone's cells."""
    u, angle = np.arange(ALONG + 1) / ALONG, 2.0 * np.pi * np.arange(AROUND + 1) / AROUND
    u, angle = (each[..., None] for each in np.meshgrid(u, angle, indexing="ij"))
    radii = limbs.radii[k, 0] + (limbs.radii[k, 1] - limbs.radii[k, 0]) * u
    circle = np.concatenate([np.cos(angle), np.sin(angle)], axis=-1)
    grid = limbs.starts[k] + (limbs.ends[k] - limbs.starts[k]) * u + (circle * radii) @ limbs.axes[k][:, :2].T
    of = np.arange((ALONG + 1) * (AROUND + 1)).reshape(ALONG + 1, AROUND + 1)
    return grid.reshape(-1, 3), np.stack([of[:-1, :-1], of[:-1, 1:], of[1:, 1:], of[1:, :-1]], axis=2).reshape(-1, 4)


def _squares(limbs: Limbs, k: int, cells: Cells) -> tuple[FloatArray, IntArray]:
    """Corners (V, 3) and facets (K, 4) of a sphere's cells."""
    own = cells.limbs == k
    centres, normals = cells.points[own], cells.normals[own]
    side = np.cross(normals, [0.3, 0.5, 0.8])  # any direction; a cell that faces just there has a square of no size
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-9)
    half = _WIDER * np.sqrt(np.pi / own.sum()) * limbs.radii[k, 0, 0]
    a, b = half * side, half * np.cross(normals, side)
    points = np.stack([centres - a - b, centres + a - b, centres + a + b, centres - a + b], axis=1)
    return points.reshape(-1, 3), np.arange(4 * len(centres)).reshape(-1, 4)


def drawn(facets: Facets, frames: JointFrames, camera: Camera, shape: tuple[int, int]) -> Layer:
    """Draw facets in the first of some poses, given by its joints' frames, nearer ones before farther ones."""
    cells, depths = np.full(shape, -1, dtype=np.int64), np.full(shape, np.inf)
    _draw_all(*_table(facets), frames.rotations[0], frames.positions[0], camera.row, cells, depths)
    return cells, depths


def log_ratios(behind: Layer, facets: Facets, frames: JointFrames, camera: Camera, shown: Shown) -> FloatArray:
    """By how much (N,) likelier an image is with facets in N poses, given by their joints' frames, among what is drawn
    already, `behind`, than without: the sum over the pixels on which they are the nearest."""
    found = np.zeros(len(frames.positions))
    placed = frames.rotations, frames.positions, camera.row
    before, values = np.zeros(behind[0].shape), _values(shown)
    judged: tuple[Any, ...] = (behind[0], *values, before)
    over_threads(lambda first, last: _judge(first, last, *judged), len(before), _ROWS)
    arguments: tuple[Any, ...] = (behind[1], *_table(facets), *placed, *values, before, found)
    over_threads(lambda first, last: _log_ratios(first, last, *arguments), len(found), _STEP)
    return found


def drawn_reference(facets: Facets, frames: JointFrames, camera: Camera, behind: Layer) -> Layer:
    """Draw facets among what is drawn already in plain NumPy, pixel by pixel."""
    cells, depths = behind[0].copy(), behind[1].copy()
    turned, origins = frames.rotations[0][facets.joints], frames.positions[0][facets.joints]
    points = camera.to_camera(np.einsum("kij,kj->ki", turned, facets.points) + origins)
    seen = points[facets.corners]
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


def _table(facets: Facets) -> tuple[FloatArray, IntArray, IntArray, IntArray]:
    return facets.points, facets.joints, facets.corners, facets.cells


def _values(shown: Shown) -> tuple[Any, ...]:
    """What is shown as the kernel takes it: of every cell its deviation and its density's peak, 0 for one not known."""
    sigma = shown.sigma * np.sqrt(1.0 + 1.0 / np.maximum(shown.n, 1e-300))
    peak = np.where(shown.n > 0.0, 256.0 / (np.sqrt(2.0 * np.pi) * sigma), 0.0)
    return shown.image, shown.ratio, shown.free, shown.texture, sigma, peak


@inlined_exactly
def _place(points: Any, joints: Any, rotations: Any, positions: Any, camera: Any, places: Any) -> None:
    """Write the pixels and depths (V, 3) of corners (V, 3) in a pose."""
    turns = np.empty((rotations.shape[0], 3, 4))  # from every joint straight to the camera
    for j in range(rotations.shape[0]):
        for a in range(3):
            r0, r1, r2 = camera[3 * a], camera[3 * a + 1], camera[3 * a + 2]
            for b in range(3):
                turns[j, a, b] = r0 * rotations[j, 0, b] + r1 * rotations[j, 1, b] + r2 * rotations[j, 2, b]
            place = r0 * positions[j, 0] + r1 * positions[j, 1] + r2 * positions[j, 2]
            turns[j, a, 3] = place + camera[9 + a]
    for k in range(points.shape[0]):
        x, y, z, turn = points[k, 0], points[k, 1], points[k, 2], turns[joints[k]]
        cz = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z + turn[2, 3]
        u = (turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z + turn[0, 3]) / cz
        v = (turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z + turn[1, 3]) / cz
        r2 = u * u + v * v
        radial = 1.0 + r2 * (camera[16] + r2 * (camera[17] + r2 * camera[20]))
        bent_u = u * radial + 2.0 * camera[18] * u * v + camera[19] * (r2 + 2.0 * u * u)
        bent_v = v * radial + camera[18] * (r2 + 2.0 * v * v) + 2.0 * camera[19] * u * v
        places[k, 0], places[k, 1], places[k, 2] = (
            bent_u * camera[12] + camera[14],
            bent_v * camera[13] + camera[15],
            cz,
        )


@inlined_exactly
def _box(corners: Any, places: Any, box: Any) -> float:
    """Write the pixels (4,) within which a facet (4,) lies, to the left, to the right, above and below, and return its
    mean depth, 0 where it is not to be drawn: it faces away, or is too near or too large."""
    ax, ay, az = places[corners[0], 0], places[corners[0], 1], places[corners[0], 2]
    bx, by, bz = places[corners[1], 0], places[corners[1], 1], places[corners[1], 2]
    cx, cy, cz = places[corners[2], 0], places[corners[2], 1], places[corners[2], 2]
    dx, dy, dz = places[corners[3], 0], places[corners[3], 1], places[corners[3], 2]
    area = (ax * by - bx * ay) + (bx * cy - cx * by) + (cx * dy - dx * cy) + (dx * ay - ax * dy)
    if not (area < 0.0 and min(min(az, bz), min(cz, dz)) > _NEAREST_M):
        return 0.0
    box[0], box[1] = min(min(ax, bx), min(cx, dx)), max(max(ax, bx), max(cx, dx))
    box[2], box[3] = min(min(ay, by), min(cy, dy)), max(max(ay, by), max(cy, dy))
    return 0.25 * (az + bz + cz + dz) if max(box[1] - box[0], box[3] - box[2]) < _LARGEST_PX else 0.0


@inlined_exactly
def _draw(
    corners: Any, places: Any, box: Any, depth: float, cell: int, top: int, left: int, cells: Any, depths: Any
) -> None:
    """Draw a facet into the part of an image that begins at (top, left)."""
    height, width = cells.shape
    if not (box[1] >= left and box[0] <= left + width - 1 and box[3] >= top and box[2] <= top + height - 1):
        return
    first, last = int(np.ceil(max(box[0], left))), int(np.floor(min(box[1], left + width - 1)))
    low, high = int(np.ceil(max(box[2], top))), int(np.floor(min(box[3], top + height - 1)))
    ax, ay = places[corners[0], 0], places[corners[0], 1]
    bx, by = places[corners[1], 0], places[corners[1], 1]
    cx, cy = places[corners[2], 0], places[corners[2], 1]
    dx, dy = places[corners[3], 0], places[corners[3], 1]
    for y in range(low, high + 1):
        for x in range(first, last + 1):
            if (
                depth < depths[y - top, x - left]
                and (bx - ax) * (y - ay) - (by - ay) * (x - ax) <= 0.0
                and (cx - bx) * (y - by) - (cy - by) * (x - bx) <= 0.0
                and (dx - cx) * (y - cy) - (dy - cy) * (x - cx) <= 0.0
                and (ax - dx) * (y - dy) - (ay - dy) * (x - dx) <= 0.0
            ):
                cells[y - top, x - left], depths[y - top, x - left] = cell, depth


@inlined_exactly
def _likelihood(cell: int, level: float, texture: Any, sigma: Any, peak: Any) -> float:
    """How much likelier a grey level is of a cell than of a person of any grey level; 1 of a cell that is not known."""
    if not peak[cell] > 0.0:
        return 1.0
    miss = (level - texture[cell]) / sigma[cell]
    return ODD + (1.0 - ODD) * (peak[cell] * np.exp(-0.5 * miss * miss))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _draw_all(
    points: Any, joints: Any, corners: Any, of: Any, rotations: Any, positions: Any, camera: Any, cells: Any,
    depths: Any,
) -> None:  # fmt: skip
    places, box = np.empty((len(points), 3)), np.empty(4)
    _place(points, joints, rotations, positions, camera, places)
    for k in range(len(of)):
        depth = _box(corners[k], places, box)
        if depth > 0.0:
            _draw(corners[k], places, box, depth, of[k], 0, 0, cells, depths)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _log_ratios(
    first: int, last: int, behind_depths: Any, points: Any, joints: Any, corners: Any, of: Any,
    rotations: Any, positions: Any, camera: Any, image: Any, ratio: Any, free: Any, texture: Any, sigma: Any, peak: Any,
    before: Any, found: Any,
) -> None:  # fmt: skip
    height, width = behind_depths.shape
    places, boxes, depths = np.empty((len(points), 3)), np.empty((len(of), 4)), np.empty(len(of))
    for i in range(first, last):
        _place(points, joints, rotations[i], positions[i], camera, places)
        x0, x1, y0, y1 = np.inf, -np.inf, np.inf, -np.inf
        for k in range(len(of)):
            depths[k] = _box(corners[k], places, boxes[k])
            if depths[k] > 0.0:
                x0, x1 = min(x0, boxes[k, 0]), max(x1, boxes[k, 1])
                y0, y1 = min(y0, boxes[k, 2]), max(y1, boxes[k, 3])
        if not (x1 >= 0.0 and x0 <= width - 1.0 and y1 >= 0.0 and y0 <= height - 1.0):
            continue
        left, right = int(np.floor(max(x0, 0.0))), int(np.ceil(min(x1, width - 1.0)))
        top, bottom = int(np.floor(max(y0, 0.0))), int(np.ceil(min(y1, height - 1.0)))
        nearest = np.full((bottom - top + 1, right - left + 1), -1, dtype=np.int64)
        near = behind_depths[top : bottom + 1, left : right + 1].copy()
        for k in range(len(of)):
            if depths[k] > 0.0:
                _draw(corners[k], places, boxes[k], depths[k], of[k], top, left, nearest, near)
        total, product, n = 0.0, 1.0, 0
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                cell = nearest[y - top, x - left]
                if cell >= 0 and free[y, x]:
                    total += ratio[y, x] - before[y, x]
                    product *= _likelihood(cell, image[y, x], texture, sigma, peak)
                    n += 1
                    if n % _LOGGED == 0:
                        total, product = total + np.log(product), 1.0
        found[i] = total + np.log(product)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _judge(
    first: int, last: int, cells: Any, image: Any, ratio: Any, free: Any, texture: Any, sigma: Any, peak: Any,
    found: Any,
) -> None:  # fmt: skip
    """Write the log ratio of every pixel of a layer to the scene."""
    for y in range(first, last):
        for x in range(cells.shape[1]):
            if cells[y, x] >= 0 and free[y, x]:
                found[y, x] = ratio[y, x] + np.log(_likelihood(cells[y, x], image[y, x], texture, sigma, peak))
