"""The marks of a dataset's frames, and one frame to draw them into."""

from dataclasses import dataclass

import numpy as np

from workbench.arrays import BoolArray, ByteArray, FloatArray, IntArray
from workbench.body.camera import Camera
from workbench.body.skeleton import JOINT_NAMES
from workbench.core.dataset import Dataset
from workbench.core.frame import Frame
from workbench.errors import InputError

MOST_FRAMES = 300
"""With marks; those after them are not looked at."""


@dataclass(frozen=True, eq=False)
class Observed:
    """What V cameras saw in F frames with marks. frames: (F,) their numbers. marks: (V, F, J, 3), [u px, v px, weight],
    NaN where there is none. looked: (V,), whether somebody looked for joints in a camera's images at all. shown:
    the row of the frame with most marks, and its images by camera. Without any marks F is 0, and the images are the
    first frame's."""

    cameras: tuple[Camera, ...]
    frames: IntArray
    marks: FloatArray
    looked: BoolArray
    shown: int
    images: tuple[ByteArray, ...]


def observed(dataset: Dataset) -> Observed:
    """Look through a dataset's frames: at its keypoints, or else at marks it measures errors by, or starts from.

    Raises InputError for a dataset without images, and what the dataset raises.
    """
    known = dataset.known
    rows: list[FloatArray] = []
    numbers: list[int] = []
    best, shown, looked = -1, 0, np.zeros(len(known.cameras), bool)
    images: tuple[ByteArray, ...] = ()
    if not known.cameras:
        raise InputError(f"{known.name}: expected a dataset with cameras and images, found none")
    for position, frame in enumerate(dataset.frames()):
        marks = _marks(frame)
        if not position and known.start_marks is not None and not np.isfinite(marks).any():
            marks[0] = known.start_marks.keypoints[0]
        looked |= [view.keypoints is not None for view in frame.views]
        n_marks = int(np.isfinite(marks[..., 0]).sum())
        if not images or n_marks > best:
            best, images, shown = n_marks, tuple(view.image for view in frame.views), len(rows)
        if n_marks:
            rows.append(marks)
            numbers.append(frame.index)
        if len(rows) == MOST_FRAMES:
            break
    if not images:
        raise InputError(f"{known.name}: expected frames, found none")
    found = np.array(rows) if rows else np.empty((0, len(known.cameras), len(JOINT_NAMES), 3))
    return Observed(known.cameras, np.array(numbers, int), np.moveaxis(found, 1, 0), looked, shown, images)


def _marks(frame: Frame) -> FloatArray:
    """Return the marks (V, J, 3) in a frame."""
    marks = np.full((len(frame.views), len(JOINT_NAMES), 3), np.nan)
    for one, view in zip(marks, frame.views, strict=True):
        if view.keypoints is not None:
            one[:] = view.keypoints
    if frame.truth is not None and frame.truth.marks is not None and not np.isfinite(marks).any():
        marks[0] = np.column_stack([frame.truth.marks, np.isfinite(frame.truth.marks[:, 0])])
    return marks
