"""Interface of datasets: frames, and the sequence's metadata."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, runtime_checkable

from workbench.body.limbs import Body
from workbench.body.shape import Shape
from workbench.cameras.camera import Camera
from workbench.core.frame import AnnotatedFrames, Frame
from workbench.utils.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class SequenceInfo:
    """Metadata of a sequence and of its person, available before inference.

    Parameters
    ----------
    name : short name for plots and tables.
    n_frames : number of frames that `frames` yields.
    rate_hz : frame rate; None for uneven spacing.
    source_rate_hz : frame rate by the source's file, of its frames' times, where a rate is set.
    cameras : cameras that see the person, in the order of the views; empty without images.
    scale : factor by which the source's images are resized.
    shape : body measurements of the person.
    body : tracked body, where it is not the 25-parameter person, such as every joint of a motion file.
    initial_pose : (P,) pose in the first frame.
    initial_annotations : annotated joints of the first frame, and possibly of later ones.
    has_keypoints, has_points : whether frames have keypoints, or points of the body's surface.
    phase_ends : phases of a cyclic motion in the first and the last frame, cycles.
    pose_history : (F, P) poses up to the initial pose, which is the last of them, at rate_hz.
    pose_history_activity : the person's activity in them, such as "walk".
    input_counts : counts from reading the frames' joints, by name, such as people and swapped_sides.
    perturbations : differences of the true person and cameras from these metadata, by name, for the recording.
    camera_motion : what the only camera does, one of `cameras.camera_motion`'s kinds; None where it is not measured.
    video : MP4 file whose frames, numbered as `Frame.index`, are the undistorted images of the only view.
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
    input_counts: Mapping[str, int] = field(default_factory=dict)
    perturbations: Mapping[str, FloatArray] = field(default_factory=dict)
    camera_motion: str | None = None
    video: Path | None = None


class Dataset(Protocol):
    """A sequence of frames and its metadata."""

    @property
    def info(self) -> SequenceInfo:
        """Return the sequence's metadata."""

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in order. A run iterates once (see `FrameCache`), because decoding is expensive."""


@runtime_checkable
class SeparateImages(Protocol):
    """A dataset that has its frames' observations without decoding their images."""

    def frames_without_images(self) -> Iterator[Frame]:
        """Yield the frames of `Dataset.frames` with empty images."""
