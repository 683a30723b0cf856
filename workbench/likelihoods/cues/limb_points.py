"""Points on and just outside the limbs in an image, image values there, and the frame likelihoods based on them."""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np

from workbench.body.kinematics import JointFrames, forward
from workbench.body.limbs import Body
from workbench.body.simd_kinematics import FAST, LANES, inlined
from workbench.cameras.camera import Camera
from workbench.core.likelihood import Evaluation, Likelihood
from workbench.likelihoods.base import expand_finite, finite_rows, select_finite
from workbench.likelihoods.image_motion.kernel import limb_table, place_points, sample_rows
from workbench.utils.arrays import BoolArray, Float32Array, FloatArray
from workbench.utils.kernel_cache import kernel
from workbench.utils.parallel import parallel_for

Box: TypeAlias = tuple[int, int, int, int]  # of an image: its first column and row, and those after its last, px
PARTICLES = 64  # fewest per thread


@dataclass(frozen=True, eq=False)
class LimbPoints:
    """n points on each of L limbs in N poses. pixels: (N, L, n, 2), px. valid: (N, L, n), the points to use. azimuths:
    (N, L), rad, about the limb, in its joint's frame, of its side at v = 1."""

    pixels: Float32Array
    valid: BoolArray
    azimuths: FloatArray


def limb_points(
    body: Body, samples: FloatArray, camera: Camera, frames: JointFrames, outside: bool = False
) -> LimbPoints:
    """Place points (n, 2) of every patch, u along it and v across it.

    Parameters
    ----------
    body, samples, camera : the body, the points (n, 2) and the camera.
    frames : of the joints in N poses.
    outside : False: points inside the image are valid if no other limb hides them by the rule "sample" of
        `ImageMotion`; True, for points off the limb, |v| > 1: if no limb covers them at any depth.
    """
    (points,) = limb_point_sets(body, [samples], camera, frames, outside)
    return points


def limb_point_sets(
    body: Body, samples: Sequence[FloatArray], camera: Camera, frames: JointFrames, outside: bool = False
) -> list[LimbPoints]:
    """Place several sets of points as `limb_points` does each; the limbs' patches and their occlusions are computed
    once."""
    ends = np.cumsum([0, *map(len, samples)])
    shape = (len(frames.positions), len(body.limbs))
    rows = ends * shape[0] * shape[1]
    pixels, valid, azimuths = np.empty((rows[-1], 2), np.float32), np.empty(rows[-1], np.bool_), np.empty(shape)
    arguments = (
        *(limb_table(body.limbs), body.limbs.joints, sample_rows(np.concatenate(samples)), ends, camera.row),
        *(frames.rotations, frames.positions, outside, pixels, valid, azimuths),
    )
    parallel_for(lambda first, last: place_points(first, last, *arguments), len(azimuths), LANES)
    return [
        LimbPoints(pixels[first:last].reshape(*shape, n, 2), valid[first:last].reshape(*shape, n), azimuths)
        for n, (first, last) in zip(map(len, samples), pairwise(rows), strict=True)
    ]


def patch_grid(u: FloatArray, v: FloatArray) -> FloatArray:
    """Return the points (U·V, 2) of a grid on the patch, v varying fastest."""
    return np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)


def mean_at(image: Float32Array, points: LimbPoints) -> FloatArray:
    """Return the image's values at the valid points, summed for each limb (N, L) and divided by n, so that others count
    0."""
    sums = np.empty(points.valid.shape[:2])
    arguments = (image, points.pixels, points.valid, sums)
    parallel_for(lambda first, last: _sum_at(first, last, *arguments), len(sums), PARTICLES)
    return sums / points.valid.shape[2]


def levels_at(image: Float32Array, pixels: Float32Array) -> FloatArray:
    """Return the image's values (M,) at pixels (M, 2) inside it."""
    levels = np.empty(len(pixels))
    _levels_at(image, pixels, levels)
    return levels


def bounding_box(points: LimbPoints) -> Box:
    """Return the smallest box of all pixels that interpolation at the valid points reads; one pixel if no point is
    valid."""
    bounds = np.empty((4, len(points.valid)), dtype=np.float32)
    arguments = (points.pixels, points.valid, bounds)
    parallel_for(lambda first, last: _bounds(first, last, *arguments), len(points.valid), PARTICLES)
    left, top = (int(low) if np.isfinite(low) else 0 for low in bounds[:2].min(axis=1, initial=np.inf))
    right, bottom = (max(int(high) + 2, 1) for high in bounds[2:].max(axis=1, initial=-1.0))
    return left, top, right, bottom


@kernel(error_model="numpy", fastmath=FAST)
def _sum_at(first: int, last: int, image: Any, pixels: Any, valid: Any, sums: Any) -> None:
    for i in range(first, last):
        for limb in range(valid.shape[1]):
            total = 0.0
            for s in range(valid.shape[2]):
                if valid[i, limb, s]:
                    total += bilinear(image, pixels[i, limb, s, 0], pixels[i, limb, s, 1])
            sums[i, limb] = total


@kernel(error_model="numpy", fastmath=FAST)
def _bounds(first: int, last: int, pixels: Any, valid: Any, bounds: Any) -> None:
    for i in range(first, last):
        left = top = np.float32(np.inf)
        right = bottom = np.float32(-1.0)
        for limb in range(valid.shape[1]):
            for s in range(valid.shape[2]):
                x, y = pixels[i, limb, s, 0], pixels[i, limb, s, 1]
                if valid[i, limb, s]:
                    left, top, right, bottom = min(left, x), min(top, y), max(right, x), max(bottom, y)
        bounds[0, i], bounds[1, i], bounds[2, i], bounds[3, i] = left, top, right, bottom


@kernel(error_model="numpy", fastmath=FAST)
def _levels_at(image: Any, pixels: Any, levels: Any) -> None:
    for i in range(levels.shape[0]):
        levels[i] = bilinear(image, pixels[i, 0], pixels[i, 1])


@inlined
def bilinear(image: Any, x: float, y: float) -> Any:
    """Return the image's value at a point between the centres of its pixels."""
    column, row = np.uint32(x), np.uint32(y)  # unsigned indices spare numba's test for negative ones
    right, below = np.uint32(column + np.uint32(1)), np.uint32(row + np.uint32(1))
    fx, fy = np.float32(x - column), np.float32(y - row)
    top = image[row, column] + fx * (image[row, right] - image[row, column])
    bottom = image[below, column] + fx * (image[below, right] - image[below, column])
    return top + fy * (bottom - top)


@dataclass(frozen=True, eq=False)
class LimbViewLikelihood:
    """The limbs' log likelihood in one view. samples: points (n, 2) of every patch. log_prob: maps their places in N
    poses, and those of `outside` where there are any, to log likelihoods (N,). outside: points (n, 2) just outside the
    patches."""

    camera: Camera
    samples: FloatArray
    log_prob: Callable[..., FloatArray]
    outside: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class LimbFrameLikelihood:
    """A frame likelihood of the limbs in every view, whose log likelihoods add up; see `PoseFrameLikelihood`."""

    name: str
    body: Body
    views: Sequence[LimbViewLikelihood]
    next_likelihood: Callable[[FloatArray], Likelihood]
    notes: tuple[str, ...] = ()
    diagnostics: Mapping[str, float] = field(default_factory=dict)

    def evaluate(self, previous_pose: FloatArray, pose: FloatArray) -> Evaluation:
        """Return log likelihoods (N,) of poses (N, P), −∞ and a note where not finite; previous poses are ignored."""
        return evaluate_jointly([self], pose)[0]

    def update(self, expected_pose: FloatArray) -> Likelihood:
        """Return the likelihood of the next frame."""
        return self.next_likelihood(expected_pose)


def evaluate_jointly(frame_likelihoods: Sequence[LimbFrameLikelihood], pose: FloatArray) -> list[Evaluation]:
    """Return the evaluation of poses (N, P) by each likelihood of one body."""
    finite = finite_rows(pose)
    frames = forward(frame_likelihoods[0].body.skeleton, select_finite(pose, finite))
    views = [view for frame_likelihood in frame_likelihoods for view in frame_likelihood.views]
    placed = dict(zip(map(id, views), _place_points(frame_likelihoods[0].body, views, frames), strict=True))
    n, evaluations = len(frames.positions), []
    for frame_likelihood in frame_likelihoods:
        log_prob = sum((view.log_prob(*placed[id(view)]) for view in frame_likelihood.views), np.zeros(n))
        evaluations.append(expand_finite(frame_likelihood.name, finite, log_prob))
    return evaluations


def _place_points(body: Body, views: Sequence[LimbViewLikelihood], frames: JointFrames) -> list[list[LimbPoints]]:
    """Place every view's samples, and its points outside, in one pass of each kind per camera."""
    sets: dict[tuple[int, bool], list[tuple[int, LimbViewLikelihood, FloatArray]]] = defaultdict(list)
    for i, view in enumerate(views):
        sets[id(view.camera), False].append((i, view, view.samples))
        if view.outside is not None:
            sets[id(view.camera), True].append((i, view, view.outside))
    placed: list[list[LimbPoints]] = [[] for _ in views]
    for outside in (False, True):
        for (_, is_outside), of_camera in sets.items():
            if is_outside == outside:
                camera = of_camera[0][1].camera
                points = limb_point_sets(body, [samples for *_, samples in of_camera], camera, frames, outside)
                for (i, *_), each in zip(of_camera, points, strict=True):
                    placed[i].append(each)
    return placed
