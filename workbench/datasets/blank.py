"""Dataset of frames without images, for motion synthesis."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from workbench.core.capabilities import START, Traits, component_traits
from workbench.core.checks import RATE, at_least, check
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import Frame
from workbench.core.side_information import INITIAL_POSE, POSE_HISTORY
from workbench.motion.sources import find_motion
from workbench.utils.errors import InputError


@dataclass(eq=False)
class Blank:
    """n_frames frames at rate_hz without views or truth, and a person with an initial pose.

    The initial pose is frame `first_frame`, counted at rate_hz, of a motion (motion, data: see `sources.find_motion`).
    Raises InputError for parameters out of range; `info` does for a motion that does not exist or has no such frame.
    """

    traits: ClassVar[Traits] = component_traits(START, INITIAL_POSE, POSE_HISTORY)

    motion: str = "builtin"
    data: str | None = None
    n_frames: int = 60
    first_frame: int = 15
    rate_hz: float = 30.0

    def __post_init__(self) -> None:
        check("blank", self, n_frames=at_least(1), first_frame=at_least(0), rate_hz=RATE)

    @cached_property
    def info(self) -> SequenceInfo:
        """The motion's person, the initial pose and the poses before it."""
        motion = find_motion(self.motion, data=self.data, rate_hz=self.rate_hz)
        if self.first_frame >= len(motion):
            frames = f"{len(motion)} frames at {self.rate_hz:g} Hz, expected more than first_frame = {self.first_frame}"
            raise InputError(f"blank: motion {self.motion!r} has {frames}")
        pose_history = motion.poses[: self.first_frame + 1]
        return SequenceInfo(
            name=f"after {motion.name}", n_frames=self.n_frames, rate_hz=self.rate_hz, shape=motion.shape,
            initial_pose=pose_history[-1], pose_history=pose_history, pose_history_activity=motion.activity,
        )  # fmt: skip

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in order, counted from 0."""
        for index in range(self.n_frames):
            yield Frame(index, index / self.rate_hz, ())
