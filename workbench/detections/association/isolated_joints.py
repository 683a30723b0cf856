"""Removal of joints that a detector puts elsewhere for a few frames: no path of a joint leads there and back."""

from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from workbench.cameras.image_height import height_px
from workbench.detections.association.keypoint_kalman import ARMS, LEGS, exchanged
from workbench.detections.readers.people import People
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.nan_statistics import nan_median

_WINDOW_S = 0.2
"""Time over which a joint's median place lies on its path."""
_MIN_FRAMES = 3
"""Number of places from which on a single wrong one is not their median."""
_MAX_AWAY = 0.5
"""Distance from the median place over the person's height, that of a knee from the head. A wrist that turns round at
10 m/s comes back within the window's half from 0.3 heights."""
_EXCHANGED = exchanged(*ARMS, *LEGS)


def isolated_joints(joints: FloatArray, frames: IntArray, rate_hz: float) -> BoolArray:
    """Return which joints (V, T, J) are further than _MAX_AWAY from their median place over _WINDOW_S, and from that of
    the other side's joint, whose label they may have, relative to the median of all joints, as a fast body or a camera
    moves them all.

    None is where the window has fewer than _MIN_FRAMES with the joint.

    Parameters
    ----------
    joints : (V, T, J, ≥ 2), [u px, v px, …] of one person in V views, NaN without a detection.
    frames : (T,) their numbers, increasing.
    rate_hz : of the frames.
    """
    reach = int(0.5 * _WINDOW_S * rate_hz)
    if 2 * reach + 1 < _MIN_FRAMES or not len(frames):
        return np.zeros(joints.shape[:3], bool)
    rows = frames - frames[0] + reach
    every = np.full((len(joints), rows[-1] + reach + 1, *joints.shape[2:3], 2), np.nan)
    every[:, rows] = joints[..., :2]
    around = sliding_window_view(every, 2 * reach + 1, axis=1)[:, rows - reach]  # (V, T, J, 2, window)
    known = np.isfinite(around).sum(axis=-1) >= _MIN_FRAMES
    medians = np.where(known, nan_median(around), np.nan)
    common = nan_median((joints[..., :2] - medians).swapaxes(-1, -2))[..., None, :]
    own, other = (joints[..., :2] - each - common for each in (medians, medians[..., _EXCHANGED, :]))
    limit = _MAX_AWAY * np.maximum(height_px(medians)[..., None], 1.0)
    return np.asarray((np.linalg.norm(own, axis=-1) > limit) & ~(np.linalg.norm(other, axis=-1) <= limit), bool)


def without_isolated(people: People, rate_hz: float) -> People:
    """Return a view's people without isolated joints; unchanged where a frame shows several, not yet distinguished."""
    if max(map(len, people.joints), default=0) != 1:
        return people
    shown = [t for t, rows in enumerate(people.joints) if len(rows)]
    joints = np.stack([people.joints[t][0] for t in shown])
    joints[isolated_joints(joints[None], people.frames[shown], rate_hz)[0]] = np.nan
    by_frame = dict(zip(shown, joints[:, None], strict=True))
    return replace(people, joints=tuple(by_frame.get(t, rows) for t, rows in enumerate(people.joints)))
