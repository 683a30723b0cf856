"""Frames of a dataset: the views of the cameras, and the ground truth where it is available."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from workbench.cameras.camera import Camera
from workbench.utils.arrays import BoolArray, ByteArray, FloatArray

HUMANEVA_HEAD_M = 0.316103
"""Distance of HumanEva's marker at the top of the head from the thorax, along the axis of the head."""
NO_IMAGE: ByteArray = np.empty((0, 0), dtype=np.uint8)


@dataclass(frozen=True, eq=False)
class View:
    """One camera's observation. image: (height, width) grey or (height, width, 3) RGB, uint8.

    keypoints: (J, 3) annotated or detected joints, [u px, v px, weight 0..1], in the order of JOINT_NAMES, NaN for a
    joint without one; None where the image was neither annotated nor searched.

    world_landmarks: (J, 3) of a detector, m, relative positions of the joints along the axes of a camera that looks at
    the person, x right, y down, z away from the camera, NaN for a joint without one; None for a detector without them.
    Their size is that of an average person.

    feet: (4, 3) detected ends of the feet, FOOT_POINTS, as `keypoints`; None for a detector without them.
    """

    camera: Camera
    image: ByteArray
    keypoints: FloatArray | None = None
    world_landmarks: FloatArray | None = None
    feet: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Truth:
    """Ground truth of one frame; None for unknown quantities.

    Parameters
    ----------
    pose : (P,).
    joints : (J, 3), m, in the skeleton's order of joints; NaN for an unknown joint.
    virtual_markers : (J, 2, 3), m, of HumanEva: the ends of the limbs that meet in a joint, see `virtual_markers`.
    annotations : (J, 2) annotated pixels in the first view; NaN for joints without an annotation.
    annotations_visible : (J,) bool, false for an annotation of an occluded joint.
    activity : the person's activity, such as "walk".
    cameras : true cameras of the views, where the views' own have calibration errors; empty where both are equal.
    """

    pose: FloatArray | None = None
    joints: FloatArray | None = None
    virtual_markers: FloatArray | None = None
    annotations: FloatArray | None = None
    annotations_visible: BoolArray | None = None
    activity: str | None = None
    cameras: tuple[Camera, ...] = ()


@dataclass(frozen=True, eq=False)
class Frame:
    """One time step's observations. index: number of the frame in its source. time_s: time, s. points: (K, 3) observed
    points of the person's surface in the world, m; None without any."""

    index: int
    time_s: float
    views: tuple[View, ...]
    truth: Truth | None = None
    points: FloatArray | None = None

    @property
    def without_images(self) -> "Frame":
        """The frame with empty images, for computations that keep all frames."""
        return replace(self, views=tuple(replace(view, image=NO_IMAGE) for view in self.views))


def repeatable(frames: Iterable[Frame]) -> Iterable[Frame]:
    """Return frames for several iterations: themselves, or those of an iterator as a list."""
    return list(frames) if iter(frames) is frames else frames


def true_cameras(frame: Frame) -> tuple[Camera, ...]:
    """Return the true cameras of a frame's views: those of the ground truth, or else the views' own."""
    cameras = () if frame.truth is None else frame.truth.cameras
    return cameras or tuple(view.camera for view in frame.views)


@dataclass(frozen=True, eq=False)
class AnnotatedFrames:
    """Annotated joints in F frames for initialization, the first of which is the dataset's first frame. times_s: (F,),
    s, increasing. keypoints: (F, J, 3) as in `View`."""

    times_s: FloatArray
    keypoints: FloatArray
