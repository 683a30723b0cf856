"""The image as layers: every pixel shows the nearest cell of the person that lies there, or else the scene. This judges
the same pixels for every pose, so that poses far apart can be compared: the points that `DenseAlignment` judges move
along, and limbs that hide behind others cost it nothing."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from workbench.body.camera import Camera
from workbench.body.kinematics import JointFrames
from workbench.body.limbs import Limbs
from workbench.body.simd_kinematics import inlined_exactly
from workbench.likelihoods.dense.surface_elements import ALONG, AROUND, Cells
from workbench.utils.arrays import BoolArray, Float32Array, FloatArray, IntArray
from workbench.utils.kernel_cache import kernel
from workbench.utils.parallel import parallel_for

ODD = 0.2
"""Share of a cell's pixels that show something else than the cell did before."""
_WIDER = 1.2  # so that the squares about a sphere's cells leave no gaps
_NEAREST_M, _LARGEST_PX = 0.05, 200.0  # of facets that are drawn
_LOGGED = 64  # likelihoods that are multiplied before a logarithm is taken: no product leaves what a number can be
_STEP = 2  # poses that a thread takes at once, at least

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

    @cached_property
    def table(self) -> tuple[FloatArray, IntArray, IntArray, IntArray]:
        """As kernels take them: the points (3, V); stretches (R, 3) of them on one joint, told by the first, the one
        after the last, and the joint; the corners; the cells."""
        firsts = np.flatnonzero(np.diff(self.joints, prepend=-1))
        lasts = np.flatnonzero(np.diff(self.joints, append=-1)) + 1
        stretches = np.column_stack([firsts, lasts, self.joints[firsts]])
        return np.ascontiguousarray(self.points.T), stretches, self.corners, self.cells


@dataclass(frozen=True, eq=False)
class LayerImage:
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
    _draw_all(*facets.table, frames.rotations[0], frames.positions[0], camera.row, cells, depths)
    return cells, depths


def log_ratios(behind: Layer, facets: Facets, frames: JointFrames, camera: Camera, shown: LayerImage) -> FloatArray:
    """By how much (N,) likelier an image is with facets in N poses, given by their joints' frames, among what is drawn
    already, `behind`, than without: the sum over the pixels on which they are the nearest."""
    found = np.zeros(len(frames.positions))
    placed = frames.rotations, frames.positions, camera.row
    before, values = np.zeros(behind[0].shape), _values(shown)
    judged: tuple[Any, ...] = (behind[0], *values, before)
    _judge(*judged)  # on one thread: others take as long to wake
    arguments: tuple[Any, ...] = (behind[1], *facets.table, *placed, *values, before, found)
    parallel_for(lambda first, last: _log_ratios(first, last, *arguments), len(found), _STEP)
    return found


def _values(shown: LayerImage) -> tuple[Any, ...]:
    """What is shown as the kernel takes it: of every cell its deviation and its density's peak, 0 for one not known."""
    sigma = shown.sigma * np.sqrt(1.0 + 1.0 / np.maximum(shown.n, 1e-300))
    peak = np.where(shown.n > 0.0, 256.0 / (np.sqrt(2.0 * np.pi) * sigma), 0.0)
    return shown.image, shown.ratio, shown.free, shown.texture, sigma, peak


@inlined_exactly
def _row(k: int, rotation: Any, position: Any, camera: Any) -> Any:
    """A row of the matrix that leads straight from a joint's frame to the camera's, and what is added there."""
    r0, r1, r2 = camera[3 * k], camera[3 * k + 1], camera[3 * k + 2]
    return (
        r0 * rotation[0, 0] + r1 * rotation[1, 0] + r2 * rotation[2, 0],
        r0 * rotation[0, 1] + r1 * rotation[1, 1] + r2 * rotation[2, 1],
        r0 * rotation[0, 2] + r1 * rotation[1, 2] + r2 * rotation[2, 2],
        r0 * position[0] + r1 * position[1] + r2 * position[2] + camera[9 + k],
    )


@inlined_exactly
def _place(points: Any, stretches: Any, rotations: Any, positions: Any, camera: Any, places: Any) -> None:
    """Write the pixels and depths (3, V) of points (3, V) in a pose. The innermost loop has no branch and reads no
    index, so that processors place several points together."""
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = camera[12:21]
    for first, last, joint in stretches:
        a0, a1, a2, a3 = _row(0, rotations[joint], positions[joint], camera)
        b0, b1, b2, b3 = _row(1, rotations[joint], positions[joint], camera)
        c0, c1, c2, c3 = _row(2, rotations[joint], positions[joint], camera)
        xs, ys, zs = points[0, first:last], points[1, first:last], points[2, first:last]
        us, vs, depths = places[0, first:last], places[1, first:last], places[2, first:last]
        for i in range(last - first):
            x, y, z = xs[i], ys[i], zs[i]
            depth = c0 * x + c1 * y + c2 * z + c3
            u = (a0 * x + a1 * y + a2 * z + a3) / depth
            v = (b0 * x + b1 * y + b2 * z + b3) / depth
            r2 = u * u + v * v
            radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
            us[i] = (u * radial + 2.0 * p1 * u * v + p2 * (r2 + 2.0 * u * u)) * fx + cx
            vs[i] = (v * radial + p1 * (r2 + 2.0 * v * v) + 2.0 * p2 * u * v) * fy + cy
            depths[i] = depth


@inlined_exactly
def _facing(corners: Any, places: Any, height: int, width: int, boxes: Any, depths: Any) -> int:
    """List the facets, corners (K, 4), that are to be drawn: none that faces away, is too near or too large, or lies
    between pixels. Write, of one after the other, its number, first and last column, first and last row (K, 5), and its
    mean depth (K,), and return how many there are."""
    n, (us, vs, zs) = 0, (places[0], places[1], places[2])
    for k in range(len(corners)):
        a, b, c, d = corners[k, 0], corners[k, 1], corners[k, 2], corners[k, 3]
        ax, ay, bx, by, cx, cy, dx, dy = us[a], vs[a], us[b], vs[b], us[c], vs[c], us[d], vs[d]
        area = (ax * by - bx * ay) + (bx * cy - cx * by) + (cx * dy - dx * cy) + (dx * ay - ax * dy)
        if not area < 0.0:
            continue
        x0, x1 = min(min(ax, bx), min(cx, dx)), max(max(ax, bx), max(cx, dx))
        y0, y1 = min(min(ay, by), min(cy, dy)), max(max(ay, by), max(cy, dy))
        drawable = min(min(zs[a], zs[b]), min(zs[c], zs[d])) > _NEAREST_M and max(x1 - x0, y1 - y0) < _LARGEST_PX
        if not (drawable and x1 >= 0.0 and x0 < width and y1 >= 0.0 and y0 < height):
            continue
        left, right = int(np.ceil(max(x0, 0.0))), int(np.floor(min(x1, width - 1.0)))
        top, bottom = int(np.ceil(max(y0, 0.0))), int(np.floor(min(y1, height - 1.0)))
        if left <= right and top <= bottom:
            boxes[n, 0], boxes[n, 1], boxes[n, 2], boxes[n, 3], boxes[n, 4] = k, left, right, top, bottom
            depths[n] = 0.25 * (zs[a] + zs[b] + zs[c] + zs[d])
            n += 1
    return n


@inlined_exactly
def _draw(
    corners: Any, places: Any, box: Any, depth: float, cell: int, top: int, left: int, cells: Any, depths: Any
) -> None:
    """Draw a facet, corners (4,), into the part of an image that begins at (top, left)."""
    ax, ay = places[0, corners[0]], places[1, corners[0]]
    bx, by = places[0, corners[1]], places[1, corners[1]]
    cx, cy = places[0, corners[2]], places[1, corners[2]]
    dx, dy = places[0, corners[3]], places[1, corners[3]]
    for y in range(box[3], box[4] + 1):
        for x in range(box[1], box[2] + 1):
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


@kernel(error_model="numpy")
def _draw_all(
    points: Any, stretches: Any, corners: Any, of: Any, rotations: Any, positions: Any, camera: Any, cells: Any,
    depths: Any,
) -> None:  # fmt: skip
    places, boxes, own = np.empty(points.shape), np.empty((len(of), 5), dtype=np.int64), np.empty(len(of))
    _place(points, stretches, rotations, positions, camera, places)
    for f in range(_facing(corners, places, cells.shape[0], cells.shape[1], boxes, own)):
        k = boxes[f, 0]
        _draw(corners[k], places, boxes[f], own[f], of[k], 0, 0, cells, depths)


@kernel(error_model="numpy")
def _log_ratios(
    first: int, last: int, behind_depths: Any, points: Any, stretches: Any, corners: Any, of: Any,
    rotations: Any, positions: Any, camera: Any, image: Any, ratio: Any, free: Any, texture: Any, sigma: Any, peak: Any,
    before: Any, found: Any,
) -> None:  # fmt: skip
    places, boxes, depths = np.empty(points.shape), np.empty((len(of), 5), dtype=np.int64), np.empty(len(of))
    for i in range(first, last):
        _place(points, stretches, rotations[i], positions[i], camera, places)
        drawn = _facing(corners, places, behind_depths.shape[0], behind_depths.shape[1], boxes, depths)
        if drawn == 0:
            continue
        left, right = boxes[:drawn, 1].min(), boxes[:drawn, 2].max()
        top, bottom = boxes[:drawn, 3].min(), boxes[:drawn, 4].max()
        nearest = np.full((bottom - top + 1, right - left + 1), -1, dtype=np.int64)
        near = behind_depths[top : bottom + 1, left : right + 1].copy()
        for f in range(drawn):
            k = boxes[f, 0]
            _draw(corners[k], places, boxes[f], depths[f], of[k], top, left, nearest, near)
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


@kernel(error_model="numpy")
def _judge(cells: Any, image: Any, ratio: Any, free: Any, texture: Any, sigma: Any, peak: Any, found: Any) -> None:
    """Write the log ratio of every pixel of a layer to the scene."""
    for y in range(cells.shape[0]):
        for x in range(cells.shape[1]):
            if cells[y, x] >= 0 and free[y, x]:
                found[y, x] = ratio[y, x] + np.log(_likelihood(cells[y, x], image[y, x], texture, sigma, peak))
