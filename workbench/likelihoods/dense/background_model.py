"""What one camera knows: the scene behind the person, what passes in front of them, and how they look."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from workbench.likelihoods.cues.image_levels import AGREE, DIFFERENT, LEFT, MAD_TO_SIGMA
from workbench.likelihoods.dense.kernels import learn_scene, ratio_to_scene
from workbench.likelihoods.dense.view_likelihood import TEXTURE_BEND, interpolated
from workbench.utils.arrays import BoolArray, Float32Array, FloatArray, IntArray
from workbench.utils.parallel import over_threads

START_BESIDE_PX, BESIDE_PX = 17, 9
"""By half of this the outline of a start and that of a tracked pose may be off."""
KEPT, OWN = 20, 10
"""Of how many frames a pixel's mean is; in how many the first image's level must be seen to count as the scene's."""
UNCOVERED = 5
"""As how many frames a level counts that later images agree on."""
LEAST_NOISE = 3.0
_ROWS = 32  # of an image, that a thread takes at once
_DIFFERS = DIFFERENT * np.sqrt(2.0)


@dataclass(frozen=True, eq=False)
class BackgroundModel:
    """The scene as far as it is known. level: (height, width), grey levels. n: of how many frames, 0 where nothing is
    known. noise: of the sensor, grey levels."""

    level: FloatArray
    n: FloatArray
    noise: float

    @property
    def known(self) -> BoolArray:
        """Where the scene has been seen."""
        return np.asarray(self.n > 0.0)

    def log_ratio(self, image: Float32Array, outlier_fraction: float) -> Float32Array:
        """Return the log ratio of a person of any grey level to the scene, as `Background`'s, 0 where it is unknown."""
        found = np.empty(image.shape, dtype=np.float32)
        arguments = image, self.level, self.n, max(self.noise, LEAST_NOISE), outlier_fraction, found
        over_threads(lambda first, last: ratio_to_scene(first, last, *arguments), len(image), _ROWS)
        return found

    def seen(self, image: Float32Array, covered: BoolArray) -> "BackgroundModel":
        """Learn from an image, but near what is `covered` (height, width), and where it shows something else."""
        near, level, n = grown(covered, BESIDE_PX), self.level.copy(), self.n.copy()
        arguments = image, near, float(KEPT), 4.0 * max(self.noise, LEAST_NOISE), level, n
        over_threads(lambda first, last: learn_scene(first, last, *arguments), len(image), _ROWS)
        return replace(self, level=level, n=n)


def first_scene(images: Sequence[Float32Array], covered: BoolArray) -> BackgroundModel:
    """Find the scene about a person who covers some pixels (height, width) in the first of F images.

    Away from them it is the first image's level, or the median of all where that is hardly seen again. Behind them it
    is the level on which later images agree that differ from the first; else it is unknown."""
    stack = np.stack(images)
    noise = _noise(stack)
    apart = _apart(noise)
    level, n = _lasting(stack, ~grown(covered, START_BESIDE_PX), apart), np.zeros(covered.shape)
    n[~grown(covered, START_BESIDE_PX)] = 1.0
    behind = cv2.erode(covered.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    level[behind], n[behind] = _uncovered(stack[:, behind].astype(np.float64), apart)
    return BackgroundModel(level, n, noise)


def tracked_scene(images: Sequence[Float32Array], covered: Sequence[BoolArray]) -> BackgroundModel:
    """Find the scene about a person who is known to cover some pixels (height, width) of each of F images.

    About the person's place in the first image it is the median of what they leave free, unknown where they always are.
    Elsewhere it is as in `first_scene`, since a lost track leaves limbs free. It counts as many frames as it is seen
    in."""
    stack = np.stack(images)
    noise = _noise(stack)
    free = ~np.stack([grown(mask, BESIDE_PX) for mask in covered])
    near, apart = grown(covered[0], START_BESIDE_PX), _apart(noise)
    level, n = _lasting(stack, ~near, apart), np.zeros(near.shape)
    about = near & free.any(axis=0)
    level[about] = _median(np.where(free[:, about], stack[:, about], np.nan))

    def count(first: int, last: int) -> None:
        alike = np.abs(stack[:, first:last] - level[first:last]) < apart
        n[first:last] = np.minimum((alike & free[:, first:last]).sum(axis=0), KEPT)

    over_threads(count, len(n), _ROWS)
    n[~near] = np.maximum(n[~near], UNCOVERED)
    n[near & ~about] = 0.0
    return BackgroundModel(level, n, noise)


def grown(mask: BoolArray, size_px: int) -> BoolArray:
    """Widen a mask by half of size_px on all sides."""
    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((size_px, size_px), np.uint8)) > 0)


def _noise(stack: Float32Array) -> float:
    """The sensor's noise, by the first two of F images."""
    return float(MAD_TO_SIGMA * np.median(np.abs(stack[min(1, len(stack) - 1)] - stack[0])) / np.sqrt(2.0))


def _apart(noise: float) -> float:
    """By how many grey levels two images of one pixel must differ to show two things."""
    return _DIFFERS * max(noise, 0.5 * LEAST_NOISE)


def _median(levels: FloatArray) -> FloatArray:
    """The median (K,) of grey levels (F, K), each an image's and so exact in single precision, among those that are not
    NaN, of which every column has one: as NumPy's, faster by sorting short rows."""
    ordered = np.sort(np.ascontiguousarray(levels.T, dtype=np.float32), axis=1)  # NaN comes last
    last, every = (~np.isnan(ordered)).sum(axis=1) - 1, np.arange(len(ordered))
    return 0.5 * (ordered[every, last // 2].astype(np.float64) + ordered[every, (last + 1) // 2])


def _lasting(stack: Float32Array, wanted: BoolArray, apart: float) -> FloatArray:
    """The level (height, width) of those pixels `wanted` (height, width) of F images, 0 of the others: the first
    image's, or the median if that is seen more often."""
    found = np.zeros(wanted.shape)

    def look(first: int, last: int) -> None:
        for rows in (slice(k, k + _ROWS) for k in range(first, last, _ROWS)):
            found[rows][wanted[rows]] = _lasting_of(stack[:, rows][:, wanted[rows]].astype(np.float64), apart)

    over_threads(look, len(found), _ROWS)
    return found


def _lasting_of(levels: FloatArray, apart: float) -> FloatArray:
    """The level (K,) of pixels that show (F, K), see `_lasting`."""
    as_first = np.abs(levels - levels[0]) < apart
    total, n = (levels * as_first).sum(axis=0), as_first.sum(axis=0)
    rare = n < OWN  # of the others the median cannot be seen more often, as far as it counts
    median = _median(levels[:, rare])
    as_median = np.abs(levels[:, rare] - median) < apart
    passed = n[rare] < np.minimum(as_median.sum(axis=0), OWN)
    alike = np.where(passed, as_median, as_first[:, rare])
    total[rare], n[rare] = (levels[:, rare] * alike).sum(axis=0), alike.sum(axis=0)
    return np.asarray(total / np.maximum(n, 1.0))


def _uncovered(levels: FloatArray, apart: float) -> tuple[FloatArray, FloatArray]:
    """The level (K,) on which those of (F, K) agree that differ from the first, and as how many frames it counts."""
    changed = np.abs(levels - levels[0]) > apart
    n_changed = changed.sum(axis=0)
    often = np.flatnonzero(n_changed >= max(3.0, LEFT * len(levels)))
    level, n = np.zeros(levels.shape[1]), np.zeros(levels.shape[1])
    if len(often):
        others = np.where(changed[:, often], levels[:, often], np.nan)
        middle = _median(others)
        agreed = (np.abs(others - middle) <= apart).sum(axis=0) >= AGREE * n_changed[often]
        level[often[agreed]], n[often[agreed]] = middle[agreed], UNCOVERED
    return level, n


LEAST_PX = 400
"""Pixels of what counts as something of its own when it is first seen."""
OFF_PX = 15
"""So far from the outline expected something may still be the person."""
FARTHEST_PX = 24
"""How far it may go to either side from frame to frame; upwards and downwards it goes RISES_PX."""
RISES_PX = 3
WORST = 25.0
"""Mean difference, grey levels, at which it is no longer found."""
_CLIPPED = 40.0
_LEAST_LEFT, _COMPARED = 50, 1000  # pixels, at least that must be left and at most that are compared


@dataclass(frozen=True, eq=False)
class _Passing:
    """What was seen to pass: its pixels (height, width) in the last image, and that image, a little smoothed."""

    mask: BoolArray
    image: Float32Array

    def followed(self, image: Float32Array, foreground: BoolArray, person: BoolArray, unknown: BoolArray) -> "_Passing":
        """Find it in the next image, and what is new beside the person.

        It moves as one piece; where it enters the image, or was hidden in part, foreground that touches it joins it,
        but none within OFF_PX of the person (height, width). Foreground that is new, has LEAST_PX and touches neither
        the person nor what is unknown begins to pass.
        """
        smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), 1.0), dtype=np.float32)
        mask = _shifted(self.mask, _shift(self.image, self.mask, smooth))
        whole = _cleaned(foreground)
        off = ~grown(person, 2 * OFF_PX + 1)
        _, pieces, boxes, _ = cv2.connectedComponentsWithStats((whole & off).astype(np.uint8))
        _, joined = cv2.connectedComponents((whole | unknown).astype(np.uint8))
        persons = np.unique(joined[grown(person, 9) | unknown])
        sizes = boxes[:, cv2.CC_STAT_AREA]
        taken = np.bincount(pieces[mask], minlength=len(sizes)) > 0  # by a piece's number, of which 0 is none
        for k in np.flatnonzero(sizes[1:] > LEAST_PX) + 1:
            taken[k] |= joined.ravel()[np.argmax(pieces.ravel() == k)] not in persons  # the same all over a piece
        taken[0] = False
        if taken.any():
            mask = mask | taken[pieces]
        return _Passing(mask, smooth)


def nothing_passing(image: Float32Array) -> _Passing:
    """Begin with an image."""
    return _Passing(np.zeros(image.shape, np.bool_), np.asarray(cv2.GaussianBlur(image, (0, 0), 1.0), dtype=np.float32))


def _cleaned(mask: BoolArray) -> BoolArray:
    """Drop single pixels and close small holes."""
    opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return np.asarray(cv2.morphologyEx(opened, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)) > 0)


def _shift(before: Float32Array, mask: BoolArray, image: Float32Array) -> tuple[int, int] | None:
    """How many rows and columns the masked part of an image has moved by in the next; None where it is not there."""
    rows, columns = np.nonzero(mask)
    if len(rows) < _LEAST_LEFT:
        return None
    rows, columns = (each[:: -(-len(rows) // _COMPARED)] for each in (rows, columns))
    levels = before[rows, columns]

    def difference(way: tuple[int, int]) -> float:
        y, x, in_image = _moved(rows, columns, way, mask.shape)
        if in_image.sum() < _LEAST_LEFT:
            return float(np.inf)
        return float(np.minimum(np.abs(image[y, x] - levels[in_image]), _CLIPPED).mean())

    coarse = [(dy, dx) for dx in range(-FARTHEST_PX, FARTHEST_PX + 1, 2) for dy in range(-RISES_PX, RISES_PX + 1, 3)]
    best = min(coarse, key=difference)
    best = min(((best[0] + dy, best[1] + dx) for dx in (-1, 0, 1) for dy in (-1, 0, 1)), key=difference)
    return best if difference(best) < WORST else None


def _shifted(mask: BoolArray, way: tuple[int, int] | None) -> BoolArray:
    shifted = np.zeros_like(mask)
    if way is not None:
        rows, columns = np.nonzero(mask)
        y, x, _ = _moved(rows, columns, way, mask.shape)
        shifted[y, x] = True
    return shifted


def _moved(
    rows: IntArray, columns: IntArray, way: tuple[int, int], shape: tuple[int, ...]
) -> tuple[IntArray, IntArray, BoolArray]:
    """Rows and columns after a shift, of those that stay in the image, and which (K,) these are."""
    y, x = rows + way[0], columns + way[1]
    in_image = (y >= 0) & (x >= 0) & (y < shape[0]) & (x < shape[1])
    return y[in_image], x[in_image], in_image


_HIDE_PX = 5
"""By half of this, what passes hides more than its pixels."""


@dataclass(frozen=True, eq=False)
class ViewState:
    """What one camera knows. person: (height, width), covered by the pose expected last. texture: (K, S) grey levels of
    the body's cells at every smoothing; n: (S,) how many frames they stand for, 0 where a cell was never seen."""

    scene: BackgroundModel
    passing: _Passing
    person: BoolArray
    texture: FloatArray
    n: FloatArray

    @property
    def hidden(self) -> BoolArray:
        """Where something passes before the person, (height, width)."""
        return grown(self.passing.mask, _HIDE_PX)

    def followed(self, image: Float32Array, ratio: Float32Array) -> "ViewState":
        """Find what passes in an image, given the log ratio of anybody to the scene, before the person is found."""
        return replace(self, passing=self.passing.followed(image, ratio > 0.0, self.person, ~self.scene.known))

    def with_person(self, image: Float32Array, person: BoolArray) -> "ViewState":
        """Learn the scene of an image, in which the person covers some pixels."""
        return replace(self, scene=self.scene.seen(image, person | self.hidden), person=person)

    def with_texture(
        self, levels: Sequence[Float32Array], cells: IntArray, pixels: FloatArray, sigma: float, learning_rate: float
    ) -> "ViewState":
        """Learn how cells (K,) look at pixels (K, 2) of an image at all smoothings: T += g (I − T), see
        `DenseAlignment`."""
        found = np.stack([interpolated(level, pixels)[0] for level in levels])
        texture, n = self.texture.copy(), self.n.copy()
        misses = (found[-1] - texture[-1, cells]) / (TEXTURE_BEND * sigma)
        trust = np.where(n[cells] > 0.0, 1.0 / (1.0 + misses**2) ** 2, 1.0)
        texture[:, cells] += trust * np.maximum(1.0 / (n[cells] + 1.0), learning_rate) * (found - texture[:, cells])
        n[cells] += trust
        return replace(self, texture=texture, n=n)


def newly_seen(
    scene: BackgroundModel, image: Float32Array, person: BoolArray, n_levels: int, n_cells: int
) -> ViewState:
    """Know a scene and where the person is in an image, but not yet how they look."""
    return ViewState(scene, nothing_passing(image), person, np.zeros((n_levels, n_cells)), np.zeros(n_cells))
