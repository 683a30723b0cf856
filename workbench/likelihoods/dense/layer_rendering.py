"""Layered rendering of the person: every pixel shows the nearest surface element, or the background.

All poses are compared at the same pixels, so that distant poses are comparable. The points of `DenseAlignment` move
with the pose, and it does not penalise limbs hidden by others.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from workbench.body.kinematics import JointFrames
from workbench.body.limbs import Limbs
from workbench.body.simd_kinematics import inlined_exactly
from workbench.cameras.camera import Camera
from workbench.likelihoods.dense.surface_elements import ALONG, AROUND, SurfaceElements
from workbench.utils.arrays import BoolArray, Float32Array, FloatArray, IntArray
from workbench.utils.kernel_cache import kernel
from workbench.utils.parallel import parallel_for

OUTLIER_FRACTION = 0.2
"""Fraction of an element's pixels that do not show its previous grey level."""
_OVERLAP = 1.2  # so that the squares of a sphere's elements leave no gaps
_NEAREST_M, _LARGEST_PX = 0.05, 200.0  # limits of rendered facets
_PRODUCT_LENGTH = 64  # likelihoods multiplied per logarithm, whose product cannot overflow or underflow
_MIN_POSES = 2  # minimum poses per thread

Layer: TypeAlias = tuple[IntArray, FloatArray]
"""(height, width) of surface elements, −1 where there is none, and of their depths, m."""


@dataclass(frozen=True, eq=False)
class Facets:
    """K quadrangles that cover the limbs, one per surface element, with V corners in all. points: (V, 3), the corners
    in their joints' frames, m. joints: (V,). corners: (K, 4), in order around the facet as seen from outside. elements:
    (K,)."""

    points: FloatArray
    joints: IntArray
    corners: IntArray
    elements: IntArray

    def on_joints(self, joints: BoolArray) -> "Facets":
        """Return the facets on some of the joints (J,)."""
        points = joints[self.joints]
        new_indices, facets = np.cumsum(points) - 1, points[self.corners[:, 0]]
        return Facets(
            self.points[points], self.joints[points], new_indices[self.corners[facets]], self.elements[facets]
        )

    @cached_property
    def table(self) -> tuple[FloatArray, IntArray, IntArray, IntArray]:
        """Arrays of the kernels: the points (3, V); runs (R, 3) of points on one joint: first index, index after the
        last, joint; the corners; the elements."""
        firsts = np.flatnonzero(np.diff(self.joints, prepend=-1))
        lasts = np.flatnonzero(np.diff(self.joints, append=-1)) + 1
        runs = np.column_stack([firsts, lasts, self.joints[firsts]])
        return np.ascontiguousarray(self.points.T), runs, self.corners, self.elements


@dataclass(frozen=True, eq=False)
class LayerImage:
    """One camera's image and model. image: (height, width) grey levels, slightly smoothed. ratio: log ratio of a person
    of uniformly distributed grey level to the background. unoccluded: pixels without an occluder. texture, n: (S,) the
    elements' levels and effective numbers of frames. sigma: grey levels."""

    image: Float32Array
    ratio: Float32Array
    unoccluded: BoolArray
    texture: FloatArray
    n: FloatArray
    sigma: float


def surface_facets(limbs: Limbs, elements: SurfaceElements) -> Facets:
    """Return the facets of the limbs' surface elements; those of a sphere are overlapping squares."""
    n, spheres = len(limbs), limbs.spheres
    parts = [_sphere_facets(limbs, k, elements) if spheres[k] else _cone_facets(limbs, k) for k in range(n)]
    sizes = [len(points) for points, _ in parts]
    firsts = np.cumsum([0, *sizes[:-1]])
    corners = np.concatenate([indices + first for (_, indices), first in zip(parts, firsts, strict=True)])
    points = np.concatenate([points for points, _ in parts])
    return Facets(points, np.repeat(limbs.joints, sizes), corners, np.arange(len(elements.joints)))


def _cone_facets(limbs: Limbs, k: int) -> tuple[FloatArray, IntArray]:
    """Return corners (V, 3) and facets (K, 4) of a cone's elements."""
    u, angle = np.arange(ALONG + 1) / ALONG, 2.0 * np.pi * np.arange(AROUND + 1) / AROUND
    u, angle = (each[..., None] for each in np.meshgrid(u, angle, indexing="ij"))
    radii = limbs.radii[k, 0] + (limbs.radii[k, 1] - limbs.radii[k, 0]) * u
    circle = np.concatenate([np.cos(angle), np.sin(angle)], axis=-1)
    grid = limbs.starts[k] + (limbs.ends[k] - limbs.starts[k]) * u + (circle * radii) @ limbs.axes[k][:, :2].T
    indices = np.arange((ALONG + 1) * (AROUND + 1)).reshape(ALONG + 1, AROUND + 1)
    corners = np.stack([indices[:-1, :-1], indices[:-1, 1:], indices[1:, 1:], indices[1:, :-1]], axis=2)
    return grid.reshape(-1, 3), corners.reshape(-1, 4)


def _sphere_facets(limbs: Limbs, k: int, elements: SurfaceElements) -> tuple[FloatArray, IntArray]:
    """Return corners (V, 3) and facets (K, 4) of a sphere's elements."""
    selected = elements.limbs == k
    centres, normals = elements.points[selected], elements.normals[selected]
    side = np.cross(normals, [0.3, 0.5, 0.8])  # arbitrary direction; an element facing it has an empty square
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-9)
    half = _OVERLAP * np.sqrt(np.pi / selected.sum()) * limbs.radii[k, 0, 0]
    a, b = half * side, half * np.cross(normals, side)
    points = np.stack([centres - a - b, centres + a - b, centres + a + b, centres - a + b], axis=1)
    return points.reshape(-1, 3), np.arange(4 * len(centres)).reshape(-1, 4)


def render_layer(facets: Facets, frames: JointFrames, camera: Camera, shape: tuple[int, int]) -> Layer:
    """Render facets in the first of some poses, given by its joints' frames, with nearer ones in front."""
    elements, depths = np.full(shape, -1, dtype=np.int64), np.full(shape, np.inf)
    _draw_all(*facets.table, frames.rotations[0], frames.positions[0], camera.row, elements, depths)
    return elements, depths


def layer_log_ratios(
    behind: Layer, facets: Facets, frames: JointFrames, camera: Camera, observed: LayerImage
) -> FloatArray:
    """Return log likelihood ratios (N,) of an image with and without facets in N poses, over the pixels on which they
    are nearest.

    Parameters
    ----------
    behind : the layer rendered without the facets.
    facets, frames, camera : the facets, the joints' frames in N poses and the camera.
    observed : the camera's image and model.
    """
    log_ratios = np.zeros(len(frames.positions))
    pose_arrays = frames.rotations, frames.positions, camera.row
    behind_log_ratios, values = np.zeros(behind[0].shape), _kernel_arguments(observed)
    behind_arguments: tuple[Any, ...] = (behind[0], *values, behind_log_ratios)
    _pixel_log_ratios(*behind_arguments)  # on one thread: starting others takes as long
    arguments: tuple[Any, ...] = (behind[1], *facets.table, *pose_arrays, *values, behind_log_ratios, log_ratios)
    parallel_for(lambda first, last: _log_ratios(first, last, *arguments), len(log_ratios), _MIN_POSES)
    return log_ratios


def _kernel_arguments(observed: LayerImage) -> tuple[Any, ...]:
    """Return the kernel's arguments: with every element's standard deviation and its density's peak, 0 for one without
    a level."""
    sigma = observed.sigma * np.sqrt(1.0 + 1.0 / np.maximum(observed.n, 1e-300))
    peak = np.where(observed.n > 0.0, 256.0 / (np.sqrt(2.0 * np.pi) * sigma), 0.0)
    return observed.image, observed.ratio, observed.unoccluded, observed.texture, sigma, peak


@inlined_exactly
def _row(k: int, rotation: Any, position: Any, camera: Any) -> Any:
    """Return a row of the matrix from a joint's frame to the camera's, and of the translation."""
    r0, r1, r2 = camera[3 * k], camera[3 * k + 1], camera[3 * k + 2]
    return (
        r0 * rotation[0, 0] + r1 * rotation[1, 0] + r2 * rotation[2, 0],
        r0 * rotation[0, 1] + r1 * rotation[1, 1] + r2 * rotation[2, 1],
        r0 * rotation[0, 2] + r1 * rotation[1, 2] + r2 * rotation[2, 2],
        r0 * position[0] + r1 * position[1] + r2 * position[2] + camera[9 + k],
    )


@inlined_exactly
def _project_points(points: Any, runs: Any, rotations: Any, positions: Any, camera: Any, projections: Any) -> None:
    """Write the pixels and depths (3, V) of points (3, V) in a pose. The innermost loop has no branch and reads no
    index, so that it is vectorised."""
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = camera[12:21]
    for first, last, joint in runs:
        a0, a1, a2, a3 = _row(0, rotations[joint], positions[joint], camera)
        b0, b1, b2, b3 = _row(1, rotations[joint], positions[joint], camera)
        c0, c1, c2, c3 = _row(2, rotations[joint], positions[joint], camera)
        xs, ys, zs = points[0, first:last], points[1, first:last], points[2, first:last]
        us, vs, depths = projections[0, first:last], projections[1, first:last], projections[2, first:last]
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
def _drawable(corners: Any, projections: Any, height: int, width: int, boxes: Any, depths: Any) -> int:
    """List the facets, corners (K, 4), to be rendered: not those that face away, are too near or too large, or contain
    no pixel centre. Writes, per facet, its index, first and last column, first and last row (K, 5), and its mean depth
    (K,); returns their number."""
    n, (us, vs, zs) = 0, (projections[0], projections[1], projections[2])
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
    corners: Any, projections: Any, box: Any, depth: float, element: int, top: int, left: int, elements: Any,
    depths: Any,
) -> None:  # fmt: skip
    """Render a facet, corners (4,), into the part of an image that begins at (top, left)."""
    ax, ay = projections[0, corners[0]], projections[1, corners[0]]
    bx, by = projections[0, corners[1]], projections[1, corners[1]]
    cx, cy = projections[0, corners[2]], projections[1, corners[2]]
    dx, dy = projections[0, corners[3]], projections[1, corners[3]]
    for y in range(box[3], box[4] + 1):
        for x in range(box[1], box[2] + 1):
            if (
                depth < depths[y - top, x - left]
                and (bx - ax) * (y - ay) - (by - ay) * (x - ax) <= 0.0
                and (cx - bx) * (y - by) - (cy - by) * (x - bx) <= 0.0
                and (dx - cx) * (y - cy) - (dy - cy) * (x - cx) <= 0.0
                and (ax - dx) * (y - dy) - (ay - dy) * (x - dx) <= 0.0
            ):
                elements[y - top, x - left], depths[y - top, x - left] = element, depth


@inlined_exactly
def _likelihood_ratio(element: int, grey_level: float, texture: Any, sigma: Any, peaks: Any) -> float:
    """Return the likelihood ratio of a grey level for an element and for uniform grey levels; 1 for an element without
    a level."""
    if not peaks[element] > 0.0:
        return 1.0
    residual = (grey_level - texture[element]) / sigma[element]
    return OUTLIER_FRACTION + (1.0 - OUTLIER_FRACTION) * (peaks[element] * np.exp(-0.5 * residual * residual))


@kernel(error_model="numpy")
def _draw_all(
    points: Any, runs: Any, corners: Any, facet_elements: Any, rotations: Any, positions: Any, camera: Any,
    elements: Any, depths: Any,
) -> None:  # fmt: skip
    n = len(facet_elements)
    projections, boxes, facet_depths = np.empty(points.shape), np.empty((n, 5), dtype=np.int64), np.empty(n)
    _project_points(points, runs, rotations, positions, camera, projections)
    for f in range(_drawable(corners, projections, elements.shape[0], elements.shape[1], boxes, facet_depths)):
        k = boxes[f, 0]
        _draw(corners[k], projections, boxes[f], facet_depths[f], facet_elements[k], 0, 0, elements, depths)


@kernel(error_model="numpy")
def _log_ratios(
    first: int, last: int, behind_depths: Any, points: Any, runs: Any, corners: Any, facet_elements: Any,
    rotations: Any, positions: Any, camera: Any, image: Any, ratio: Any, unoccluded: Any, texture: Any, sigma: Any,
    peak: Any,
    behind_log_ratios: Any, log_ratios: Any,
) -> None:  # fmt: skip
    size = len(facet_elements)
    projections, boxes, depths = np.empty(points.shape), np.empty((size, 5), dtype=np.int64), np.empty(size)
    for i in range(first, last):
        _project_points(points, runs, rotations[i], positions[i], camera, projections)
        n_drawn = _drawable(corners, projections, behind_depths.shape[0], behind_depths.shape[1], boxes, depths)
        if n_drawn == 0:
            continue
        left, right = boxes[:n_drawn, 1].min(), boxes[:n_drawn, 2].max()
        top, bottom = boxes[:n_drawn, 3].min(), boxes[:n_drawn, 4].max()
        elements = np.full((bottom - top + 1, right - left + 1), -1, dtype=np.int64)
        depths_here = behind_depths[top : bottom + 1, left : right + 1].copy()
        for f in range(n_drawn):
            k = boxes[f, 0]
            _draw(corners[k], projections, boxes[f], depths[f], facet_elements[k], top, left, elements, depths_here)
        total, product, n = 0.0, 1.0, 0
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                element = elements[y - top, x - left]
                if element >= 0 and unoccluded[y, x]:
                    total += ratio[y, x] - behind_log_ratios[y, x]
                    product *= _likelihood_ratio(element, image[y, x], texture, sigma, peak)
                    n += 1
                    if n % _PRODUCT_LENGTH == 0:
                        total, product = total + np.log(product), 1.0
        log_ratios[i] = total + np.log(product)


@kernel(error_model="numpy")
def _pixel_log_ratios(
    elements: Any, image: Any, ratio: Any, unoccluded: Any, texture: Any, sigma: Any, peak: Any, log_ratios: Any
) -> None:
    """Write the log likelihood ratio of every pixel of a layer to the background."""
    for y in range(elements.shape[0]):
        for x in range(elements.shape[1]):
            if elements[y, x] >= 0 and unoccluded[y, x]:
                likelihood_ratio = _likelihood_ratio(elements[y, x], image[y, x], texture, sigma, peak)
                log_ratios[y, x] = ratio[y, x] + np.log(likelihood_ratio)
