"""Frames whose detections repeat those of the frame before."""

import numpy as np
from scipy.ndimage import find_objects, label

from workbench.cameras.observed_joints import ObservedJoints
from workbench.evaluation.verdict.run_measurements import RunMeasurements
from workbench.utils.arrays import BoolArray

_MIN_FROZEN_S = 0.25
"""Shortest frozen stretch, half a step of a walk. A person who stands still is no frozen one: by the images' noise a
detector's joints differ from frame to frame, by a tenth of a pixel and more."""
_SAME_PX = 0.01
"""Largest difference of equal keypoints: files have two decimals or more."""


def frozen_frames(measured: RunMeasurements) -> BoolArray:
    """Return in which frames a view's keypoints repeat those of the frame before for _MIN_FROZEN_S or more, (F, V)."""
    frozen, times_s = repeated_frames(measured.observed), measured.times_s
    for column in frozen.T:
        for (each,) in find_objects(label(column)[0]):
            column[each] = times_s[each.stop - 1] - times_s[each.start - 1] >= _MIN_FROZEN_S
    return frozen


def repeated_frames(observed: ObservedJoints) -> BoolArray:
    """Return whether a view's keypoints are those of the frame before, (F, V)."""
    keypoints = np.where(observed.keypoints[..., 2:] > 0.0, observed.keypoints, 0.0)
    same = np.zeros(keypoints.shape[:2], dtype=bool)
    same[:, 1:] = (np.abs(np.diff(keypoints, axis=1)) <= _SAME_PX).all(axis=(2, 3))
    return np.asarray(same.T & observed.shows_person)
