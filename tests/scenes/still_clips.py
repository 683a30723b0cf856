"""Clips with a static background."""

from types import SimpleNamespace

import likelihood_scenes as scenes
import numpy as np

from workbench.core.dataset import SequenceInfo
from workbench.core.frame_cache import FrameCache

EPSILON, SIGMA = 0.05, 3.0


def of_frames(frames):
    """Return a clip of these frames."""
    return FrameCache(SimpleNamespace(info=SequenceInfo("clip", len(frames)), frames=lambda: iter(frames)))


def clip(*images, camera=scenes.FRONT):
    """Return a clip of one camera's images, and its frames."""
    frames = [scenes.frame(i, (camera, image)) for i, image in enumerate(images)]
    return of_frames(frames), frames


def with_block(image, level, rows, columns):
    changed = image.copy()
    changed[rows, columns] = level
    return changed


def by_hand(difference):
    """Return the log ratio r of a pixel with this difference from the background."""
    normal = np.exp(-0.5 * (difference / SIGMA) ** 2) / (np.sqrt(2.0 * np.pi) * SIGMA)
    return -np.log(EPSILON + (1.0 - EPSILON) * 256.0 * normal)
