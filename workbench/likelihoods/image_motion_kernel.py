"""The fused kernel of the image-motion likelihood: what `image_motion_reference` defines, one particle at a time.

Particles are independent, each writes its own slot only, and no sum crosses particles: the number of threads cannot
change a bit of the result. Positions and depths are float64 so that kernel and reference agree on which side of an
edge a point lies; grey levels are float32.

The inner functions take plain arrays, with named columns: an array inside a tuple, or a slice of one, is
reference-counted at every call, which costs a fifth of the time.
"""

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numba
import numpy as np

from workbench.arrays import BoolArray, Float32Array, FloatArray, IntArray
from workbench.body.camera import Camera
from workbench.body.kinematics import JointFrames
from workbench.body.limbs import Limbs

Exponent = Literal["mean", "sum"]
Occlusion = Literal["sample", "limb", "none"]
Background = Literal["none", "still"]

# Here and not beside the reference: numba would not notice a change of them in another file.
MIN_DEPTH = 1e-3
"""A patch with a corner nearer to the camera's plane than this, m, or behind it, is not compared."""
MIN_SINE = 1e-3
"""A limb that points at the camera more closely than this, rad, has no patch and is not compared."""
MIN_AREA = 1e-6
"""A patch whose projection is smaller than about this, px², covers nothing."""


@dataclass(frozen=True)
class LimbModel:
    """The constants of A eq. 10 and 11; `ImageMotion` documents and checks them."""

    sigma: float
    epsilon: float
    p_occluded: float
    exponent: Exponent
    k: float
    occlusion: Occlusion
    background: Background


@dataclass(frozen=True, eq=False)
class PosedView:
    """What one camera saw at one time, and where the body is supposed to have been then, in N ways.

    image: (height, width) smoothed grey levels. frames: of the joints in the N poses.
    """

    camera: Camera
    image: Float32Array
    frames: JointFrames


# Every reordering that keeps NaN and infinity meaningful. With NumPy's error model a division does not branch.
FAST = {"reassoc", "contract", "nsz", "arcp"}
CHUNK = 32  # particles that share one thread's work space

# Columns of the limbs' table: the axis' ends, the semi-axes of the section at either end, whether it is a sphere.
START, END, START_RADII, END_RADII, SPHERE, THICKNESS = 0, 3, 6, 8, 10, 11
# A camera: its rotation row by row, translation, fx, fy, cx, cy, k1, k2, p1, p2, k3.
ROTATION, TRANSLATION, FOCAL, CENTRE, DISTORTION = 0, 9, 12, 14, 16
# A patch is (AX + u DX) + v (WX + u EX) in x, the same in y, and Z + u DZ in depth; u = 0..1 along, v = −1..1 across.
# ACROSS: x and y, in the joint's frame, of the direction in which v grows.
AX, AY, DX, DY, WX, WY, EX, EY, Z, DZ, ACROSS, PATCH = *range(11), 12
# What a limb covers: u and v of a pixel by an affine map, |v| <= H + u DH for a patch; its bounding box and depths.
UX, UY, U0, VX, VY, V0, H, DH, LEFT, RIGHT, TOP, BOTTOM, NEAR, FAR, SURFACE = range(15)

NO_OCCLUSION, SAMPLE_OCCLUSION, LIMB_OCCLUSION = range(3)


class _Model(NamedTuple):
    """`LimbModel` as numbers."""

    sigma: float
    epsilon: float
    p_occluded: float
    mean: bool
    k: float
    occlusion: int
    still_background: bool


def view_log_prob(
    limbs: Limbs, samples: FloatArray, model: LimbModel, before: PosedView, now: PosedView
) -> tuple[FloatArray, IntArray]:
    """The same as `image_motion_reference.view_log_prob`; runs on as many threads as numba is set to."""
    n = len(now.frames.positions)
    log_prob, outside = np.empty(n), np.empty(n, dtype=np.int64)
    occlusion = {"none": NO_OCCLUSION, "sample": SAMPLE_OCCLUSION, "limb": LIMB_OCCLUSION}[model.occlusion]
    u, v = np.ascontiguousarray(samples.T)
    _run(
        *(_limb_table(limbs), limbs.joints, u, v),
        _Model(
            *(model.sigma, model.epsilon, model.p_occluded, model.exponent == "mean", model.k, occlusion),
            model.background == "still",
        ),
        *(before.image, _camera_row(before.camera), before.frames.rotations, before.frames.positions),
        *(now.image, _camera_row(now.camera), now.frames.rotations, now.frames.positions),
        *(log_prob, outside),
    )
    return log_prob, outside


def place_points(
    limbs: Limbs, samples: FloatArray, camera: Camera, frames: JointFrames, beside: bool
) -> tuple[Float32Array, BoolArray, FloatArray]:
    """The pixels (N, L, n, 2) of points (n, 2) of every patch, which of them count, and how the limbs are turned.

    The second result (N, L, n) is true for points in the image that no other limb hides, as `hidden_samples` of the
    reference says for "sample"; with `beside`, for points in the image that no limb covers at any depth: those just
    outside a limb, |v| > 1. The third (N, L), rad, is the azimuth in the joint's frame of the limb's side at v = 1.
    """
    shape = (len(frames.positions), len(limbs), len(samples))
    pixels, counts = np.empty((*shape, 2), dtype=np.float32), np.empty(shape, dtype=np.bool_)
    turns = np.empty(shape[:2])
    u, v = np.ascontiguousarray(samples.T)
    _place_points(
        *(_limb_table(limbs), limbs.joints, u, v, _camera_row(camera), float(camera.width), float(camera.height)),
        *(frames.rotations, frames.positions, beside, pixels, counts, turns),
    )
    return pixels, counts, turns


def _limb_table(limbs: Limbs) -> FloatArray:
    thickness = limbs.radii.mean(axis=(1, 2))
    return np.column_stack(
        [limbs.starts, limbs.ends, limbs.radii.reshape(-1, 4), limbs.spheres.astype(np.float64), thickness]
    )


def _camera_row(camera: Camera) -> FloatArray:
    focal, centre = camera.matrix[[0, 1], [0, 1]], camera.matrix[:2, 2]
    return np.concatenate([camera.rotation.ravel(), camera.translation, focal, centre, camera.distortion])


@numba.njit(cache=True, nogil=True, parallel=True, error_model="numpy", fastmath=FAST)
def _run(
    table: Any, joints: Any, u: Any, v: Any, model: Any,
    image_before: Any, camera_before: Any, rotations_before: Any, positions_before: Any,
    image_now: Any, camera_now: Any, rotations_now: Any, positions_now: Any,
    log_prob: Any, outside: Any,
) -> None:  # fmt: skip
    n_particles, n_limbs, n = log_prob.shape[0], joints.shape[0], u.shape[0]
    for chunk in numba.prange((n_particles + CHUNK - 1) // CHUNK):
        patches_before, patches_now = np.empty((n_limbs, PATCH)), np.empty((n_limbs, PATCH))
        covers = np.empty((n_limbs, 15))
        cos_alpha, points, hidden = np.empty(n_limbs), np.empty((4, n)), np.empty(n, dtype=np.bool_)
        for i in range(chunk * CHUNK, min((chunk + 1) * CHUNK, n_particles)):
            for limb in range(n_limbs):
                joint = joints[limb]
                cos_before = _patch(
                    table, limb, camera_before, rotations_before, positions_before, i, joint, patches_before
                )
                cos_now = _patch(table, limb, camera_now, rotations_now, positions_now, i, joint, patches_now)
                _cover(patches_now, limb, cos_now > 0.0, table, covers)
                cos_alpha[limb] = cos_now if cos_before > 0.0 else 0.0
            total, n_outside = 0.0, 0
            for limb in range(n_limbs):
                if cos_alpha[limb] == 0.0:
                    total += np.log(model.p_occluded)
                    n_outside += n
                    continue
                _positions(patches_before, limb, u, v, points, 0)
                _positions(patches_now, limb, u, v, points, 2)
                hidden[:] = False
                if model.occlusion != NO_OCCLUSION:
                    _hide(table, limb, u, points, patches_now, covers, model.occlusion == LIMB_OCCLUSION, hidden)
                squares, still_squares, n_compared, n_left_out = _compare(
                    image_before, image_now, points, hidden, model.still_background
                )
                total += _limb_log_prob(model, cos_alpha[limb], squares, n_compared, n)
                if model.still_background:
                    total -= _still_log_ratio(model, still_squares, n_compared) * n_compared / n
                n_outside += n_left_out
            log_prob[i], outside[i] = total, n_outside


@numba.njit(cache=True, nogil=True, parallel=True, error_model="numpy", fastmath=FAST)
def _place_points(
    table: Any, joints: Any, u: Any, v: Any, camera: Any, width: float, height: float,
    rotations: Any, positions: Any, beside: bool, pixels: Any, counts: Any, turns: Any,
) -> None:  # fmt: skip
    n_particles, n_limbs, n = counts.shape
    for chunk in numba.prange((n_particles + CHUNK - 1) // CHUNK):
        patches, covers, cos_alpha = np.empty((n_limbs, PATCH)), np.empty((n_limbs, 15)), np.empty(n_limbs)
        points, hidden = np.empty((4, n)), np.empty(n, dtype=np.bool_)  # rows 2 and 3, as in `_run`
        for i in range(chunk * CHUNK, min((chunk + 1) * CHUNK, n_particles)):
            for limb in range(n_limbs):
                cos_alpha[limb] = _patch(table, limb, camera, rotations, positions, i, joints[limb], patches)
                _cover(patches, limb, cos_alpha[limb] > 0.0, table, covers)
            for limb in range(n_limbs):
                if cos_alpha[limb] == 0.0:
                    pixels[i, limb], counts[i, limb], turns[i, limb] = 0.0, False, 0.0
                    continue
                turns[i, limb] = np.arctan2(patches[limb, ACROSS + 1], patches[limb, ACROSS])
                _positions(patches, limb, u, v, points, 2)
                hidden[:] = False
                if beside:
                    _hide_covered(table, limb, u, points, patches, covers, hidden)
                else:
                    _hide(table, limb, u, points, patches, covers, False, hidden)
                for s in range(n):
                    pixels[i, limb, s, 0], pixels[i, limb, s, 1] = points[2, s], points[3, s]
                    x, y = pixels[i, limb, s, 0], pixels[i, limb, s, 1]  # rounded, as they will be looked up
                    inside = x >= 0.0 and x < width - 1.0 and y >= 0.0 and y < height - 1.0  # false for NaN
                    counts[i, limb, s] = inside and not hidden[s]


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _hide_covered(table: Any, limb: int, u: Any, points: Any, patches: Any, covers: Any, hidden: Any) -> None:
    """Mark the points that any limb covers, whatever its depth."""
    left, right, top, bottom = points[2].min(), points[2].max(), points[3].min(), points[3].max()
    for k in range(covers.shape[0]):
        across = (covers[k, LEFT] <= right) & (covers[k, RIGHT] >= left)  # never so without a cover
        if across & (covers[k, TOP] <= bottom) & (covers[k, BOTTOM] >= top):
            _hide_behind(table, limb, k, u, points, patches, covers, -np.inf, hidden)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _limb_log_prob(model: Any, cos_alpha: float, squares: float, n_compared: int, n: int) -> Any:
    """log p_j (A eq. 10 and 11)."""
    q = cos_alpha * n_compared / n
    exponent = model.k * squares
    if model.mean:
        exponent /= max(n_compared, 1)
    sigma = model.sigma / cos_alpha
    exponent /= 2.0 * sigma * sigma
    peak = q * (1.0 - model.epsilon) / (np.sqrt(2.0 * np.pi) * sigma)
    flat = q * model.epsilon / 256.0 + (1.0 - q) * model.p_occluded
    if flat > 0.0:
        return np.log(flat + peak * np.exp(-exponent))
    return np.log(peak) - exponent  # ε = 0 and q = 1: no floor under the Gaussian


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _still_log_ratio(model: Any, squares: float, n_compared: int) -> Any:
    """log p of the points under a background that stands still, less that of points where nothing changed."""
    exponent = model.k * squares / (2.0 * model.sigma * model.sigma)
    if model.mean:
        exponent /= max(n_compared, 1)
    flat, peak = model.epsilon / 256.0, (1.0 - model.epsilon) / (np.sqrt(2.0 * np.pi) * model.sigma)
    if flat > 0.0:
        return np.log((flat + peak * np.exp(-exponent)) / (flat + peak))
    return -exponent


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _compare(image_before: Any, image_now: Any, points: Any, hidden: Any, still: bool) -> tuple[float, float, int, int]:
    """Over the points to compare: the sum of squared differences, that (if `still`) to the same pixels of the image
    before, and their number; and the number of points outside the images."""
    right_before, bottom_before = image_before.shape[1] - 1.0, image_before.shape[0] - 1.0
    right_now, bottom_now = image_now.shape[1] - 1.0, image_now.shape[0] - 1.0
    squares, still_squares, n_compared, n_outside = 0.0, 0.0, 0, 0
    for i in range(points.shape[1]):
        a, b, c, d = points[0, i], points[1, i], points[2, i], points[3, i]
        inside_before = a >= 0.0 and a < right_before and b >= 0.0 and b < bottom_before  # false for NaN
        if not (inside_before and c >= 0.0 and c < right_now and d >= 0.0 and d < bottom_now):
            n_outside += 1
        elif not hidden[i]:
            level = _bilinear(image_now, c, d)
            residual = level - _bilinear(image_before, a, b)
            squares += residual * residual
            n_compared += 1
            if still and c < right_before and d < bottom_before:
                residual = level - _bilinear(image_before, c, d)
                still_squares += residual * residual
    return squares, still_squares, n_compared, n_outside


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _bilinear(image: Any, x: float, y: float) -> Any:
    # Unsigned indices spare numba's test for negative ones.
    column, row = np.uint32(x), np.uint32(y)
    right, below = np.uint32(column + np.uint32(1)), np.uint32(row + np.uint32(1))
    fx, fy = np.float32(x - column), np.float32(y - row)
    top = image[row, column] + fx * (image[row, right] - image[row, column])
    bottom = image[below, column] + fx * (image[below, right] - image[below, column])
    return top + fy * (bottom - top)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _positions(patches: Any, limb: int, u: Any, v: Any, points: Any, row: int) -> None:
    """Write the pixels of the points (u, v) into two rows of `points`."""
    ax, ay, dx, dy = patches[limb, AX], patches[limb, AY], patches[limb, DX], patches[limb, DY]
    wx, wy, ex, ey = patches[limb, WX], patches[limb, WY], patches[limb, EX], patches[limb, EY]
    for i in range(u.shape[0]):
        points[row, i] = ax + u[i] * dx + v[i] * (wx + u[i] * ex)
        points[row + 1, i] = ay + u[i] * dy + v[i] * (wy + u[i] * ey)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _hide(table: Any, limb: int, u: Any, points: Any, patches: Any, covers: Any, whole: bool, hidden: Any) -> None:
    """Mark the points that other limbs hide; bounding boxes and depths rule most limbs out beforehand."""
    for k in range(covers.shape[0]):
        margin = (table[limb, THICKNESS] + table[k, THICKNESS]) / 2.0
        nearer = covers[k, SURFACE] < covers[limb, SURFACE] if whole else covers[k, NEAR] + margin < covers[limb, FAR]
        if (k != limb) & nearer & _meet(covers, k, limb):
            _hide_behind(table, limb, k, u, points, patches, covers, -np.inf if whole else margin, hidden)
    if whole:
        hidden[:] = np.any(hidden)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _meet(covers: Any, k: int, limb: int) -> Any:
    across = (covers[k, LEFT] <= covers[limb, RIGHT]) & (covers[k, RIGHT] >= covers[limb, LEFT])
    return across & (covers[k, TOP] <= covers[limb, BOTTOM]) & (covers[k, BOTTOM] >= covers[limb, TOP])


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _hide_behind(
    table: Any, limb: int, k: int, u: Any, points: Any, patches: Any, covers: Any, margin: float, hidden: Any
) -> None:
    """Mark the points that limb k covers and that lie deeper than it by the margin."""
    ux, uy, u0 = covers[k, UX], covers[k, UY], covers[k, U0]
    vx, vy, v0 = covers[k, VX], covers[k, VY], covers[k, V0]
    h, dh, z, dz = covers[k, H], covers[k, DH], patches[k, Z] + margin, patches[k, DZ]
    depth, slope = patches[limb, Z], patches[limb, DZ]
    if table[k, SPHERE] > 0.0:
        for i in range(u.shape[0]):
            x, y = points[2, i], points[3, i]
            s, t = 2.0 * (u0 + ux * x + uy * y) - 1.0, v0 + vx * x + vy * y
            hidden[i] |= (s * s + t * t <= 2.0) & (z + 0.5 * dz < depth + u[i] * slope)
    else:
        for i in range(u.shape[0]):
            x, y = points[2, i], points[3, i]
            s, t = u0 + ux * x + uy * y, v0 + vx * x + vy * y
            covered = (s >= 0.0) & (s <= 1.0) & (abs(t) <= h + s * dh)
            hidden[i] |= covered & (z + s * dz < depth + u[i] * slope)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _patch(
    table: Any, limb: int, camera: Any, rotations: Any, positions: Any, particle: int, joint: int, patches: Any
) -> float:
    """Write the limb's patch and return cos α; 0 when there is no patch. See `limb_patches` of the reference."""
    sphere = table[limb, SPHERE] > 0.0
    x_axis, y_axis, z_axis, origin = _joint_to_camera(camera, rotations, positions, particle, joint)
    start = _place(x_axis, y_axis, z_axis, origin, table[limb, START], table[limb, START + 1], table[limb, START + 2])
    end = _place(x_axis, y_axis, z_axis, origin, table[limb, END], table[limb, END + 1], table[limb, END + 2])
    axis = z_axis if sphere else _unit(_add(end, -1.0, start))
    sight = _add(start, 1.0, end)
    across = _cross(sight, axis)
    if not _dot(across, across) > MIN_SINE * MIN_SINE * _dot(sight, sight):
        return 0.0
    across = _unit(across)
    x, y = _dot(x_axis, across), _dot(y_axis, across)
    patches[limb, ACROSS], patches[limb, ACROSS + 1] = x, y
    if sphere:
        cos_alpha = 1.0
        start_width = end_width = table[limb, START_RADII] / np.sqrt(2.0)
        upright = _cross(across, _unit(sight))
        start, end = _add(start, -start_width, upright), _add(end, end_width, upright)
    else:
        cos_alpha = _norm(axis[0], axis[1])
        start_width = _norm(table[limb, START_RADII] * x, table[limb, START_RADII + 1] * y)
        end_width = _norm(table[limb, END_RADII] * x, table[limb, END_RADII + 1] * y)
    a, b = _add(start, -start_width, across), _add(start, start_width, across)
    c, d = _add(end, -end_width, across), _add(end, end_width, across)
    if not min(a[2], b[2], c[2], d[2]) > MIN_DEPTH:
        return 0.0
    _write(patches, limb, _project(camera, a), _project(camera, b), _project(camera, c), _project(camera, d))
    patches[limb, Z], patches[limb, DZ] = start[2], end[2] - start[2]
    return cos_alpha


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _write(patches: Any, limb: int, a: Any, b: Any, c: Any, d: Any) -> None:
    """Write the patch with the corners a, b at its start and c, d at its end, px."""
    patches[limb, AX], patches[limb, AY] = (a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0
    patches[limb, DX], patches[limb, DY] = (c[0] + d[0] - a[0] - b[0]) / 2.0, (c[1] + d[1] - a[1] - b[1]) / 2.0
    patches[limb, WX], patches[limb, WY] = (b[0] - a[0]) / 2.0, (b[1] - a[1]) / 2.0
    patches[limb, EX], patches[limb, EY] = (d[0] - c[0] - b[0] + a[0]) / 2.0, (d[1] - c[1] - b[1] + a[1]) / 2.0


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _cover(patches: Any, limb: int, usable: bool, table: Any, covers: Any) -> None:
    """Write what a patch (a sphere's disc) covers: the inverse of its affine part, bounding box and depths."""
    ax, ay, dx, dy = patches[limb, AX], patches[limb, AY], patches[limb, DX], patches[limb, DY]
    ex, ey, z0, z1 = patches[limb, EX], patches[limb, EY], patches[limb, Z], patches[limb, Z] + patches[limb, DZ]
    wx, wy = patches[limb, WX] + ex / 2.0, patches[limb, WY] + ey / 2.0  # half the width, in the middle
    area = dx * wy - dy * wx
    if not (usable and abs(area) > MIN_AREA):
        covers[limb, LEFT], covers[limb, RIGHT] = np.inf, -np.inf  # meets no other box
        return
    ux, uy, vx, vy = wy / area, -wx / area, -dy / area, dx / area
    covers[limb, UX], covers[limb, UY], covers[limb, U0] = ux, uy, -(ux * ax + uy * ay)
    covers[limb, VX], covers[limb, VY], covers[limb, V0] = vx, vy, -(vx * ax + vy * ay)
    half = _norm(wx, wy)
    start_width, end_width = _norm(wx - ex / 2.0, wy - ey / 2.0) / half, _norm(wx + ex / 2.0, wy + ey / 2.0) / half
    covers[limb, H], covers[limb, DH] = start_width, end_width - start_width
    if table[limb, SPHERE] > 0.0:
        reach_x, reach_y = np.sqrt(2.0) * _norm(dx / 2.0, wx), np.sqrt(2.0) * _norm(dy / 2.0, wy)
    else:
        widest = max(start_width, end_width)
        reach_x, reach_y = abs(dx) / 2.0 + widest * abs(wx), abs(dy) / 2.0 + widest * abs(wy)
    covers[limb, LEFT], covers[limb, RIGHT] = ax + dx / 2.0 - reach_x, ax + dx / 2.0 + reach_x
    covers[limb, TOP], covers[limb, BOTTOM] = ay + dy / 2.0 - reach_y, ay + dy / 2.0 + reach_y
    covers[limb, NEAR], covers[limb, FAR] = min(z0, z1), max(z0, z1)
    covers[limb, SURFACE] = min(z0, z1) - table[limb, THICKNESS]


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _project(camera: Any, point: Any) -> tuple[float, float]:
    """Pixel of a point in the camera's frame, as `Camera.project` does."""
    x, y = point[0] / point[2], point[1] / point[2]
    k1, k2, k3 = camera[DISTORTION], camera[DISTORTION + 1], camera[DISTORTION + 4]
    p1, p2 = camera[DISTORTION + 2], camera[DISTORTION + 3]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    bent_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    bent_y = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return camera[CENTRE] + camera[FOCAL] * bent_x, camera[CENTRE + 1] + camera[FOCAL + 1] * bent_y


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _joint_to_camera(camera: Any, rotations: Any, positions: Any, i: int, j: int) -> Any:
    """The axes and the origin of a joint's frame, seen from the camera."""
    x_axis = _turn(camera, rotations[i, j, 0, 0], rotations[i, j, 1, 0], rotations[i, j, 2, 0])
    y_axis = _turn(camera, rotations[i, j, 0, 1], rotations[i, j, 1, 1], rotations[i, j, 2, 1])
    z_axis = _turn(camera, rotations[i, j, 0, 2], rotations[i, j, 1, 2], rotations[i, j, 2, 2])
    x, y, z = _turn(camera, positions[i, j, 0], positions[i, j, 1], positions[i, j, 2])
    origin = x + camera[TRANSLATION], y + camera[TRANSLATION + 1], z + camera[TRANSLATION + 2]
    return x_axis, y_axis, z_axis, origin


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _turn(r: Any, x: float, y: float, z: float) -> tuple[float, float, float]:
    return r[0] * x + r[1] * y + r[2] * z, r[3] * x + r[4] * y + r[5] * z, r[6] * x + r[7] * y + r[8] * z


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _place(x_axis: Any, y_axis: Any, z_axis: Any, origin: Any, x: float, y: float, z: float) -> Any:
    return _add(_add(_add(origin, x, x_axis), y, y_axis), z, z_axis)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _add(p: Any, length: float, direction: Any) -> tuple[float, float, float]:
    return p[0] + length * direction[0], p[1] + length * direction[1], p[2] + length * direction[2]


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _cross(a: Any, b: Any) -> tuple[float, float, float]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _dot(a: Any, b: Any) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _unit(a: Any) -> tuple[float, float, float]:
    scale = 1.0 / max(np.sqrt(_dot(a, a)), 1e-12)
    return a[0] * scale, a[1] * scale, a[2] * scale


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _norm(x: float, y: float) -> Any:
    return np.sqrt(x * x + y * y)
