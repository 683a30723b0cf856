"""Annotated or detected joints of a dataset's frames, and the images of one frame."""

from collections.abc import Sequence

import numpy as np

from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.camera import Camera
from workbench.cameras.camera_motion import in_camera
from workbench.cameras.observed_joints import ObservedJoints
from workbench.core.dataset import Dataset
from workbench.core.frame import Frame
from workbench.utils.arrays import ByteArray, FloatArray
from workbench.utils.errors import InputError

_MAX_FRAMES = 300
"""Frames with joints; later ones are not read."""


def observe_joints(dataset: Dataset) -> ObservedJoints:
    """Return a dataset's keypoints, or else its annotations for evaluation or initialization.

    Raises InputError for a dataset without cameras or frames, and as the dataset does.
    """
    info = dataset.info
    if not info.cameras:
        raise InputError(f"{info.name}: expected a dataset with cameras and images, found none")
    rows: list[FloatArray] = []
    times_s: list[float] = []
    images: tuple[ByteArray, ...] = ()
    cameras, seen_by = info.cameras, list[tuple[Camera, ...]]()
    n_best, best, searched = -1, 0, np.zeros(len(info.cameras), bool)
    for position, frame in enumerate(dataset.frames()):
        keypoints = _keypoints(frame)
        if not position and info.initial_annotations is not None and not np.isfinite(keypoints).any():
            keypoints[0] = info.initial_annotations.keypoints[0]
        searched |= [view.keypoints is not None for view in frame.views]
        n_joints = int(np.isfinite(keypoints[..., 0]).sum())
        if n_joints > n_best:
            n_best, best, images = n_joints, len(rows), tuple(view.image for view in frame.views)
            cameras = tuple(view.camera for view in frame.views)
        if n_joints:
            rows.append(keypoints)
            times_s.append(frame.time_s)
            seen_by.append(tuple(view.camera for view in frame.views))
        if len(rows) == _MAX_FRAMES:
            break
    if not images:
        raise InputError(f"{info.name}: expected frames, found none")
    stacked = np.array(rows).reshape(-1, len(info.cameras), len(JOINT_NAMES), 3)
    keypoints = np.moveaxis(stacked, 1, 0)
    turned = _in_cameras(keypoints, seen_by, cameras)
    return ObservedJoints(cameras, keypoints, searched, best, images, np.array(times_s), info.scale, turned)


def _in_cameras(
    keypoints: FloatArray, seen_by: Sequence[Sequence[Camera]], cameras: Sequence[Camera]
) -> FloatArray | None:
    """Return keypoints (V, F, J, 3), seen by cameras that may turn, where `cameras` would see them; None for cameras
    that stand still."""
    if all(camera.is_equal(each) for frame in seen_by for camera, each in zip(cameras, frame, strict=True)):
        return None
    moved = keypoints.copy()
    for t, frame in enumerate(seen_by):
        for v, (camera, each) in enumerate(zip(cameras, frame, strict=True)):
            moved[v, t, :, :2] = in_camera(keypoints[v, t, :, :2], each, camera)
    return moved


def _keypoints(frame: Frame) -> FloatArray:
    """Return a frame's keypoints (V, J, 3), or else the annotations of its ground truth."""
    missing = np.full((len(JOINT_NAMES), 3), np.nan)
    keypoints = np.array([missing if view.keypoints is None else view.keypoints for view in frame.views])
    if frame.truth is not None and frame.truth.annotations is not None and not np.isfinite(keypoints).any():
        keypoints[0] = np.column_stack([frame.truth.annotations, np.isfinite(frame.truth.annotations[:, 0])])
    return keypoints
