"""Frames without images, for motion that is made up."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from workbench.arrays import FloatArray
from workbench.body.shape import Shape
from workbench.datasets.frame import Frame
from workbench.datasets.motions import find_motion
from workbench.errors import InputError
from workbench.mocap.motion import Motion


@dataclass(frozen=True)
class Blank:
    """n_frames frames at rate_hz without views or truth, and a person to start from.

    motion, data: see `motions.find_motion`; the person stands as in its frame `first_frame`, counted at rate_hz.
    Raises InputError for parameters out of range and a motion that cannot be found or has no such frame.
    """

    motion: str = "builtin"
    data: str | None = None
    n_frames: int = 60
    first_frame: int = 15
    rate_hz: float = 30.0

    def __post_init__(self) -> None:
        if self.n_frames < 1 or self.first_frame < 0 or not 0.0 < self.rate_hz < np.inf:
            raise InputError(
                "blank: expected n_frames of at least 1, first_frame of at least 0 and a positive rate_hz, "
                f"found {self.n_frames}, {self.first_frame}, {self.rate_hz}"
            )
        _ = self.lead_in  # finds the motion, so that mistakes show before the first frame

    @property
    def name(self) -> str:
        """The motion's name."""
        return f"after {self.lead_in.name}"

    @property
    def scale(self) -> float:
        """1: there are no images."""
        return 1.0

    @property
    def shape(self) -> Shape:
        """The measurements of the motion's person."""
        return self.lead_in.shape

    @property
    def start_pose(self) -> FloatArray:
        """The pose (P,) to start from."""
        last: FloatArray = self.lead_in.poses[-1]
        return last

    @property
    def start_marks(self) -> None:
        """There are none: the start pose is known."""
        return None

    @cached_property
    def lead_in(self) -> Motion:
        """The motion from its beginning up to the starting pose, at this dataset's rate."""
        motion = find_motion(self.motion, data=self.data, rate_hz=self.rate_hz)
        if self.first_frame >= len(motion):
            raise InputError(
                f"blank: motion {self.motion!r} has {len(motion)} frames at {self.rate_hz:g} Hz, "
                f"expected more than first_frame = {self.first_frame}"
            )
        return replace(motion, poses=motion.poses[: self.first_frame + 1])

    def __len__(self) -> int:
        return self.n_frames

    def frames(self) -> Iterator[Frame]:
        """The frames in order, counted from 0."""
        for index in range(self.n_frames):
            yield Frame(index, index / self.rate_hz, ())
