"""The joints that a dataset's frames have annotated or detected, and one frame to draw them into."""

from dataclasses import dataclass

import numpy as np

from workbench.body.camera import Camera
from workbench.body.skeleton import JOINT_NAMES
from workbench.core.dataset import Dataset
from workbench.core.frame import Frame
from workbench.utils.arrays import BoolArray, ByteArray, FloatArray
from workbench.utils.errors import InputError

_MAX_FRAMES = 300
"""Frames with joints; later ones are not read."""


@dataclass(frozen=True, eq=False)
class ObservedJoints:
    """Joints of F frames in V cameras. marks: (V, F, J, 3), [u px, v px, weight], NaN for none. searched: (V,), whether
    a camera's images were annotated or searched at all. shown: the row of the frame with most marks; images: its images
    by camera. Without any joints F is 0, and the images are those of the first frame."""

    cameras: tuple[Camera, ...]
    marks: FloatArray
    searched: BoolArray
    shown: int
    images: tuple[ByteArray, ...]


def observe_joints(dataset: Dataset) -> ObservedJoints:
    """Collect a dataset's keypoints, or else the annotations by which it measures errors or starts.

    Raises InputError for a dataset without cameras or frames, and as the dataset does.
    """
    known = dataset.info
    if not known.cameras:
        raise InputError(f"{known.name}: expected a dataset with cameras and images, found none")
    rows: list[FloatArray] = []
    images: tuple[ByteArray, ...] = ()
    most, shown, searched = -1, 0, np.zeros(len(known.cameras), bool)
    for position, frame in enumerate(dataset.frames()):
        marks = _marks(frame)
        if not position and known.initial_annotations is not None and not np.isfinite(marks).any():
            marks[0] = known.initial_annotations.keypoints[0]
        searched |= [view.keypoints is not None for view in frame.views]
        n_marks = int(np.isfinite(marks[..., 0]).sum())
        if n_marks > most:
            most, shown, images = n_marks, len(rows), tuple(view.image for view in frame.views)
        if n_marks:
            rows.append(marks)
        if len(rows) == _MAX_FRAMES:
            break
    if not images:
        raise InputError(f"{known.name}: expected frames, found none")
    all_marks = np.array(rows).reshape(-1, len(known.cameras), len(JOINT_NAMES), 3)
    return ObservedJoints(known.cameras, np.moveaxis(all_marks, 1, 0), searched, shown, images)


def _marks(frame: Frame) -> FloatArray:
    """Return the marks (V, J, 3) of a frame: keypoints, or else the annotations of the ground truth."""
    nothing = np.full((len(JOINT_NAMES), 3), np.nan)
    marks = np.array([nothing if view.keypoints is None else view.keypoints for view in frame.views])
    if frame.truth is not None and frame.truth.marks is not None and not np.isfinite(marks).any():
        marks[0] = np.column_stack([frame.truth.marks, np.isfinite(frame.truth.marks[:, 0])])
    return marks
