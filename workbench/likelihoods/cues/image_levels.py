"""Images as likelihoods look at them: smoothed grey or colour levels, and how these differ from a still background."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import scipy
from tqdm import tqdm

from workbench.core.frame import Frame, View
from workbench.core.frame_cache import FrameCache
from workbench.utils.arrays import AnyArray, BoolArray, Float32Array, FloatArray
from workbench.utils.errors import InputError
from workbench.utils.parallel import over_threads

DIFFERENT = 3.5
"""Deviations of noise by which a pixel must change to show something else."""
LEFT, AGREE = 0.15, 0.6
"""What part of the images must show something else where a person was, and what part of these agree on it."""
LEAST_SIGMA = 3.0
"""A lower bound of the background's deviation, grey levels."""
MAD_TO_SIGMA = 1.4826  # standard deviation of a Gaussian over its median absolute deviation
_STRIP = 64  # rows of an image that are worked on together


def grey_levels(view: View, blur_px: float) -> Float32Array:
    """Return a view's grey levels (height, width), 0..255, smoothed by a Gaussian (A, section 5); raises InputError
    when the image has not the size that its camera states."""
    levels = _float_levels(view)
    return _smoothed(cv2.cvtColor(levels, cv2.COLOR_RGB2GRAY) if levels.ndim == 3 else levels, blur_px)


def colour_levels(view: View, blur_px: float) -> Float32Array:
    """Return a view's one or three levels (height, width, C), 0..255, smoothed; raises as `grey_levels`."""
    smooth = _smoothed(_float_levels(view), blur_px)
    return smooth.reshape(*smooth.shape[:2], -1)


def bilinear(image: Float32Array, points: FloatArray) -> FloatArray:
    """Interpolate an image (height, width) bilinearly at points (..., 2), px; 0 outside it and where a point is NaN."""
    height, width = image.shape
    x, y = points[..., 0], points[..., 1]
    inside = (x >= 0.0) & (x < width - 1) & (y >= 0.0) & (y < height - 1)
    places = np.where(inside[..., None], points, -1.0)
    return scipy.ndimage.map_coordinates(image.astype(np.float64), np.moveaxis(places[..., ::-1], -1, 0), order=1)


def _smoothed(image: AnyArray, blur_px: float) -> Float32Array:
    smooth = cv2.GaussianBlur(image, (0, 0), blur_px) if blur_px > 0.0 else image
    return np.ascontiguousarray(smooth, dtype=np.float32)


def _float_levels(view: View) -> Float32Array:
    camera, image = view.camera, view.image
    if image.shape[:2] != (camera.height, camera.width) or image.shape[2:] not in ((), (3,)):
        found = f"a grey or RGB image of {camera.width}×{camera.height} px, found an array of shape {image.shape}"
        raise InputError(f"likelihood: camera {camera.name}: expected {found}")
    return image.astype(np.float32)


@dataclass(frozen=True, eq=False)
class StillScene:
    """A camera's view without the person: median and standard deviation, (height, width, C), of every pixel's one
    or three levels, 0..255."""

    median: Float32Array
    sigma: Float32Array

    @cached_property
    def log_peak(self) -> FloatArray:
        """log 256 N(median), of every level."""
        return np.asarray(np.log(256.0 / (np.sqrt(2.0 * np.pi) * self.sigma)))


def still_scenes(clip: FrameCache, n_frames: int, blur_px: float) -> dict[str, StillScene]:
    """Find the median, and 1.4826 times the median absolute deviation, of every camera's smoothed levels over
    `n_frames` frames of the clip, evenly spread."""
    seen = spaced_images(clip, n_frames, blur_px)
    return {camera: still_scene(images) for camera, images in seen.items()}


def spaced_images(clip: FrameCache, n_frames: int, blur_px: float) -> dict[str, list[Float32Array]]:
    """Collect every camera's smoothed levels in `n_frames` frames of the clip, evenly spread, the first among them."""
    seen: dict[str, list[Float32Array]] = {}
    for frame in spaced_frames(clip, n_frames):
        for view in frame.views:
            seen.setdefault(view.camera.name, []).append(colour_levels(view, blur_px))
    return seen


def spaced_frames(clip: FrameCache, n_frames: int) -> Iterator[Frame]:
    """Go through `n_frames` frames of the clip, evenly spread, the first among them."""
    n = clip.info.n_frames
    used = set(np.unique(np.linspace(0, n - 1, n_frames).round().astype(int)).tolist())
    yield from (f for i, f in enumerate(tqdm(clip, "background", n, unit="frame", disable=None)) if i in used)


@dataclass(frozen=True, eq=False)
class Uncovered:
    """A scene as far as it is seen without the person. person: (height, width), pixels that the first frame's person
    covers and that never change, where the scene is theirs. unknown: (height, width), of which nothing is known."""

    scene: StillScene
    person: BoolArray
    unknown: BoolArray


def uncovered_scene(images: Sequence[Float32Array], inside: BoolArray, near: BoolArray) -> Uncovered:
    """Find what is behind a person who may stay where they are for most of F images (height, width, C).

    inside: (height, width), what they cover in the first image; near: what they may cover.
    Elsewhere, and near them where nothing ever changes, the first image shows the scene, and later ones that agree with
    it make it more exact. Else it is what later images agree on that differ from the first; where none differ, or they
    do not agree, it stays unknown.
    """
    stack = np.stack(images)
    noise = float(MAD_TO_SIGMA * np.median(np.abs(stack[1] - stack[0])) / np.sqrt(2.0))
    apart = np.float32(DIFFERENT * np.sqrt(2.0) * max(noise, 0.5 * LEAST_SIGMA))
    alike = (np.abs(stack - stack[0]) <= apart).all(axis=3)
    levels = (stack * alike[..., None]).sum(axis=0) / alike.sum(axis=0)[..., None]
    rows, columns = np.nonzero(near)
    n_changed = (~alike[:, rows, columns]).sum(axis=0)
    often = n_changed >= max(3, round(LEFT * len(images)))
    rows, columns, n_changed = rows[often], columns[often], n_changed[often]
    changed = np.where(alike[:, rows, columns, None], np.nan, stack[:, rows, columns])
    behind = np.nanmedian(changed, axis=0) if len(rows) else np.zeros((0, levels.shape[2]))
    agreed = (np.abs(changed - behind) <= apart).all(axis=2).sum(axis=0) >= AGREE * n_changed
    levels[rows[agreed], columns[agreed]] = behind[agreed]
    still = alike.mean(axis=0) > 1.0 - LEFT
    unknown = near & (inside | ~still)
    unknown[rows[agreed], columns[agreed]] = False
    person = inside & unknown & still
    scene = StillScene(levels.astype(np.float32), np.full(levels.shape, max(noise, LEAST_SIGMA), dtype=np.float32))
    return Uncovered(scene, person, unknown & ~person)


def still_scene(images: Sequence[Float32Array]) -> StillScene:
    """The scene that F images (height, width, C) have in common."""
    median, sigma = np.empty_like(images[0]), np.empty_like(images[0])
    for rows in np.array_split(np.arange(len(median)), 16):  # in strips, which take less memory
        strip = np.stack([image[rows] for image in images])
        median[rows] = np.median(strip, axis=0)
        sigma[rows] = MAD_TO_SIGMA * np.median(np.abs(strip - median[rows]), axis=0)
    return StillScene(median, np.maximum(sigma, np.float32(LEAST_SIGMA)))


def log_ratio(view: View, scenes: Mapping[str, StillScene], blur_px: float, outlier_fraction: float) -> Float32Array:
    """Return the log ratio of foreground to background, r of `Background`, of every pixel (height, width) of a view;
    raises InputError where its camera is none of the scenes'."""
    if view.camera.name not in scenes:
        raise InputError(f"likelihood: camera {view.camera.name} was not in the clip that it was learned from")
    return scene_log_ratio(view, scenes[view.camera.name], blur_px, outlier_fraction)


def scene_log_ratio(view: View, scene: StillScene, blur_px: float, outlier_fraction: float) -> Float32Array:
    """Return `log_ratio` of a view before one scene: strip by strip, so that what is computed on the way stays in the
    processor's cache, on as many threads as numba is set to."""
    levels = colour_levels(view, blur_px)
    ratio = np.empty(levels.shape[:2], dtype=np.float32)

    def fill(first: int, last: int) -> None:
        for row in range(first, last, _STRIP):
            rows = slice(row, min(row + _STRIP, last))
            about = levels[rows], scene.median[rows], scene.sigma[rows], scene.log_peak[rows]
            ratio[rows] = _log_ratio(*about, outlier_fraction)

    over_threads(fill, len(levels), _STRIP)
    return ratio


def _log_ratio(
    levels: Float32Array, median: Float32Array, sigma: Float32Array, log_peak: FloatArray, outlier_fraction: float
) -> FloatArray:
    """The log ratio (H, W) of levels (H, W, channels) to a scene's median, sigma and log_peak of this shape."""
    z = levels - median
    z /= sigma
    np.square(z, out=z)
    z *= 0.5
    first, *others = np.moveaxis(log_peak - z, 2, 0)
    likelihood = sum(others, first)  # numpy's mean over so few takes longer than all the rest
    likelihood /= levels.shape[2]
    np.exp(likelihood, out=likelihood)
    likelihood *= 1.0 - outlier_fraction
    likelihood += outlier_fraction
    np.log(likelihood, out=likelihood)
    return np.negative(likelihood, out=likelihood)
