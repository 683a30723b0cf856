"""Annotated or detected joints of a dataset's frames, and the images of one frame."""

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
    """Joints of F frames in V cameras; without any joints F is 0.

    Parameters
    ----------
    keypoints : (V, F, J, 3), [u px, v px, weight], NaN for none.
    searched : (V,), whether a camera's images were annotated or searched at all.
    best : row of the frame with most joints.
    images : that frame's images by camera; those of the first frame without any joints.
    """

    cameras: tuple[Camera, ...]
    keypoints: FloatArray
    searched: BoolArray
    best: int
    images: tuple[ByteArray, ...]


def observe_joints(dataset: Dataset) -> ObservedJoints:
    """Return a dataset's keypoints, or else its annotations for evaluation or initialization.

    Raises InputError for a dataset without cameras or frames, and as the dataset does.
    """
    info = dataset.info
    if not info.cameras:
        raise InputError(f"{info.name}: expected a dataset with cameras and images, found none")
    rows: list[FloatArray] = []
    images: tuple[ByteArray, ...] = ()
    n_best, best, searched = -1, 0, np.zeros(len(info.cameras), bool)
    for position, frame in enumerate(dataset.frames()):
        keypoints = _keypoints(frame)
        if not position and info.initial_annotations is not None and not np.isfinite(keypoints).any():
            keypoints[0] = info.initial_annotations.keypoints[0]
        searched |= [view.keypoints is not None for view in frame.views]
        n_joints = int(np.isfinite(keypoints[..., 0]).sum())
        if n_joints > n_best:
            n_best, best, images = n_joints, len(rows), tuple(view.image for view in frame.views)
        if n_joints:
            rows.append(keypoints)
        if len(rows) == _MAX_FRAMES:
            break
    if not images:
        raise InputError(f"{info.name}: expected frames, found none")
    stacked = np.array(rows).reshape(-1, len(info.cameras), len(JOINT_NAMES), 3)
    return ObservedJoints(info.cameras, np.moveaxis(stacked, 1, 0), searched, best, images)


def _keypoints(frame: Frame) -> FloatArray:
    """Return a frame's keypoints (V, J, 3), or else the annotations of its ground truth."""
    missing = np.full((len(JOINT_NAMES), 3), np.nan)
    keypoints = np.array([missing if view.keypoints is None else view.keypoints for view in frame.views])
    if frame.truth is not None and frame.truth.annotations is not None and not np.isfinite(keypoints).any():
        keypoints[0] = np.column_stack([frame.truth.annotations, np.isfinite(frame.truth.annotations[:, 0])])
    return keypoints
