"""One camera's model in dense alignment: the background, the occluders and the person's appearance."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from workbench.likelihoods.cues.image_levels import CHANGE_SIGMAS, MAD_TO_SIGMA, MIN_AGREEMENT, MIN_CHANGED
from workbench.likelihoods.dense.kernels import log_ratio_rows, update_background
from workbench.likelihoods.dense.view_likelihood import TEXTURE_LOSS_SCALE, interpolate
from workbench.utils.arrays import BoolArray, Float32Array, FloatArray, IntArray
from workbench.utils.parallel import parallel_for

START_DILATION_PX, DILATION_PX = 17, 9
"""Widths of the dilation of a first pose's outline and of a tracked pose's, whose errors are at most half of them."""
MAX_FRAMES, ENOUGH_FRAMES = 20, 10
"""Effective number of frames of a pixel's mean; number in which the first image's level must occur to be the
background's."""
UNCOVERED_FRAMES = 5
"""Effective number of frames of a level on which later images agree."""
MIN_NOISE = 3.0
_ROWS = 32  # rows of an image per task of a thread
_DIFFERS = CHANGE_SIGMAS * np.sqrt(2.0)


@dataclass(frozen=True, eq=False)
class BackgroundModel:
    """The background as far as it has been observed. level: (height, width), grey levels. n: effective number of
    frames, 0 where unobserved. noise: of the sensor, grey levels."""

    level: FloatArray
    n: FloatArray
    noise: float

    @property
    def observed(self) -> BoolArray:
        """Whether each pixel of the background has been observed."""
        return np.asarray(self.n > 0.0)

    def log_ratio(self, image: Float32Array, outlier_fraction: float) -> Float32Array:
        """Return the log ratio of a person of uniformly distributed grey level to the background, as `Background`'s; 0
        where unobserved."""
        log_ratios = np.empty(image.shape, dtype=np.float32)
        arguments = image, self.level, self.n, max(self.noise, MIN_NOISE), outlier_fraction, log_ratios
        parallel_for(lambda first, last: log_ratio_rows(first, last, *arguments), len(image), _ROWS)
        return log_ratios

    def updated(self, image: Float32Array, covered: BoolArray) -> "BackgroundModel":
        """Return the background updated with an image, except near `covered` (height, width) and where the image
        differs."""
        excluded, level, n = dilated(covered, DILATION_PX), self.level.copy(), self.n.copy()
        arguments = image, excluded, float(MAX_FRAMES), 4.0 * max(self.noise, MIN_NOISE), level, n
        parallel_for(lambda first, last: update_background(first, last, *arguments), len(image), _ROWS)
        return replace(self, level=level, n=n)


def initial_background(images: Sequence[Float32Array], covered: BoolArray) -> BackgroundModel:
    """Return the background around a person who covers some pixels (height, width) in the first of F images. Far from
    the person it is the first image's level, or the median of all if that level is rare. Behind them it is the level,
    different from the first, on which later images agree; otherwise it is unobserved."""
    stack = np.stack(images)
    noise = _noise(stack)
    threshold = _change_threshold(noise)
    level, n = _persistent_levels(stack, ~dilated(covered, START_DILATION_PX), threshold), np.zeros(covered.shape)
    n[~dilated(covered, START_DILATION_PX)] = 1.0
    behind = cv2.erode(covered.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    level[behind], n[behind] = _uncovered(stack[:, behind].astype(np.float64), threshold)
    return BackgroundModel(level, n, noise)


def refitted_background(images: Sequence[Float32Array], covered: Sequence[BoolArray]) -> BackgroundModel:
    """Return the background around a person who covers known pixels (height, width) of each of F images. Near the
    person's place in the first image it is the median of the uncovered levels, unobserved where always covered.
    Elsewhere it is as in `initial_background`, since a lost track leaves limbs uncovered. Its number of frames is that
    of agreeing images."""
    stack = np.stack(images)
    noise = _noise(stack)
    visible = ~np.stack([dilated(mask, DILATION_PX) for mask in covered])
    near, threshold = dilated(covered[0], START_DILATION_PX), _change_threshold(noise)
    level, n = _persistent_levels(stack, ~near, threshold), np.zeros(near.shape)
    uncovered = near & visible.any(axis=0)
    level[uncovered] = _median(np.where(visible[:, uncovered], stack[:, uncovered], np.nan))

    def count(first: int, last: int) -> None:
        agreeing = np.abs(stack[:, first:last] - level[first:last]) < threshold
        n[first:last] = np.minimum((agreeing & visible[:, first:last]).sum(axis=0), MAX_FRAMES)

    parallel_for(count, len(n), _ROWS)
    n[~near] = np.maximum(n[~near], UNCOVERED_FRAMES)
    n[near & ~uncovered] = 0.0
    return BackgroundModel(level, n, noise)


def dilated(mask: BoolArray, size_px: int) -> BoolArray:
    """Return a mask dilated by half of size_px on all sides."""
    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((size_px, size_px), np.uint8)) > 0)


def _noise(stack: Float32Array) -> float:
    """Return the sensor's noise, estimated from the first two of F images."""
    return float(MAD_TO_SIGMA * np.median(np.abs(stack[min(1, len(stack) - 1)] - stack[0])) / np.sqrt(2.0))


def _change_threshold(noise: float) -> float:
    """Return the difference, grey levels, of two images of one pixel that show different things."""
    return _DIFFERS * max(noise, 0.5 * MIN_NOISE)


def _median(levels: FloatArray) -> FloatArray:
    """Return the median (K,) of the grey levels (F, K) that are not NaN, at least one in each column. Levels are those
    of images and so exact in single precision. As NumPy's, but faster by sorting short rows."""
    ordered = np.sort(np.ascontiguousarray(levels.T, dtype=np.float32), axis=1)  # NaN is last
    last, columns = (~np.isnan(ordered)).sum(axis=1) - 1, np.arange(len(ordered))
    return 0.5 * (ordered[columns, last // 2].astype(np.float64) + ordered[columns, (last + 1) // 2])


def _persistent_levels(stack: Float32Array, pixels: BoolArray, threshold: float) -> FloatArray:
    """Return the level (height, width) of some `pixels` (height, width) of F images, 0 elsewhere: the first image's, or
    the median if that occurs more often."""
    persistent = np.zeros(pixels.shape)

    def fill(first: int, last: int) -> None:
        for rows in (slice(k, k + _ROWS) for k in range(first, last, _ROWS)):
            levels = stack[:, rows][:, pixels[rows]].astype(np.float64)
            persistent[rows][pixels[rows]] = _persistent_level(levels, threshold)

    parallel_for(fill, len(persistent), _ROWS)
    return persistent


def _persistent_level(levels: FloatArray, threshold: float) -> FloatArray:
    """Return the level (K,) of pixels with levels (F, K), see `_persistent_levels`."""
    as_first = np.abs(levels - levels[0]) < threshold
    total, n = (levels * as_first).sum(axis=0), as_first.sum(axis=0)
    rare = n < ENOUGH_FRAMES  # of the others the median cannot occur more often, up to ENOUGH_FRAMES
    median = _median(levels[:, rare])
    as_median = np.abs(levels[:, rare] - median) < threshold
    replaced = n[rare] < np.minimum(as_median.sum(axis=0), ENOUGH_FRAMES)
    agreeing = np.where(replaced, as_median, as_first[:, rare])
    total[rare], n[rare] = (levels[:, rare] * agreeing).sum(axis=0), agreeing.sum(axis=0)
    return np.asarray(total / np.maximum(n, 1.0))


def _uncovered(levels: FloatArray, threshold: float) -> tuple[FloatArray, FloatArray]:
    """Return the level (K,) on which those of (F, K) that differ from the first agree, and its effective number of
    frames."""
    changed = np.abs(levels - levels[0]) > threshold
    n_changed = changed.sum(axis=0)
    changed_often = np.flatnonzero(n_changed >= max(3.0, MIN_CHANGED * len(levels)))
    level, n = np.zeros(levels.shape[1]), np.zeros(levels.shape[1])
    if len(changed_often):
        others = np.where(changed[:, changed_often], levels[:, changed_often], np.nan)
        median = _median(others)
        agreed = (np.abs(others - median) <= threshold).sum(axis=0) >= MIN_AGREEMENT * n_changed[changed_often]
        level[changed_often[agreed]], n[changed_often[agreed]] = median[agreed], UNCOVERED_FRAMES
    return level, n


MIN_OCCLUDER_PX = 400
"""Minimum area, px, of a new occluder."""
PERSON_MARGIN_PX = 15
"""Foreground within this distance of the expected outline may be the person."""
MAX_SHIFT_PX = 24
"""Maximum horizontal shift per frame; MAX_VERTICAL_SHIFT_PX is the vertical one."""
MAX_VERTICAL_SHIFT_PX = 3
MAX_MATCH_DIFFERENCE = 25.0
"""Mean difference, grey levels, at which an occluder is no longer matched."""
_MAX_DIFFERENCE = 40.0
_MIN_MATCHED, _MAX_MATCHED = 50, 1000  # minimum and maximum number of pixels compared


@dataclass(frozen=True, eq=False)
class Occluders:
    """The occluders: their pixels (height, width) in the previous image, and that image, slightly smoothed."""

    mask: BoolArray
    image: Float32Array

    def tracked(self, image: Float32Array, foreground: BoolArray, person: BoolArray, unknown: BoolArray) -> "Occluders":
        """Return the occluders in the next image, with new ones next to the person.

        Occluders move rigidly. Where one enters the image, or was hidden in part, foreground that touches it joins it,
        except within PERSON_MARGIN_PX of the person. A new occluder is foreground of at least MIN_OCCLUDER_PX that
        touches neither the person nor unknown background.

        Parameters
        ----------
        image, foreground : (height, width), the next image and its foreground.
        person, unknown : (height, width), the expected person, and pixels of unknown background.
        """
        smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), 1.0), dtype=np.float32)
        mask = _shifted_mask(self.mask, _match_shift(self.image, self.mask, smooth))
        cleaned = _cleaned(foreground)
        far_from_person = ~dilated(person, 2 * PERSON_MARGIN_PX + 1)
        _, labels, statistics, _ = cv2.connectedComponentsWithStats((cleaned & far_from_person).astype(np.uint8))
        _, joined_labels = cv2.connectedComponents((cleaned | unknown).astype(np.uint8))
        person_labels = np.unique(joined_labels[dilated(person, 9) | unknown])
        sizes = statistics[:, cv2.CC_STAT_AREA]
        added = np.bincount(labels[mask], minlength=len(sizes)) > 0  # by label; 0 is the complement
        for k in np.flatnonzero(sizes[1:] > MIN_OCCLUDER_PX) + 1:
            joined = joined_labels.ravel()[np.argmax(labels.ravel() == k)]  # equal within a label
            added[k] |= joined not in person_labels
        added[0] = False
        if added.any():
            mask = mask | added[labels]
        return Occluders(mask, smooth)


def no_occluders(image: Float32Array) -> Occluders:
    """Return the initial state, without occluders, for an image."""
    smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), 1.0), dtype=np.float32)
    return Occluders(np.zeros(image.shape, np.bool_), smooth)


def _cleaned(mask: BoolArray) -> BoolArray:
    """Return a mask without single pixels and small holes."""
    opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return np.asarray(cv2.morphologyEx(opened, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)) > 0)


def _match_shift(previous_image: Float32Array, mask: BoolArray, image: Float32Array) -> tuple[int, int] | None:
    """Return the shift, in rows and columns, of the masked part of an image to the next; None without a match."""
    rows, columns = np.nonzero(mask)
    if len(rows) < _MIN_MATCHED:
        return None
    rows, columns = (each[:: -(-len(rows) // _MAX_MATCHED)] for each in (rows, columns))
    previous_levels = previous_image[rows, columns]

    def difference(shift: tuple[int, int]) -> float:
        y, x, in_image = _shifted_pixels(rows, columns, shift, mask.shape)
        if in_image.sum() < _MIN_MATCHED:
            return float(np.inf)
        return float(np.minimum(np.abs(image[y, x] - previous_levels[in_image]), _MAX_DIFFERENCE).mean())

    vertical = range(-MAX_VERTICAL_SHIFT_PX, MAX_VERTICAL_SHIFT_PX + 1, 3)
    coarse = [(dy, dx) for dx in range(-MAX_SHIFT_PX, MAX_SHIFT_PX + 1, 2) for dy in vertical]
    best = min(coarse, key=difference)
    best = min(((best[0] + dy, best[1] + dx) for dx in (-1, 0, 1) for dy in (-1, 0, 1)), key=difference)
    return best if difference(best) < MAX_MATCH_DIFFERENCE else None


def _shifted_mask(mask: BoolArray, shift: tuple[int, int] | None) -> BoolArray:
    shifted = np.zeros_like(mask)
    if shift is not None:
        rows, columns = np.nonzero(mask)
        y, x, _ = _shifted_pixels(rows, columns, shift, mask.shape)
        shifted[y, x] = True
    return shifted


def _shifted_pixels(
    rows: IntArray, columns: IntArray, shift: tuple[int, int], shape: tuple[int, ...]
) -> tuple[IntArray, IntArray, BoolArray]:
    """Return shifted rows and columns of the pixels that stay in the image, and which (K,) these are."""
    y, x = rows + shift[0], columns + shift[1]
    in_image = (y >= 0) & (x >= 0) & (y < shape[0]) & (x < shape[1])
    return y[in_image], x[in_image], in_image


_OCCLUDER_DILATION_PX = 5
"""Width of the dilation of occluders."""


@dataclass(frozen=True, eq=False)
class ViewState:
    """One camera's model. person_mask: (height, width), the pixels of the previous expected pose. texture: (K, S) grey
    levels of the surface elements at every level of smoothing; n: (S,) their effective numbers of frames, 0 for an
    element never observed."""

    background: BackgroundModel
    occluders: Occluders
    person_mask: BoolArray
    texture: FloatArray
    n: FloatArray

    @property
    def occluded(self) -> BoolArray:
        """Whether an occluder covers each pixel, (height, width)."""
        return dilated(self.occluders.mask, _OCCLUDER_DILATION_PX)

    def tracked(self, image: Float32Array, ratio: Float32Array) -> "ViewState":
        """Return the model with the occluders of an image, given the log ratio of the person to the background, before
        the pose is known."""
        occluders = self.occluders.tracked(image, ratio > 0.0, self.person_mask, ~self.background.observed)
        return replace(self, occluders=occluders)

    def with_person(self, image: Float32Array, person_mask: BoolArray) -> "ViewState":
        """Return the model with the background updated by an image in which the person covers some pixels."""
        background = self.background.updated(image, person_mask | self.occluded)
        return replace(self, background=background, person_mask=person_mask)

    def with_texture(
        self, levels: Sequence[Float32Array], elements: IntArray, pixels: FloatArray, sigma: float, learning_rate: float
    ) -> "ViewState":
        """Return the model with the texture of elements (K,) at pixels (K, 2) updated: T += g (I − T), see
        `DenseAlignment`.

        Parameters
        ----------
        levels : the image at all levels of smoothing.
        elements, pixels : the visible elements (K,) and their pixels (K, 2).
        sigma, learning_rate : as in `DenseAlignment`.
        """
        observed = np.stack([interpolate(level, pixels)[0] for level in levels])
        texture, n = self.texture.copy(), self.n.copy()
        residuals = (observed[-1] - texture[-1, elements]) / (TEXTURE_LOSS_SCALE * sigma)
        inlier_weight = np.where(n[elements] > 0.0, 1.0 / (1.0 + residuals**2) ** 2, 1.0)
        gain = inlier_weight * np.maximum(1.0 / (n[elements] + 1.0), learning_rate)
        texture[:, elements] += gain * (observed - texture[:, elements])
        n[elements] += inlier_weight
        return replace(self, texture=texture, n=n)


def initial_view_state(
    background: BackgroundModel, image: Float32Array, person_mask: BoolArray, n_levels: int, n_elements: int
) -> ViewState:
    """Return the model of a background and the person's pixels in an image, without texture."""
    texture, n = np.zeros((n_levels, n_elements)), np.zeros(n_elements)
    return ViewState(background, no_occluders(image), person_mask, texture, n)
