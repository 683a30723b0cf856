"""Points on and beside the limbs as a camera sees them, the images there, and likelihoods that look at them."""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, TypeAlias

import numba
import numpy as np

from workbench.body.camera import Camera
from workbench.body.kinematics import JointFrames, forward
from workbench.body.limbs import Body
from workbench.body.simd_kinematics import FAST, LANES, inlined
from workbench.core.likelihood import Evaluation, Likelihood
from workbench.likelihoods.base import among_finite, finite_rows, those
from workbench.likelihoods.image_motion.kernel import limb_table, place_points, sample_rows
from workbench.utils.arrays import BoolArray, Float32Array, FloatArray
from workbench.utils.kernel_cache import kernel
from workbench.utils.parallel import parallel_for

Box: TypeAlias = tuple[int, int, int, int]  # of an image: its first column and row, and those after its last, px


@dataclass(frozen=True, eq=False)
class LimbPoints:
    """n points on each of L limbs in N poses. pixels: (N, L, n, 2), px. counts: (N, L, n), which of them to look at.
    turns: (N, L), rad, the azimuth about the limb, in its joint's frame, of its side at v = 1."""

    pixels: Float32Array
    counts: BoolArray
    turns: FloatArray


def limb_points(
    body: Body, samples: FloatArray, camera: Camera, frames: JointFrames, beside: bool = False
) -> LimbPoints:
    """Place points (n, 2) of every patch, u along and v across it; those in the image count that no other limb hides by
    the rule "sample" of `ImageMotion`, or, `beside` it, |v| > 1, that no limb covers at any depth."""
    (points,) = limb_points_of_all(body, [samples], camera, frames, beside)
    return points


def limb_points_of_all(
    body: Body, samples: Sequence[FloatArray], camera: Camera, frames: JointFrames, beside: bool = False
) -> list[LimbPoints]:
    """Place several sets of points as `limb_points` does each: where the limbs are, and which may hide which, is found
    once."""
    ends = np.cumsum([0, *map(len, samples)])
    shape = (len(frames.positions), len(body.limbs))
    rows = ends * shape[0] * shape[1]
    pixels, counts, turns = np.empty((rows[-1], 2), np.float32), np.empty(rows[-1], np.bool_), np.empty(shape)
    arguments = (
        *(limb_table(body.limbs), body.limbs.joints, sample_rows(np.concatenate(samples)), ends, camera.row),
        *(frames.rotations, frames.positions, beside, pixels, counts, turns),
    )
    parallel_for(lambda first, last: place_points(first, last, *arguments), len(turns), LANES)
    return [
        LimbPoints(pixels[first:last].reshape(*shape, n, 2), counts[first:last].reshape(*shape, n), turns)
        for n, (first, last) in zip(map(len, samples), pairwise(rows), strict=True)
    ]


def patch_grid(u: FloatArray, v: FloatArray) -> FloatArray:
    """The points (U·V, 2) of a grid on the patch, v running fastest."""
    return np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)


def mean_at(image: Float32Array, points: LimbPoints) -> FloatArray:
    """The image's values at the points that count, summed for each limb (N, L) and divided by n: hidden ones add 0."""
    sums = np.empty(points.counts.shape[:2])
    _sum_at(image, points.pixels, points.counts, sums)
    return sums / points.counts.shape[2]


def levels_at(image: Float32Array, pixels: Float32Array) -> FloatArray:
    """The image's values (M,) at pixels (M, 2) inside it."""
    levels = np.empty(len(pixels))
    _levels_at(image, pixels, levels)
    return levels


def looked_up(points: LimbPoints) -> Box:
    """The least box with all pixels that interpolation needs at the points that count; of one pixel where none does."""
    bounds = np.empty((4, len(points.counts)), dtype=np.float32)
    _bounds(points.pixels, points.counts, bounds)
    left, top = (int(low) if np.isfinite(low) else 0 for low in bounds[:2].min(axis=1, initial=np.inf))
    right, bottom = (max(int(high) + 2, 1) for high in bounds[2:].max(axis=1, initial=-1.0))
    return left, top, right, bottom


@kernel(parallel=True, error_model="numpy", fastmath=FAST)
def _sum_at(image: Any, pixels: Any, counts: Any, sums: Any) -> None:
    for i in numba.prange(counts.shape[0]):
        for limb in range(counts.shape[1]):
            total = 0.0
            for s in range(counts.shape[2]):
                if counts[i, limb, s]:
                    total += bilinear(image, pixels[i, limb, s, 0], pixels[i, limb, s, 1])
            sums[i, limb] = total


@kernel(parallel=True, error_model="numpy", fastmath=FAST)
def _bounds(pixels: Any, counts: Any, bounds: Any) -> None:
    for i in numba.prange(counts.shape[0]):
        left = top = np.float32(np.inf)
        right = bottom = np.float32(-1.0)
        for limb in range(counts.shape[1]):
            for s in range(counts.shape[2]):
                x, y = pixels[i, limb, s, 0], pixels[i, limb, s, 1]
                if counts[i, limb, s]:
                    left, top, right, bottom = min(left, x), min(top, y), max(right, x), max(bottom, y)
        bounds[0, i], bounds[1, i], bounds[2, i], bounds[3, i] = left, top, right, bottom


@kernel(error_model="numpy", fastmath=FAST)
def _levels_at(image: Any, pixels: Any, levels: Any) -> None:
    for i in range(levels.shape[0]):
        levels[i] = bilinear(image, pixels[i, 0], pixels[i, 1])


@inlined
def bilinear(image: Any, x: float, y: float) -> Any:
    """The value of the image at a point between the centres of its pixels."""
    column, row = np.uint32(x), np.uint32(y)  # unsigned indices spare numba's test for negative ones
    right, below = np.uint32(column + np.uint32(1)), np.uint32(row + np.uint32(1))
    fx, fy = np.float32(x - column), np.float32(y - row)
    top = image[row, column] + fx * (image[row, right] - image[row, column])
    bottom = image[below, column] + fx * (image[below, right] - image[below, column])
    return top + fy * (bottom - top)


@dataclass(frozen=True, eq=False)
class ViewJudge:
    """What judges poses by one view. samples: points (n, 2) of every patch. judge: gives log likelihoods (N,) from
    where these lie in N poses and, where there are some, from `beside`, points (n, 2) about the patches."""

    camera: Camera
    samples: FloatArray
    judge: Callable[..., FloatArray]
    beside: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class LimbLook:
    """A `PoseLook` by which the views of a frame judge where the limbs are seen; their log likelihoods add up."""

    name: str
    body: Body
    informative: Sequence[ViewJudge]
    then: Callable[[FloatArray], Likelihood]
    notes: tuple[str, ...] = ()
    diagnostics: Mapping[str, float] = field(default_factory=dict)

    def evaluate(self, previous_pose: FloatArray, pose: FloatArray) -> Evaluation:
        """Log likelihoods (N,) of poses (N, P), −∞ and a note for those not finite; the previous ones do not matter."""
        return evaluate_together([self], pose)[0]

    def update(self, expected_pose: FloatArray) -> Likelihood:
        """The likelihood of the next frame."""
        return self.then(expected_pose)


def evaluate_together(frame_likelihoods: Sequence[LimbLook], pose: FloatArray) -> list[Evaluation]:
    """What each look at one body finds of poses (N, P) by itself."""
    finite = finite_rows(pose)
    frames = forward(frame_likelihoods[0].body.skeleton, those(pose, finite))
    informative = [judge for frame_likelihood in frame_likelihoods for judge in frame_likelihood.informative]
    placed = dict(zip(map(id, informative), _placed(frame_likelihoods[0].body, informative, frames), strict=True))
    n, evaluations = len(frames.positions), []
    for frame_likelihood in frame_likelihoods:
        log_prob = sum((judge.judge(*placed[id(judge)]) for judge in frame_likelihood.informative), np.zeros(n))
        evaluations.append(among_finite(frame_likelihood.name, finite, log_prob))
    return evaluations


def _placed(body: Body, informative: Sequence[ViewJudge], frames: JointFrames) -> list[list[LimbPoints]]:
    """The points that each judge asks for, placed in one pass a camera, and another beside the limbs."""
    asked: dict[tuple[int, bool], list[tuple[int, ViewJudge, FloatArray]]] = defaultdict(list)
    for i, judge in enumerate(informative):
        asked[id(judge.camera), False].append((i, judge, judge.samples))
        if judge.beside is not None:
            asked[id(judge.camera), True].append((i, judge, judge.beside))
    placed: list[list[LimbPoints]] = [[] for _ in informative]
    for beside in (False, True):
        for (_, aside), wanted in asked.items():
            if aside == beside:
                camera = wanted[0][1].camera
                points = limb_points_of_all(body, [samples for *_, samples in wanted], camera, frames, beside)
                for (i, *_), each in zip(wanted, points, strict=True):
                    placed[i].append(each)
    return placed
