"""Annotated or detected joints of a sequence's frames in all cameras."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from workbench.cameras.camera import Camera
from workbench.cameras.image_height import height_px
from workbench.utils.arrays import BoolArray, ByteArray, FloatArray
from workbench.utils.nan_statistics import nan_median

MIN_WEIGHT = 0.3
"""Detected joints of lower confidence are ignored."""
MIN_JOINTS = 4
"""Keypoints of a view from which on it shows a person; a detector sees fewer in a chair."""
_LONG_GAP_S = 0.5
"""Time between two frames above which the motion between them is no jump."""
_SOME_FRAMES = 120
"""Evenly spaced frames in which cameras are compared."""


def some_frames(n: int, least: int = _SOME_FRAMES) -> slice:
    """Return evenly spaced ones of n frames: all of few, and at least `least` of many."""
    return slice(None, None, max(n // least, 1))


@dataclass(frozen=True, eq=False)
class ObservedJoints:
    """Joints of F frames in V cameras; without any joints F is 0.

    Parameters
    ----------
    keypoints : (V, F, J, 3), [u px, v px, weight], NaN for none.
    searched : (V,), whether a camera's images were annotated or searched at all.
    best : row of the frame with most joints.
    images : that frame's images by camera; those of the first frame without any joints.
    times_s : (F,), s; empty if unknown.
    scale : factor by which the source's images were resized.
    in_cameras : as keypoints, where `cameras` would see them; None for cameras that stand still.
    """

    cameras: tuple[Camera, ...]
    keypoints: FloatArray
    searched: BoolArray
    best: int = 0
    images: tuple[ByteArray, ...] = ()
    times_s: FloatArray = field(default_factory=lambda: np.empty(0))
    scale: float = 1.0
    in_cameras: FloatArray | None = None

    def pixels(self, min_weight: float = 0.0) -> FloatArray:
        """Return the pixels (V, F, J, 2), NaN where the weight is 0 or less than min_weight."""
        weights = self.keypoints[..., 2:]
        return np.where((weights > 0.0) & (weights >= min_weight), self.keypoints[..., :2], np.nan)

    @cached_property
    def heights_px(self) -> FloatArray:
        """Heights (F, V) of the person in the images, 0 for fewer than two joints."""
        return height_px(self.pixels()).T

    @cached_property
    def shows_person(self) -> BoolArray:
        """Whether a view's keypoints show a person, (F, V)."""
        return np.asarray((np.isfinite(self.pixels()[..., 0]).sum(axis=2) >= MIN_JOINTS).T)

    @cached_property
    def motion(self) -> FloatArray:
        """Motion (F,) of the keypoints since the frame before: the median over joints of the distance in heights of
        the person, then over cameras; NaN after a gap."""
        pixels, heights = self.pixels(), self.heights_px.T[:, 1:]
        steps = nan_median(np.linalg.norm(np.diff(pixels, axis=1), axis=-1))
        moved = np.where(heights > 0.0, steps / np.maximum(heights, 1e-9), np.nan)
        if len(self.times_s):
            moved[:, np.diff(self.times_s) > _LONG_GAP_S] = np.nan
        return np.concatenate([[np.nan] * min(1, pixels.shape[1]), nan_median(moved.T)])
