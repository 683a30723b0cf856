"""What a camera that stands still sees without the person, learned from the whole clip."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from workbench.arrays import Float32Array
from workbench.core.clip import Clip
from workbench.core.frame import View
from workbench.likelihoods.image_levels import colour_levels

MAD_TO_SIGMA = 1.4826
"""Standard deviation of a Gaussian over its median absolute deviation."""


@dataclass(frozen=True, eq=False)
class StillScene:
    """What one camera sees without the person: median and standard deviation, (height, width, C), of every pixel's one
    or three levels, 0..255."""

    median: Float32Array
    sigma: Float32Array


def still_scenes(clip: Clip, n_frames: int, blur_px: float, least_sigma: float) -> dict[str, StillScene]:
    """Median and 1.4826 times the median absolute deviation of every camera's smoothed levels over the clip.

    `n_frames` of its frames are used, evenly spread.
    """
    n = clip.known.n_frames
    used = set(np.unique(np.linspace(0, n - 1, n_frames).round().astype(int)).tolist())
    seen: dict[str, list[Float32Array]] = {}
    for i, frame in enumerate(tqdm(clip, "background", n, unit="frame", disable=None)):
        if i in used:
            for view in frame.views:
                seen.setdefault(view.camera.name, []).append(colour_levels(view, blur_px))
    return {camera: still_scene(images, least_sigma) for camera, images in seen.items()}


def still_scene(images: Sequence[Float32Array], least_sigma: float) -> StillScene:
    """The scene that F images (height, width, C) have in common."""
    median, sigma = np.empty_like(images[0]), np.empty_like(images[0])
    for rows in np.array_split(np.arange(len(median)), 16):  # in strips, which take less memory
        strip = np.stack([image[rows] for image in images])
        median[rows] = np.median(strip, axis=0)
        sigma[rows] = MAD_TO_SIGMA * np.median(np.abs(strip - median[rows]), axis=0)
    return StillScene(median, np.maximum(sigma, np.float32(least_sigma)))


def log_ratio(view: View, scene: StillScene, blur_px: float, epsilon: float) -> Float32Array:
    """Log ratio of foreground to background, r of `Background`, of every pixel (height, width)."""
    apart = (colour_levels(view, blur_px) - scene.median) / scene.sigma
    normal = np.log(256.0 / (np.sqrt(2.0 * np.pi) * scene.sigma)) - 0.5 * apart**2
    return -np.log(epsilon + (1.0 - epsilon) * np.exp(normal.mean(axis=2))).astype(np.float32)
