"""What a dataset hands out: frames, the views in them, and the truth where it is known."""

from dataclasses import dataclass

from workbench.body.camera import Camera
from workbench.utils.arrays import BoolArray, ByteArray, FloatArray


@dataclass(frozen=True, eq=False)
class View:
    """What one camera saw. image: (height, width) grey or (height, width, 3) RGB, uint8.

    keypoints: (J, 3) joints marked or detected in the image, [u px, v px, weight 0..1], in the order of JOINT_NAMES and
    NaN for a joint that was not; None where nobody looked for any.
    """

    camera: Camera
    image: ByteArray
    keypoints: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Truth:
    """Ground truth of one frame, each part where it is known.

    pose: (P,). joints: (J, 3), m, in the skeleton's order of joints, NaN for one that is not known. marks: (J, 2)
    marked pixels in the first view, NaN for joints without a mark; marks_visible: (J,) bool, false for a mark on a
    hidden joint. activity: what the person does, such as "walk". cameras: those that really took the views, where the
    views' own are what a calibration made of them; none where they are the same.
    """

    pose: FloatArray | None = None
    joints: FloatArray | None = None
    marks: FloatArray | None = None
    annotations_visible: BoolArray | None = None
    activity: str | None = None
    cameras: tuple[Camera, ...] = ()


@dataclass(frozen=True, eq=False)
class Frame:
    """One time step's observations. index: the frame's number in its source; time_s: its time, s. points: (K, 3)
    observed points of the person's surface, m, in the world, where there are some."""

    index: int
    time_s: float
    views: tuple[View, ...]
    truth: Truth | None = None
    points: FloatArray | None = None


def true_cameras(frame: Frame) -> tuple[Camera, ...]:
    """The cameras that really took a frame's views: those of its truth, or else the views' own."""
    known = () if frame.truth is None else frame.truth.cameras
    return known or tuple(view.camera for view in frame.views)


@dataclass(frozen=True, eq=False)
class AnnotatedFrames:
    """Joints marked in F frames, of which the first is the dataset's first frame, to start from. times_s: (F,), s,
    rising. keypoints: (F, J, 3) as in `View`."""

    times_s: FloatArray
    keypoints: FloatArray
