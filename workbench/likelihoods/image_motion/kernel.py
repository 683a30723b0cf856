"""The fused kernel of the image-motion likelihood, LANES particles at once; `tests/oracles/image_motion.py` defines it.

Particles are independent, each writes its own slot only, and no sum crosses particles: the number of threads cannot
change a bit of the result, nor can the other particles. What makes it fast:

- Lanes. Kinematics, patches, occlusion, interpolation: one particle a lane, see `workbench.body.simd_kinematics`.
- Lookups in three phases, a block of points at a time: vector instructions find the indices, plain loads fetch the
  pixels, vector instructions interpolate. The loads are all that is done one by one.
- Packed neighbourhoods: one word of 64 bits holds a pixel and its right, lower and lower right neighbours, so that a
  point costs one load and not four. Grey levels are rounded to 255/65535.
- Small coordinates. What is decided (inside? hidden?) is decided in float64. The lookup counts pixels from the patch's
  own corner, where float32 is good to 1e-5 px, and vectors hold twice as many.
- What particles share is looked up once: children of one parent lie side by side after resampling, and have the same
  pose before. With four children a parent this saves a sixth of the time.
- Tests beforehand, for all lanes at once: a limb that lies in both images, and that no other limb may hide, has no
  point to test; one of which no point is seen is not looked up.
- One logarithm a particle: the limbs' likelihoods are multiplied as long as their product is safe from underflow.

The inner functions take plain arrays, with named rows: an array in a tuple is reference-counted at every call.
"""

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from workbench.body.camera import Camera
from workbench.body.limbs import Body, Limbs
from workbench.body.simd_kinematics import FAST, FRAME, LANES, inlined, lane_frames, load_frames
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
    mark_covered,
    mark_hidden,
    mark_outside,
    patch,
    place,
)  # fmt: skip
from workbench.utils.arrays import Float32Array, FloatArray, IntArray
from workbench.utils.kernel_cache import kernel
from workbench.utils.parallel import over_threads

Reduction = Literal["mean", "sum"]
Occlusion = Literal["sample", "limb", "none"]
Background = Literal["none", "static"]
Packed: TypeAlias = NDArray[np.uint64]


@dataclass(frozen=True)
class LimbModel:
    """The constants of A eq. 10 and 11; `ImageMotion` documents and checks them."""

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


GREY_STEP = 255.0 / 65535.0  # grey levels between neighbouring levels of a packed image
BLOCK = 25 * LANES
"""Points whose lookups are under way together; their work space shares the first-level cache with the pixels."""

SHARED = 16 * LANES
"""Particles among which equal poses before are looked up once; what is kept of these fits into the second-level
cache."""

NO_PATCH, PARTLY_OUTSIDE, WHOLE = range(3)  # what is known of a limb in the image before
NO_OCCLUSION, SAMPLE_OCCLUSION, LIMB_OCCLUSION = range(3)
WIDTH, HEIGHT = 21, 22  # columns of a camera, after those that patches use
X, Y, LOCAL = 0, 4 * LANES, 8 * LANES
"""Rows of a patch for the lookups: those from AX and those from AY, in float32, counted from a pixel of the image."""


class _Model(NamedTuple):
    """`LimbModel` as numbers."""

    sigma: float
    outlier_fraction: float
    p_occluded: float
    mean: bool
    effective_pixels: float
    occlusion: int
    still_background: bool


def view_log_prob(
    body: Body, samples: FloatArray, model: LimbModel, before: PackedView, now: PackedView
) -> tuple[FloatArray, IntArray]:
    """Return log p(I_t | φ_t, φ_t−1, I_t−1) of one camera (N,), and the number of points outside the images (N,), on as
    many threads as numba is set to. samples: points (n, 2) of every patch. With a still background, both images are of
    one size."""
    n, skeleton = len(now.poses), body.skeleton
    log_prob, outside = np.empty(n), np.empty(n, dtype=np.int64)
    occlusion = {"none": NO_OCCLUSION, "sample": SAMPLE_OCCLUSION, "limb": LIMB_OCCLUSION}[model.occlusion]
    numbers = (model.sigma, model.outlier_fraction, model.p_occluded, model.effective_pixels)
    sigma, outlier_fraction, p_occluded, effective_pixels = map(float, numbers)  # whole numbers would compile anew
    arguments = (
        (skeleton.parents, skeleton.offsets, skeleton.dof_joints, skeleton.dof_axes),
        *(limb_table(body.limbs), body.limbs.joints, sample_rows(samples), sample_rows(samples).astype(np.float32)),
        _Model(
            sigma,
            outlier_fraction,
            p_occluded,
            model.reduction == "mean",
            effective_pixels,
            occlusion,
            model.background == "static",
        ),
        np.stack([before.camera.row, now.camera.row]),
        *(before.image.ravel(), np.ascontiguousarray(before.poses)),
        *(now.image.ravel(), np.ascontiguousarray(now.poses)),
        *(log_prob, outside),
    )
    over_threads(lambda first, last: _run(first, last, *arguments), n, LANES)
    return log_prob, outside


def packed(image: Float32Array) -> Packed:
    """Words (height, width) of four grey levels 0..255, 16 bits each, lowest first: the pixel, its right neighbour,
    the one below, and that one's right neighbour. The last row and column are their own neighbours."""
    words = np.empty(image.shape, dtype=np.uint64)
    _pack(image, words)
    return words


def sample_rows(samples: FloatArray) -> FloatArray:
    """Return points (n, 2) as the kernel takes them, (2, n)."""
    return np.ascontiguousarray(samples.T)


def limb_table(limbs: Limbs) -> FloatArray:
    """Return the limbs as the kernel takes them, (L, 12): see the columns of `patches`."""
    radii, thickness = limbs.radii.reshape(-1, 4), limbs.radii.mean(axis=(1, 2))
    return np.column_stack([limbs.starts, limbs.ends, radii, limbs.spheres.astype(np.float64), thickness])


@kernel()
def _pack(image: Any, words: Any) -> None:
    height, width = image.shape
    levels = np.empty((2, width + 1), dtype=np.uint64)  # of two lines
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
    cameras: Any, image_before: Any, poses_before: Any, image_now: Any, poses_now: Any, log_prob: Any, outside: Any,
) -> None:  # fmt: skip
    """Particles `first` to `last`, SHARED at a time: of these the different poses before, then the poses now. Both go
    LANES at a time through one place in the code, which compiles faster than two; the last one fills the lanes left."""
    n_limbs, n, n_dofs = joints.shape[0], samples.shape[1], poses_now.shape[1]
    patches, covers = np.empty((n_limbs, PATCH)), np.empty((n_limbs, COVER))
    boxes, pair, marks = np.empty((n_limbs, 6)), np.empty(PAIR), np.zeros(n * LANES, dtype=np.int32)
    frames, values = np.empty((skeleton[0].shape[0], FRAME)), np.empty((n_dofs + 9) * LANES)
    # The different poses before, which of them is each child's, and what is known of their limbs in the image before.
    parents, parent = np.empty((SHARED, n_dofs)), np.empty(SHARED, dtype=np.int32)
    known, states = np.empty((n_limbs, SHARED * n), dtype=np.float32), np.empty((n_limbs, SHARED), dtype=np.int32)
    # Of one limb: where its patch is, and per lane: is it wholly inside, whose child is it, how many points are seen?
    local, lanes = np.empty(LOCAL, dtype=np.float32), np.empty((6, LANES), dtype=np.int32)
    corners, whole, family, starts, inside, seen = lanes[0], lanes[1], lanes[2], lanes[3], lanes[4], lanes[5]
    # Of its points: grey levels in the image before, in that of now, and in that before at the place of now.
    index, words = np.empty(BLOCK, dtype=np.uint32), np.empty(BLOCK, dtype=np.uint64)
    fractions, recalled = np.empty(2 * BLOCK, dtype=np.float32), np.empty(n * LANES, dtype=np.float32)
    there, still = np.empty(n * LANES, dtype=np.float32), np.empty(n * LANES * model.still_background, dtype=np.float32)
    squares, sums = np.zeros(2 * LANES), np.empty(3 * LANES)
    hiding, rule = model.occlusion != NO_OCCLUSION, model.occlusion == LIMB_OCCLUSION
    for block in range(first, last, SHARED):
        n_children = min(SHARED, last - block)
        n_parents = _tell_parents(poses_before[block : block + n_children], parents, parent)
        distinct = n_parents == n_children
        for now in range(2):
            image, poses = (image_now, poses_now[block:last]) if now else (image_before, parents)
            n_poses, camera = n_children if now else n_parents, cameras[now]
            for chunk in range(0, n_poses, LANES):
                lane_frames(poses[:n_poses], chunk, skeleton, values, frames)
                _place_limbs(table, joints, camera, frames, now == 1, patches, covers, boxes)
                _begin(parent[:n_children], chunk, n, family, starts, sums)
                for limb in range(n_limbs):
                    tested = not _localise(patches[limb], camera, local, corners, whole)
                    if tested:
                        mark_outside(patches[limb], samples, camera[WIDTH], camera[HEIGHT], marks)
                    if now:
                        before = known[limb, chunk * n : (chunk + LANES) * n] if distinct else recalled
                        tested |= _recall(known[limb], states[limb], family, starts, distinct, before, marks, whole)
                        _count(marks, tested, inside)
                        if hiding:
                            tested |= mark_hidden(table, limb, samples, patches, covers, boxes, rule, pair, marks)
                    levels = there if now else known[limb, chunk * n : (chunk + LANES) * n]
                    if _count(marks, tested, seen) > 0:
                        _look_up(
                            local, corners, camera[WIDTH], samples32, marks, tested, image, image_before,
                            index, fractions, words, levels, still if now else still[:0],
                        )  # fmt: skip
                    if now:
                        _add_differences(before, there, still, marks, tested, squares)
                        _add_limb(model, whole, patches[limb], squares, inside, seen, n, sums)
                    else:
                        _keep(patches[limb], marks, tested, whole, chunk, levels, states[limb])
                    if tested:
                        _clear(marks)
                if now:
                    done = slice(block + chunk, min(block + chunk + LANES, last))
                    _end(sums, log_prob[done], outside[done])


@inlined
def _tell_parents(poses: Any, parents: Any, parent: Any) -> int:
    """Write the poses (N, P) without repetitions in a row, and which of these each of them is; their number."""
    n = -1
    for i in range(poses.shape[0]):
        new = i == 0
        for p in range(poses.shape[1]):
            new |= i > 0 and poses[i, p] != poses[i - 1, p]
        if new:
            n += 1
            for p in range(poses.shape[1]):
                parents[n, p] = poses[i, p]
        parent[i] = n
    return n + 1


@inlined
def _place_limbs(
    table: Any, joints: Any, camera: Any, frames: Any, cover_too: bool, patches: Any, covers: Any, boxes: Any
) -> None:
    for limb in range(joints.shape[0]):
        patch(table[limb], camera, frames[joints[limb]], patches[limb])
        if cover_too:
            cover(table[limb], patches[limb], covers[limb], boxes[limb])


@inlined
def _begin(parent: Any, chunk: int, n: int, family: Any, starts: Any, sums: Any) -> None:
    """Write the parents of the lanes from child `chunk` on, where what is known of them starts, and empty sums."""
    for i in range(LANES):
        sums[i], sums[LANES + i], sums[2 * LANES + i] = 0.0, 1.0, 0.0
        family[i] = parent[min(chunk + i, parent.shape[0] - 1)]
        starts[i] = family[i] // LANES * (n * LANES) + family[i] % LANES


@inlined
def _end(sums: Any, log_prob: Any, outside: Any) -> None:
    for i in range(log_prob.shape[0]):
        log_prob[i], outside[i] = sums[i] + np.log(sums[LANES + i]), sums[2 * LANES + i]


@inlined
def _clear(marks: Any) -> None:
    for i in range(marks.shape[0]):
        marks[i] = 0


@inlined
def _count(marks: Any, some: bool, unmarked: Any) -> int:
    """Write how many points of each lane are not marked; how many in all. some: whether any is marked."""
    for i in range(unmarked.shape[0]):
        unmarked[i] = marks.shape[0] // LANES
    if some:
        for k in range(marks.shape[0] // LANES):
            for i in range(unmarked.shape[0]):
                unmarked[i] -= 1 if marks[k * LANES + i] != 0 else 0
    total = 0
    for i in range(unmarked.shape[0]):
        total += unmarked[i]
    return total


@inlined
def _localise(patch: Any, camera: Any, local: Any, corners: Any, whole: Any) -> bool:
    """Write the patch as float32, from a pixel of the image near its own corner; that pixel's index; and per lane
    whether the patch lies between the centres of the image's pixels. True if all do."""
    width, height = camera[WIDTH], camera[HEIGHT]
    n = 0
    for i in range(LANES):
        x, dx, wx, ex = patch[i + AX], patch[i + DX], patch[i + WX], patch[i + EX]
        y, dy, wy, ey = patch[i + AY], patch[i + AY + DX], patch[i + AY + WX], patch[i + AY + EX]
        left, right = min(x - abs(wx), x + dx - abs(wx + ex)), max(x + abs(wx), x + dx + abs(wx + ex))
        top, bottom = min(y - abs(wy), y + dy - abs(wy + ey)), max(y + abs(wy), y + dy + abs(wy + ey))
        whole[i] = 1 if (left >= 0.0) & (right < width - 1.0) & (top >= 0.0) & (bottom < height - 1.0) else 0
        n += whole[i]
        column = np.floor(min(max(left, 0.0), width - 1.0))
        row = np.floor(min(max(top, 0.0), height - 1.0))
        corners[i] = np.int32(row * width + column)
        local[i + X], local[i + X + DX], local[i + X + WX], local[i + X + EX] = x - column, dx, wx, ex
        local[i + Y], local[i + Y + DX], local[i + Y + WX], local[i + Y + EX] = y - row, dy, wy, ey
    return n == LANES


@inlined
def _keep(patch: Any, marks: Any, tested: bool, whole: Any, chunk: int, levels: Any, states: Any) -> None:
    """Keep the state, see NO_PATCH, of a limb of LANES parents from `chunk` on; marked grey levels become NaN."""
    if tested:
        for j in range(levels.shape[0]):
            levels[j] = levels[j] if marks[j] == 0 else np.float32(np.nan)
    for i in range(LANES):
        states[chunk + i] = NO_PATCH if patch[i + COSINE] <= 0.0 else WHOLE if whole[i] else PARTLY_OUTSIDE


@inlined
def _recall(
    known: Any, states: Any, family: Any, starts: Any, distinct: bool, levels: Any, marks: Any, patched: Any
) -> bool:
    """Write the grey levels that were kept of each lane's parent, mark those outside, and write whether the parent's
    limb has a patch. True if any is marked. distinct: the levels are those kept, as every lane has its own parent."""
    n, some = levels.shape[0] // LANES, 0
    if not distinct:
        for k in range(n):
            for i in range(LANES):
                levels[k * LANES + i] = known[np.uint32(starts[i] + k * LANES)]
    for i in range(LANES):
        patched[i] = 0 if states[family[i]] == NO_PATCH else 1
        some += 0 if states[family[i]] == WHOLE else 1
    if some > 0:
        for j in range(levels.shape[0]):
            marks[j] |= OUTSIDE if levels[j] != levels[j] else 0
    return some > 0


@inlined
def _look_up(
    local: Any, corners: Any, width: float, samples: Any, marks: Any, tested: bool, image: Any, image_before: Any,
    index: Any, fractions: Any, words: Any, levels: Any, still: Any,
) -> None:  # fmt: skip
    """The grey levels of a limb's points, and, where `still` is not empty, of the same pixels of the image before."""
    u, v = samples[0], samples[1]
    for first in range(0, u.shape[0], BLOCK // LANES):
        n, at = min(BLOCK // LANES, u.shape[0] - first), first * LANES
        _indices(
            local, corners, width, u[first : first + n], v[first : first + n], marks[at:], tested, index, fractions
        )
        _fetch(image, index, words, n)
        _interpolate(words, fractions, n, levels[at:])
        if still.shape[0] > 0:
            _fetch(image_before, index, words, n)
            _interpolate(words, fractions, n, still[at:])


@inlined
def _indices(
    local: Any, corners: Any, width: float, u: Any, v: Any, marks: Any, tested: bool, index: Any, fractions: Any
) -> None:
    """Phase 1: where the points' neighbourhoods are, and where the points are within (rows x, y). Marked ones are
    moved into the image."""
    stride = np.int32(width)
    for k in range(u.shape[0]):
        a, b = u[k], v[k]
        for i in range(LANES):
            j = k * LANES + i
            x = local[i + X] + a * local[i + X + DX] + b * (local[i + X + WX] + a * local[i + X + EX])
            y = local[i + Y] + a * local[i + Y + DX] + b * (local[i + Y + WX] + a * local[i + Y + EX])
            if tested:
                x, y = x if marks[j] == 0 else np.float32(0.0), y if marks[j] == 0 else np.float32(0.0)
            column, row = np.int32(x), np.int32(y)
            fractions[j], fractions[BLOCK + j] = x - np.float32(column), y - np.float32(row)
            index[j] = np.uint32(np.int32(corners[i] + column) + np.int32(row * stride))


@inlined
def _fetch(image: Any, index: Any, words: Any, n: int) -> None:
    """Phase 2: the neighbourhoods themselves. The indices are unsigned, which spares a test for negative ones."""
    for j in range(n * LANES):
        words[j] = image[index[j]]


@inlined
def _interpolate(words: Any, fractions: Any, n: int, levels: Any) -> None:
    """Phase 3: the grey levels of the points, in steps of GREY_STEP."""
    halves = words.view(np.uint32)
    for j in range(n * LANES):
        upper, lower, fx, fy = halves[2 * j], halves[2 * j + 1], fractions[j], fractions[BLOCK + j]
        a, b = np.float32(np.int32(upper & np.uint32(0xFFFF))), np.float32(np.int32(upper >> np.uint32(16)))
        c, d = np.float32(np.int32(lower & np.uint32(0xFFFF))), np.float32(np.int32(lower >> np.uint32(16)))
        top, bottom = a + fx * (b - a), c + fx * (d - c)
        levels[j] = top + fy * (bottom - top)


@inlined
def _add_differences(before: Any, now: Any, still: Any, marks: Any, tested: bool, squares: Any) -> None:
    """Sums (2 rows) of the squared differences over the points that are not marked: between the images, and to the same
    pixel of the image before, of which `still` holds the levels or nothing."""
    for i in range(2 * LANES):
        squares[i] = 0.0
    for j in range(now.shape[0]):
        residual = now[j] - before[j]
        if tested:
            residual = residual if marks[j] == 0 else np.float32(0.0)
        before[j] = residual * residual
    for k in range(now.shape[0] // LANES):
        for i in range(LANES):
            squares[i] += before[k * LANES + i]
    for k in range(still.shape[0] // LANES):
        for i in range(LANES):
            j = k * LANES + i
            residual = now[j] - still[j] if marks[j] == 0 else np.float32(0.0)
            squares[LANES + i] += residual * residual


@inlined
def _add_limb(model: Any, patched: Any, patch: Any, squares: Any, inside: Any, seen: Any, n: int, sums: Any) -> None:
    """Count a limb in (A eq. 10–12). Rows of the sums: a part of the log likelihood, the product of likelihoods whose
    logarithm is the rest, and how many points lay outside the images."""
    flat, peak = model.outlier_fraction / 256.0, (1.0 - model.outlier_fraction) / (np.sqrt(2.0 * np.pi) * model.sigma)
    for i in range(LANES):
        cos_alpha = patch[i + COSINE] if patched[i] else 0.0
        if cos_alpha == 0.0:
            sums[2 * LANES + i] += n
            _multiply(model.p_occluded, i, sums)
            continue
        sums[2 * LANES + i] += n - inside[i]
        scale = (
            model.effective_pixels * GREY_STEP**2 / (2.0 * model.sigma**2) / (max(seen[i], 1) if model.mean else 1.0)
        )
        q, exponent = cos_alpha * seen[i] / n, scale * squares[i] * cos_alpha**2
        floor = q * flat + (1.0 - q) * model.p_occluded
        if floor > 0.0:
            _multiply(floor + q * peak * cos_alpha * np.exp(-exponent), i, sums)
        else:  # ε = 0 and q = 1: no floor under the Gaussian
            sums[i] += np.log(q * peak * cos_alpha) - exponent
        if model.still_background:  # less the same for a background that stands still, as a share of where it does
            exponent = scale * squares[LANES + i]
            ratio = np.log((flat + peak * np.exp(-exponent)) / (flat + peak)) if flat > 0.0 else -exponent
            sums[i] -= ratio * seen[i] / n


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
    positions: Any, beside: bool, pixels: Any, counts: Any, turns: Any,
) -> None:  # fmt: skip
    """Several sets of points at once: those of set r are the samples from ends[r] to ends[r + 1]. Every set lies in one
    piece in pixels (N · L · n, 2) and counts (N · L · n,)."""
    (n_poses, n_limbs), n = turns.shape, samples.shape[1]
    patches, covers, boxes = np.empty((n_limbs, PATCH)), np.empty((n_limbs, COVER)), np.empty((n_limbs, 6))
    frames, pair = np.empty((positions.shape[1], FRAME)), np.empty(PAIR)
    marks = np.empty(n * LANES, dtype=np.int32)
    for chunk in range(first, last, LANES):
        load_frames(rotations, positions, chunk, frames)
        for limb in range(n_limbs):
            patch(table[limb], camera, frames[joints[limb]], patches[limb])
            cover(table[limb], patches[limb], covers[limb], boxes[limb])
        for limb in range(n_limbs):
            _clear(marks)
            if beside:
                mark_covered(table, limb, samples, patches, covers, pair, marks)
            else:
                mark_hidden(table, limb, samples, patches, covers, boxes, False, pair, marks)
            for i in range(min(LANES, last - chunk)):
                for r in range(ends.shape[0] - 1):
                    begin, end = ends[r], ends[r + 1]
                    to = n_poses * n_limbs * begin + ((chunk + i) * n_limbs + limb) * (end - begin)
                    places, count = pixels[to : to + end - begin], counts[to : to + end - begin]
                    _write_points(
                        patches[limb], i, samples[:, begin:end], camera, marks[begin * LANES :], places, count
                    )
                turn = np.arctan2(patches[limb, ACROSS + LANES + i], patches[limb, ACROSS + i])
                turns[chunk + i, limb] = turn if patches[limb, COSINE + i] > 0.0 else 0.0


@inlined
def _write_points(patch: Any, i: int, samples: Any, camera: Any, marks: Any, pixels: Any, counts: Any) -> None:
    """Write the points of lane i, and whether they count."""
    for k in range(samples.shape[1]):
        pixels[k, 0], pixels[k, 1] = place(patch, i, samples[0, k], samples[1, k])
        x, y = pixels[k, 0], pixels[k, 1]  # rounded, as they will be looked up
        inside = x >= 0.0 and x < camera[WIDTH] - 1.0 and y >= 0.0 and y < camera[HEIGHT] - 1.0
        counts[k] = patch[i + COSINE] > 0.0 and inside and marks[k * LANES + i] == 0
