"""What every dataset offers: its frames, and what is known before any of them is looked at."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from workbench.body.camera import Camera
from workbench.body.limbs import Body
from workbench.body.shape import Shape
from workbench.core.frame import AnnotatedFrames, Frame
from workbench.utils.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class SequenceInfo:
    """What is known of a clip and its person beforehand.

    name: short, for plots and tables. n_frames: how many `frames` gives. rate_hz: frames a second where they are evenly
    spaced. cameras: those that see the person, in the order of the views; none where there are no images. scale: the
    factor by which the source's images were resized. source_rate_hz: what the source's file says of its rate where
    another is told.
    shape: the person's own measurements. body: the tracked body where it is not the 25-number person, such as every
    joint of a motion file. initial_pose: (P,) in the first frame. initial_annotations: joints marked in the first
    frame, and perhaps in some that follow. has_keypoints, has_points: whether frames show joints or points of the
    surface. phase_ends: of a cyclic motion, cycles, in the first and the last frame. pose_history: (F, P) poses up to
    the start pose, which is the last of them, at rate_hz; lead_in_activity: what the person does in them, such as
    "walk". counted: what was counted while the frames' joints were read, by name, such as people and swapped_sides.
    departures: numbers that say how the person and the camera really shown depart from what is told here, by name; for
    the recording, not for whoever tracks.
    """

    name: str
    n_frames: int
    rate_hz: float | None = None
    source_rate_hz: float | None = None
    cameras: tuple[Camera, ...] = ()
    scale: float = 1.0
    shape: Shape | None = None
    body: Body | None = None
    initial_pose: FloatArray | None = None
    initial_annotations: AnnotatedFrames | None = None
    has_keypoints: bool = False
    has_points: bool = False
    phase_ends: tuple[float, float] | None = None
    pose_history: FloatArray | None = None
    pose_history_activity: str | None = None
    counted: Mapping[str, int] = field(default_factory=dict)
    departures: Mapping[str, FloatArray] = field(default_factory=dict)


class Dataset(Protocol):
    """A sequence of frames, and what is known about the person before it is looked at."""

    @property
    def info(self) -> SequenceInfo:
        """Return what is known beforehand."""

    def frames(self) -> Iterator[Frame]:
        """Return the frames in order. A run opens them once (see `FrameCache`), as decoding is dear."""
