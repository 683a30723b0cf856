"""What a still camera sees behind the person, learned where the person is not."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from workbench.arrays import BoolArray, Float32Array, FloatArray
from workbench.likelihoods.image_levels import AGREE, DIFFERENT, LEFT, MAD_TO_SIGMA

START_BESIDE_PX, BESIDE_PX = 17, 9
"""By half of this the outline of a start and that of a tracked pose may be off."""
KEPT, OWN = 20, 10
"""Of how many frames a pixel's mean is; in how many the first image's level must be seen to count as the scene's."""
UNCOVERED = 5
"""As how many frames a level counts that later images agree on."""
LEAST_NOISE = 3.0
_DIFFERS = DIFFERENT * np.sqrt(2.0)


@dataclass(frozen=True, eq=False)
class Scene:
    """The scene as far as it is known. level: (height, width), grey levels. n: of how many frames, 0 where nothing is
    known. noise: of the sensor, grey levels."""

    level: FloatArray
    n: FloatArray
    noise: float

    @property
    def known(self) -> BoolArray:
        """Where the scene has been seen."""
        return np.asarray(self.n > 0.0)

    def log_ratio(self, image: Float32Array, epsilon: float) -> Float32Array:
        """Return the log ratio of a person of any grey level to the scene, as `Background`'s, 0 where it is unknown."""
        sigma = max(self.noise, LEAST_NOISE) * np.sqrt(1.0 + 1.0 / np.maximum(self.n, 1.0))
        normal = 256.0 / (np.sqrt(2.0 * np.pi) * sigma) * np.exp(-0.5 * ((image - self.level) / sigma) ** 2)
        return np.where(self.known, -np.log(epsilon + (1.0 - epsilon) * normal), 0.0).astype(np.float32)

    def seen(self, image: Float32Array, covered: BoolArray) -> "Scene":
        """Learn from an image, but near what is `covered` (height, width), and where it shows something else."""
        near = grown(covered, BESIDE_PX)
        alike = np.abs(image - self.level) < 4.0 * max(self.noise, LEAST_NOISE)
        shown = ~near & (~self.known | (alike & (self.n < KEPT)))
        n = self.n + shown
        return replace(self, level=self.level + shown * (image - self.level) / np.maximum(n, 1.0), n=n)


def first_scene(images: Sequence[Float32Array], covered: BoolArray) -> Scene:
    """Find the scene about a person who covers some pixels (height, width) in the first of F images.

    Away from them it is the first image's level, or the median of all where the first one's is hardly seen again:
    something else passed there. Behind them it is what later images agree on that differ from the first; else nothing
    is known of it until they leave.
    """
    stack = np.stack(images).astype(np.float64)
    noise = _noise(stack)
    apart = _apart(noise)
    near = grown(covered, START_BESIDE_PX)
    level, n = np.zeros(covered.shape), np.zeros(covered.shape)
    level[~near], n[~near] = _lasting(stack[:, ~near], apart), 1.0
    behind = cv2.erode(covered.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    level[behind], n[behind] = _uncovered(stack[:, behind], apart)
    return Scene(level, n, noise)


def tracked_scene(images: Sequence[Float32Array], covered: Sequence[BoolArray]) -> Scene:
    """Find the scene about a person who is known to cover some pixels (height, width) of each of F images: the median
    of what they leave free; nothing is known of what they always cover. Away from where they are in the first image it
    is as `first_scene` has it: who was lost later left an arm or a leg free, which is no scene.
    """
    stack = np.stack(images).astype(np.float64)
    free = ~np.stack([grown(mask, BESIDE_PX) for mask in covered])
    level, n, noise = np.zeros(stack.shape[1:]), np.zeros(stack.shape[1:]), _noise(stack)
    for rows in np.array_split(np.arange(stack.shape[1]), 16):  # in strips, which take less memory
        some = free[:, rows].any(axis=0)
        shown = np.where(free[:, rows], stack[:, rows], np.nan)[:, some]
        median = _median(shown)
        agree = (np.abs(shown - median) < _apart(noise)).sum(axis=0)
        level_rows, n_rows = level[rows], n[rows]
        level_rows[some], n_rows[some] = median, np.minimum(agree, KEPT)
        level[rows], n[rows] = level_rows, n_rows
    apart = ~grown(covered[0], START_BESIDE_PX)
    level[apart], n[apart] = _lasting(stack[:, apart], _apart(noise)), np.maximum(n[apart], UNCOVERED)
    return Scene(level, n, noise)


def grown(mask: BoolArray, size_px: int) -> BoolArray:
    """Widen a mask by half of size_px on all sides."""
    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((size_px, size_px), np.uint8)) > 0)


def _noise(stack: FloatArray) -> float:
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


def _lasting(levels: FloatArray, apart: float) -> FloatArray:
    """The level (K,) of pixels that show (F, K): the first, or the median if that is seen more often."""
    median = _median(levels)
    as_first, as_median = (np.abs(levels - level) < apart for level in (levels[0], median))
    own = as_first.sum(axis=0) >= np.minimum(as_median.sum(axis=0), OWN)
    alike = np.where(own, as_first, as_median)
    return np.asarray((levels * alike).sum(axis=0) / np.maximum(alike.sum(axis=0), 1.0))


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
