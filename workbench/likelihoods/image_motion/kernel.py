"""The fused kernel of the image-motion likelihood, LANES particles at once; `tests/oracles/image_motion.py` defines it.

Particles are independent, each writes its own slot only, and no sum crosses particles: the result is bitwise identical
for any number of threads and any other particles. Reasons for its speed:

- Lanes. Kinematics, patches, occlusion, interpolation: one particle per lane, see `workbench.body.simd_kinematics`.
- Interpolation in three phases, a block of points at a time: vector instructions compute the indices, plain loads fetch
  the pixels, vector instructions interpolate. Only the loads are scalar.
- Packed neighbourhoods: one word of 64 bits holds a pixel and its right, lower and lower right neighbours, so that a
  point needs one load instead of four. Grey levels are rounded to 255/65535.
- Small coordinates. Decisions (inside? hidden?) are made in float64. Interpolation counts pixels from the patch's
  own corner, where float32 is accurate to 1e-5 px, and vectors hold twice as many.
- Shared work: children of one parent are adjacent after resampling, and have the same previous pose, whose grey levels
  are read once. With four children per parent this saves a sixth of the time.
- Early tests, for all lanes at once: a limb inside both images that no other limb may hide has no point to test; a limb
  without a visible point is skipped.
- One logarithm per particle: the limbs' likelihoods are multiplied as long as their product cannot underflow.

The inner functions take plain arrays, with named rows: an array in a tuple is reference-counted at every call.
"""

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from workbench.body.limbs import Body, Limbs
from workbench.body.simd_kinematics import FAST, FRAME, LANES, inlined, lane_frames, load_frames
from workbench.cameras.camera import Camera
from workbench.likelihoods.image_motion.patches import (
    ACROSS,
    AX,
    AY,
    COSINE,
    COVER,
    DX,
    EX,
    OUTSIDE,
    PAIR,
    PATCH,
    WX,
    cover,
    flag_covered,
    flag_hidden,
    flag_outside,
    patch,
    place,
)  # fmt: skip
from workbench.utils.arrays import Float32Array, FloatArray, IntArray
from workbench.utils.kernel_cache import kernel
from workbench.utils.parallel import parallel_for

Reduction = Literal["mean", "sum"]
Occlusion = Literal["sample", "limb", "none"]
Background = Literal["none", "static"]
Packed: TypeAlias = NDArray[np.uint64]


@dataclass(frozen=True)
class LimbModel:
    """The parameters of A eq. 10 and 11; `ImageMotion` documents and checks them."""

    sigma: float
    outlier_fraction: float
    p_occluded: float
    reduction: Reduction
    effective_pixels: float
    occlusion: Occlusion
    background: Background


@dataclass(frozen=True, eq=False)
class PackedView:
    """One camera's view at one time. image: smoothed grey levels, see `packed`. poses: (N, P) of the body."""

    camera: Camera
    image: Packed
    poses: FloatArray


GREY_STEP = 255.0 / 65535.0  # grey levels per step of a packed image
BLOCK = 25 * LANES
"""Points interpolated together; their work space shares the first-level cache with the pixels."""

PARENT_BLOCK = 16 * LANES
"""Particles among which equal previous poses are evaluated once; their grey levels fit into the second-level cache."""

NO_PATCH, PARTLY_OUTSIDE, FULLY_INSIDE = range(3)  # state of a limb in the previous image
NO_OCCLUSION, SAMPLE_OCCLUSION, LIMB_OCCLUSION = range(3)
WIDTH, HEIGHT = 21, 22  # columns of a camera, after those of `patches`
X, Y, LOCAL = 0, 4 * LANES, 8 * LANES
"""Rows of a patch for interpolation: those from AX and those from AY, in float32, counted from a pixel of the image."""


class _Model(NamedTuple):
    """`LimbModel` as numbers."""

    sigma: float
    outlier_fraction: float
    p_occluded: float
    mean: bool
    effective_pixels: float
    occlusion: int
    static_background: bool


def view_log_prob(
    body: Body, samples: FloatArray, model: LimbModel, previous: PackedView, present: PackedView
) -> tuple[FloatArray, IntArray]:
    """Return log p(I_t | φ_t, φ_t−1, I_t−1) of one camera (N,), and the number of points outside the images (N,).

    Parameters
    ----------
    body, samples : the body, and the points (n, 2) of every patch.
    model : the likelihood's parameters.
    previous, present : the views at t − 1 and t, of one size for a static background.
    """
    n, skeleton = len(present.poses), body.skeleton
    log_prob, outside = np.empty(n), np.empty(n, dtype=np.int64)
    occlusion = {"none": NO_OCCLUSION, "sample": SAMPLE_OCCLUSION, "limb": LIMB_OCCLUSION}[model.occlusion]
    numbers = (model.sigma, model.outlier_fraction, model.p_occluded, model.effective_pixels)
    sigma, outlier_fraction, p_occluded, n_pixels = map(float, numbers)  # integers would compile the kernel again
    mean, static = model.reduction == "mean", model.background == "static"
    arguments = (
        (skeleton.parents, skeleton.offsets, skeleton.dof_joints, skeleton.dof_axes),
        *(limb_table(body.limbs), body.limbs.joints, sample_rows(samples), sample_rows(samples).astype(np.float32)),
        _Model(sigma, outlier_fraction, p_occluded, mean, n_pixels, occlusion, static),
        np.stack([previous.camera.row, present.camera.row]),
        *(previous.image.ravel(), np.ascontiguousarray(previous.poses)),
        *(present.image.ravel(), np.ascontiguousarray(present.poses)), *(log_prob, outside),
    )  # fmt: skip
    parallel_for(lambda first, last: _run(first, last, *arguments), n, LANES)
    return log_prob, outside


def packed(image: Float32Array) -> Packed:
    """Return words (height, width) of four grey levels 0..255, 16 bits each, lowest first: the pixel, its right
    neighbour, the one below, and that one's right neighbour. The last row and column are their own neighbours."""
    words = np.empty(image.shape, dtype=np.uint64)
    _pack(image, np.empty((2, image.shape[1] + 1), dtype=np.uint64), words)
    return words


def sample_rows(samples: FloatArray) -> FloatArray:
    """Return points (n, 2) in the kernel's layout, (2, n)."""
    return np.ascontiguousarray(samples.T)


def limb_table(limbs: Limbs) -> FloatArray:
    """Return the limbs' table (L, 12 + L) of the kernel; `patches` names its columns."""
    radii, thickness = limbs.radii.reshape(-1, 4), limbs.radii.mean(axis=(1, 2))
    spheres, connected = limbs.spheres.astype(np.float64), limbs.connected.astype(np.float64)
    return np.column_stack([limbs.starts, limbs.ends, radii, spheres, thickness, connected])


@kernel()
def _pack(image: Any, levels: Any, words: Any) -> None:
    """levels: (2, width + 1) of two rows, overwritten."""
    height, width = image.shape
    for row in range(height + 1):
        line, above = levels[row % 2], levels[(row + 1) % 2]
        pixels = image[min(row, height - 1)]
        for column in range(width):
            line[column] = np.uint64(np.int32(pixels[column] / np.float32(GREY_STEP) + np.float32(0.5)))
        line[width] = line[width - 1]
        if row > 0:
            for column in range(width):
                upper = above[column] | (above[column + 1] << np.uint64(16))
                lower = line[column] | (line[column + 1] << np.uint64(16))
                words[row - 1, column] = upper | (lower << np.uint64(32))


@kernel(error_model="numpy", fastmath=FAST)
def _run(
    first: int, last: int, skeleton: Any, table: Any, joints: Any, samples: Any, samples32: Any, model: Any,
    cameras: Any, previous_image: Any, previous_poses: Any, present_image: Any, present_poses: Any,
    log_prob: Any, outside: Any,
) -> None:  # fmt: skip
    """Evaluate particles `first` to `last`, PARENT_BLOCK at a time: their distinct previous poses, then their present
    poses. Both are processed LANES at a time by the same code, which compiles faster than two copies; the last pose
    fills the remaining lanes."""
    n_limbs, n, n_dofs = joints.shape[0], samples.shape[1], present_poses.shape[1]
    patches, covers = np.empty((n_limbs, PATCH)), np.empty((n_limbs, COVER))
    boxes, pair, flags = np.empty((n_limbs, 6)), np.empty(PAIR), np.empty(n * LANES, dtype=np.int32)
    frames, values = np.empty((skeleton[0].shape[0], FRAME)), np.empty((n_dofs + 9) * LANES)
    # The distinct previous poses, the index of each child's, and their limbs' grey levels and states in that image.
    parents, parent = np.empty((PARENT_BLOCK, n_dofs)), np.empty(PARENT_BLOCK, dtype=np.int32)
    previous_levels = np.empty((n_limbs, PARENT_BLOCK * n), dtype=np.float32)
    states = np.empty((n_limbs, PARENT_BLOCK), dtype=np.int32)
    # Of one limb: its patch; per lane: whether it is fully inside, the parent's index, the number of visible points.
    local, lanes = np.empty(LOCAL, dtype=np.float32), np.empty((6, LANES), dtype=np.int32)
    corners, fully_inside, lane_parents = lanes[0], lanes[1], lanes[2]
    starts, inside, visible = lanes[3], lanes[4], lanes[5]
    # Of its points: grey levels in the previous image, the present one, and the previous one at the present place.
    index, words = np.empty(BLOCK, dtype=np.uint32), np.empty(BLOCK, dtype=np.uint64)
    fractions, gathered = np.empty(2 * BLOCK, dtype=np.float32), np.empty(n * LANES, dtype=np.float32)
    present_levels = np.empty(n * LANES, dtype=np.float32)
    static = np.empty(n * LANES * model.static_background, dtype=np.float32)
    squares, sums = np.empty(2 * LANES), np.empty(3 * LANES)
    _clear(flags)
    hiding, whole_limb = model.occlusion != NO_OCCLUSION, model.occlusion == LIMB_OCCLUSION
    for block in range(first, last, PARENT_BLOCK):
        n_children = min(PARENT_BLOCK, last - block)
        n_parents = _distinct_parents(previous_poses, block, n_children, parents, parent)
        distinct = n_parents == n_children
        for present in range(2):
            image, poses = (present_image, present_poses) if present else (previous_image, parents)
            begin, n_poses, camera = block if present else 0, n_children if present else n_parents, cameras[present]
            for chunk in range(0, n_poses, LANES):
                lane_frames(poses, begin + chunk, begin + n_poses, skeleton, values, frames)
                for limb in range(n_limbs):
                    patch(table[limb], camera, frames[joints[limb]], patches[limb])
                    if present:
                        cover(table[limb], patches[limb], covers[limb], boxes[limb])
                _reset_sums(parent, chunk, n_children, n, lane_parents, starts, sums)
                for limb in range(n_limbs):
                    stored = previous_levels[limb, chunk * n : (chunk + LANES) * n]
                    previous, levels = stored if distinct else gathered, present_levels if present else stored
                    tested = not _to_local_pixels(patches[limb], camera, local, corners, fully_inside)
                    if tested:
                        flag_outside(patches[limb], samples, camera[WIDTH], camera[HEIGHT], flags)
                    if present:
                        tested |= _gather(
                            previous_levels[limb], states[limb], lane_parents, starts, distinct, previous, flags,
                            fully_inside,
                        )  # fmt: skip
                        _count_unflagged(flags, tested, inside)
                        if hiding:
                            tested |= flag_hidden(table, limb, samples, patches, covers, boxes, whole_limb, pair, flags)
                    if _count_unflagged(flags, tested, visible) > 0:
                        _sample(
                            local, corners, camera[WIDTH], samples32, flags, tested, image, previous_image,
                            index, fractions, words, levels, static if present else static[:0],
                        )  # fmt: skip
                    if present:
                        _add_differences(previous, present_levels, static, flags, tested, squares)
                        _add_limb(model, fully_inside, patches[limb], squares, inside, visible, n, sums)
                    else:
                        _store(patches[limb], flags, tested, fully_inside, chunk, levels, states[limb])
                    if tested:
                        _clear(flags)
                if present:
                    _write_sums(sums, block + chunk, min(LANES, n_poses - chunk), log_prob, outside)


@inlined
def _distinct_parents(poses: Any, first: int, n: int, parents: Any, parent: Any) -> int:
    """Write n poses (N, P) from `first` on without consecutive duplicates, and each pose's index among them; return
    their number."""
    distinct = -1
    for i in range(n):
        new = i == 0
        for p in range(poses.shape[1]):
            new |= i > 0 and poses[first + i, p] != poses[first + i - 1, p]
        if new:
            distinct += 1
            for p in range(poses.shape[1]):
                parents[distinct, p] = poses[first + i, p]
        parent[i] = distinct
    return distinct + 1


@inlined
def _reset_sums(parent: Any, chunk: int, n_children: int, n: int, lane_parents: Any, starts: Any, sums: Any) -> None:
    """Write the lanes' parents from child `chunk` on, where the parents' n levels begin, and empty sums."""
    for i in range(LANES):
        sums[i], sums[LANES + i], sums[2 * LANES + i] = 0.0, 1.0, 0.0
        lane_parents[i] = parent[min(chunk + i, n_children - 1)]
        starts[i] = lane_parents[i] // LANES * (n * LANES) + lane_parents[i] % LANES


@inlined
def _write_sums(sums: Any, first: int, n: int, log_prob: Any, outside: Any) -> None:
    for i in range(n):
        log_prob[first + i], outside[first + i] = sums[i] + np.log(sums[LANES + i]), sums[2 * LANES + i]


@inlined
def _clear(flags: Any) -> None:
    for i in range(flags.shape[0]):
        flags[i] = 0


@inlined
def _count_unflagged(flags: Any, some: bool, unmarked: Any) -> int:
    """Write the number of unflagged points of each lane; return their sum. some: whether any point is flagged."""
    for i in range(unmarked.shape[0]):
        unmarked[i] = flags.shape[0] // LANES
    if some:
        for k in range(flags.shape[0] // LANES):
            for i in range(unmarked.shape[0]):
                unmarked[i] -= 1 if flags[k * LANES + i] != 0 else 0
    total = 0
    for i in range(unmarked.shape[0]):
        total += unmarked[i]
    return total


@inlined
def _to_local_pixels(patch: Any, camera: Any, local: Any, corners: Any, fully_inside: Any) -> bool:
    """Write the patch in float32, relative to a pixel near its own corner; that pixel's index; and per lane whether the
    patch is between the centres of the image's pixels. Return whether all are."""
    width, height = camera[WIDTH], camera[HEIGHT]
    n = 0
    for i in range(LANES):
        x, dx, wx, ex = patch[i + AX], patch[i + DX], patch[i + WX], patch[i + EX]
        y, dy, wy, ey = patch[i + AY], patch[i + AY + DX], patch[i + AY + WX], patch[i + AY + EX]
        left, right = min(x - abs(wx), x + dx - abs(wx + ex)), max(x + abs(wx), x + dx + abs(wx + ex))
        top, bottom = min(y - abs(wy), y + dy - abs(wy + ey)), max(y + abs(wy), y + dy + abs(wy + ey))
        fully_inside[i] = 1 if (left >= 0.0) & (right < width - 1.0) & (top >= 0.0) & (bottom < height - 1.0) else 0
        n += fully_inside[i]
        column = np.floor(min(max(left, 0.0), width - 1.0))
        row = np.floor(min(max(top, 0.0), height - 1.0))
        corners[i] = np.int32(row * width + column)
        local[i + X], local[i + X + DX], local[i + X + WX], local[i + X + EX] = x - column, dx, wx, ex
        local[i + Y], local[i + Y + DX], local[i + Y + WX], local[i + Y + EX] = y - row, dy, wy, ey
    return n == LANES


@inlined
def _store(patch: Any, flags: Any, tested: bool, fully_inside: Any, chunk: int, levels: Any, states: Any) -> None:
    """Store the state, see NO_PATCH, of a limb of LANES parents from `chunk` on; flagged grey levels become NaN."""
    if tested:
        for j in range(levels.shape[0]):
            levels[j] = levels[j] if flags[j] == 0 else np.float32(np.nan)
    for i in range(LANES):
        state = FULLY_INSIDE if fully_inside[i] else PARTLY_OUTSIDE
        states[chunk + i] = NO_PATCH if patch[i + COSINE] <= 0.0 else state


@inlined
def _gather(
    previous_levels: Any, states: Any, lane_parents: Any, starts: Any, distinct: bool, levels: Any, flags: Any,
    patched: Any,
) -> bool:  # fmt: skip
    """Write the stored grey levels of each lane's parent, flag those outside, and write whether the parent's limb has a
    patch. Return whether any is flagged. distinct: `levels` are the stored ones, as every lane has its own parent."""
    n, some = levels.shape[0] // LANES, 0
    if not distinct:
        for k in range(n):
            for i in range(LANES):
                levels[k * LANES + i] = previous_levels[np.uint32(starts[i] + k * LANES)]
    for i in range(LANES):
        patched[i] = 0 if states[lane_parents[i]] == NO_PATCH else 1
        some += 0 if states[lane_parents[i]] == FULLY_INSIDE else 1
    if some > 0:
        for j in range(levels.shape[0]):
            flags[j] |= OUTSIDE if levels[j] != levels[j] else 0
    return some > 0


@inlined
def _sample(
    local: Any, corners: Any, width: float, samples: Any, flags: Any, tested: bool, image: Any, previous_image: Any,
    index: Any, fractions: Any, words: Any, levels: Any, static: Any,
) -> None:  # fmt: skip
    """Interpolate the grey levels of a limb's points and, unless `static` is empty, of the same pixels of the previous
    image."""
    u, v = samples[0], samples[1]
    for first in range(0, u.shape[0], BLOCK // LANES):
        n, at = min(BLOCK // LANES, u.shape[0] - first), first * LANES
        _indices(
            local, corners, width, u[first : first + n], v[first : first + n], flags[at:], tested, index, fractions
        )
        _load(image, index, words, n)
        _interpolate(words, fractions, n, levels[at:])
        if static.shape[0] > 0:
            _load(previous_image, index, words, n)
            _interpolate(words, fractions, n, static[at:])


@inlined
def _indices(
    local: Any, corners: Any, width: float, u: Any, v: Any, flags: Any, tested: bool, index: Any, fractions: Any
) -> None:
    """Phase 1: compute the indices of the points' neighbourhoods and the fractions within (rows x, y). Flagged points
    are moved into the image."""
    stride = np.int32(width)
    for k in range(u.shape[0]):
        a, b = u[k], v[k]
        for i in range(LANES):
            j = k * LANES + i
            x = local[i + X] + a * local[i + X + DX] + b * (local[i + X + WX] + a * local[i + X + EX])
            y = local[i + Y] + a * local[i + Y + DX] + b * (local[i + Y + WX] + a * local[i + Y + EX])
            if tested:
                x, y = x if flags[j] == 0 else np.float32(0.0), y if flags[j] == 0 else np.float32(0.0)
            column, row = np.int32(x), np.int32(y)
            fractions[j], fractions[BLOCK + j] = x - np.float32(column), y - np.float32(row)
            index[j] = np.uint32(np.int32(corners[i] + column) + np.int32(row * stride))


@inlined
def _load(image: Any, index: Any, words: Any, n: int) -> None:
    """Phase 2: load the neighbourhoods. The indices are unsigned, which avoids a test for negative ones."""
    for j in range(n * LANES):
        words[j] = image[index[j]]


@inlined
def _interpolate(words: Any, fractions: Any, n: int, levels: Any) -> None:
    """Phase 3: interpolate the grey levels of the points, in steps of GREY_STEP."""
    halves = words.view(np.uint32)
    for j in range(n * LANES):
        upper, lower, fx, fy = halves[2 * j], halves[2 * j + 1], fractions[j], fractions[BLOCK + j]
        a, b = np.float32(np.int32(upper & np.uint32(0xFFFF))), np.float32(np.int32(upper >> np.uint32(16)))
        c, d = np.float32(np.int32(lower & np.uint32(0xFFFF))), np.float32(np.int32(lower >> np.uint32(16)))
        top, bottom = a + fx * (b - a), c + fx * (d - c)
        levels[j] = top + fy * (bottom - top)


@inlined
def _add_differences(previous: Any, present: Any, static: Any, flags: Any, tested: bool, squares: Any) -> None:
    """Sum (2 rows) the squared differences over the unflagged points: between the images, and to the same pixel of the
    previous image, whose levels are `static`, unless that is empty."""
    for i in range(2 * LANES):
        squares[i] = 0.0
    for j in range(present.shape[0]):
        residual = present[j] - previous[j]
        if tested:
            residual = residual if flags[j] == 0 else np.float32(0.0)
        previous[j] = residual * residual
    for k in range(present.shape[0] // LANES):
        for i in range(LANES):
            squares[i] += previous[k * LANES + i]
    for k in range(static.shape[0] // LANES):
        for i in range(LANES):
            j = k * LANES + i
            residual = present[j] - static[j] if flags[j] == 0 else np.float32(0.0)
            squares[LANES + i] += residual * residual


@inlined
def _add_limb(model: Any, patched: Any, patch: Any, squares: Any, inside: Any, visible: Any, n: int, sums: Any) -> None:
    """Add a limb's term (A eq. 10–12). Rows of the sums: a part of the log likelihood, the product of the other
    likelihoods, and the number of points outside the images."""
    flat, peak = model.outlier_fraction / 256.0, (1.0 - model.outlier_fraction) / (np.sqrt(2.0 * np.pi) * model.sigma)
    for i in range(LANES):
        cos_alpha = patch[i + COSINE] if patched[i] else 0.0
        if cos_alpha == 0.0:
            sums[2 * LANES + i] += n
            _multiply(model.p_occluded, i, sums)
            continue
        sums[2 * LANES + i] += n - inside[i]
        n_mean = max(visible[i], 1) if model.mean else 1.0
        scale = model.effective_pixels * GREY_STEP**2 / (2.0 * model.sigma**2) / n_mean
        q, exponent = cos_alpha * visible[i] / n, scale * squares[i] * cos_alpha**2
        floor = q * flat + (1.0 - q) * model.p_occluded
        if floor > 0.0:
            _multiply(floor + q * peak * cos_alpha * np.exp(-exponent), i, sums)
        else:  # ε = 0 and q = 1: no lower bound of the Gaussian
            sums[i] += np.log(q * peak * cos_alpha) - exponent
        if model.static_background:  # minus the same for a static background, times the fraction of points compared
            exponent = scale * squares[LANES + i]
            ratio = np.log((flat + peak * np.exp(-exponent)) / (flat + peak)) if flat > 0.0 else -exponent
            sums[i] -= ratio * visible[i] / n


@inlined
def _multiply(p: float, i: int, sums: Any) -> None:
    if 1e-100 < p < 1e100:
        sums[LANES + i] *= p
        if 1e-200 < sums[LANES + i] < 1e200:
            return
        p = sums[LANES + i]
        sums[LANES + i] = 1.0
    sums[i] += np.log(p)


@kernel(error_model="numpy", fastmath=FAST)
def place_points(
    first: int, last: int, table: Any, joints: Any, samples: Any, ends: Any, camera: Any, rotations: Any,
    positions: Any, outside: bool, pixels: Any, valid: Any, azimuths: Any,
) -> None:  # fmt: skip
    """Place several sets of points; set r has the samples from ends[r] to ends[r + 1] and is contiguous in pixels (N ·
    L · n, 2) and valid (N · L · n,)."""
    (n_poses, n_limbs), n = azimuths.shape, samples.shape[1]
    patches, covers, boxes = np.empty((n_limbs, PATCH)), np.empty((n_limbs, COVER)), np.empty((n_limbs, 6))
    frames, pair = np.empty((positions.shape[1], FRAME)), np.empty(PAIR)
    flags = np.empty(n * LANES, dtype=np.int32)
    for chunk in range(first, last, LANES):
        load_frames(rotations, positions, chunk, frames)
        for limb in range(n_limbs):
            patch(table[limb], camera, frames[joints[limb]], patches[limb])
            cover(table[limb], patches[limb], covers[limb], boxes[limb])
        for limb in range(n_limbs):
            _clear(flags)
            if outside:
                flag_covered(table, limb, samples, patches, covers, pair, flags)
            else:
                flag_hidden(table, limb, samples, patches, covers, boxes, False, pair, flags)
            for i in range(min(LANES, last - chunk)):
                for r in range(ends.shape[0] - 1):
                    begin, end = ends[r], ends[r + 1]
                    to = n_poses * n_limbs * begin + ((chunk + i) * n_limbs + limb) * (end - begin)
                    points = samples[:, begin:end]
                    _write_points(patches[limb], i, points, camera, flags[begin * LANES :], pixels[to:], valid[to:])
                azimuth = np.arctan2(patches[limb, ACROSS + LANES + i], patches[limb, ACROSS + i])
                azimuths[chunk + i, limb] = azimuth if patches[limb, COSINE + i] > 0.0 else 0.0


@inlined
def _write_points(patch: Any, i: int, samples: Any, camera: Any, flags: Any, pixels: Any, valid: Any) -> None:
    """Write the points of lane i, and whether they are valid."""
    for k in range(samples.shape[1]):
        pixels[k, 0], pixels[k, 1] = place(patch, i, samples[0, k], samples[1, k])
        x, y = pixels[k, 0], pixels[k, 1]  # rounded to float32, as when they are interpolated
        inside = x >= 0.0 and x < camera[WIDTH] - 1.0 and y >= 0.0 and y < camera[HEIGHT] - 1.0
        valid[k] = patch[i + COSINE] > 0.0 and inside and flags[k * LANES + i] == 0
