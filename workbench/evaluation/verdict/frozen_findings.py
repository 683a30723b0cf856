"""Findings on detections that repeat although time goes on: frozen stretches, and duplicated frames."""

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import find_objects, label

from workbench.cameras.observed_joints import ObservedJoints
from workbench.evaluation.verdict.run_measurements import RunMeasurements
from workbench.evaluation.verdict.time_findings import level_of_share
from workbench.utils.arrays import BoolArray
from workbench.utils.finding import NOTE, Finding

_MIN_FROZEN_S = 0.25
"""Shortest frozen stretch, half a step of a walk. A person who stands still is no frozen one: by the images' noise a
detector's joints differ from frame to frame, by a tenth of a pixel and more."""
_SAME_PX = 0.01
"""Largest difference of equal keypoints: files have two decimals or more."""
_MAX_DUPLICATES = 0.2
"""Fraction of the frames that may repeat the one before: with more, more than every fifth speed is zero. A film of
24 Hz at 30 Hz has a fifth."""


def frozen_findings(measured: RunMeasurements) -> Iterator[Finding]:
    """Yield frozen stretches and duplicated frames, by camera."""
    repeats = repeated_frames(measured.observed)
    for v, name in enumerate(measured.cameras):
        n, repeated = int(measured.observed.shows_person[:, v].sum()), repeats[:, v]
        stretches = [
            (each.stop - each.start, each.start - 1, each.stop - 1)
            for (each,) in find_objects(label(repeated)[0])
            if measured.times_s[each.stop - 1] - measured.times_s[each.start - 1] >= _MIN_FROZEN_S
        ]
        camera = f"{name}: " if len(measured.cameras) > 1 else ""
        n_frozen = sum(length for length, _, _ in stretches)
        if n and (level := level_of_share(1.0 - n_frozen / n)) != NOTE:
            _, first, last = max(stretches)
            where = f"frozen from frame {measured.frames[first]} to {measured.frames[last]}"
            text = f"{camera}the keypoints of {n_frozen} of {n} frames are those of the frame before, {where}"
            yield Finding("frozen frames", text, level)
        n_duplicates = int(repeated.sum()) - n_frozen
        if n_duplicates > _MAX_DUPLICATES * n:
            text = f"{n_duplicates} of {n} frames repeat the keypoints of the one before: the source has a lower rate"
            yield Finding("repeated frames", f"{camera}{text}")


def repeated_frames(observed: ObservedJoints) -> BoolArray:
    """Return whether a view's keypoints are those of the frame before, (F, V)."""
    keypoints = np.where(observed.keypoints[..., 2:] > 0.0, observed.keypoints, 0.0)
    same = np.zeros(keypoints.shape[:2], dtype=bool)
    same[:, 1:] = (np.abs(np.diff(keypoints, axis=1)) <= _SAME_PX).all(axis=(2, 3))
    return np.asarray(same.T & observed.shows_person)
