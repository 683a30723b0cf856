"""Feet on the ground: a planted ankle stays where it is, and the body follows (paper C, sections 5 and 7)."""

import numpy as np

from workbench.arrays import FloatArray
from workbench.body.kinematics import joints
from workbench.body.skeleton import Skeleton

ANKLES = ("left_ankle", "right_ankle")
PLANTED_SPEED = 0.6
"""m/s: recorded ankles stay below it while the foot is flat, and pass 1 m/s within a frame or two before and after."""
REACH_M = 0.15
"""Higher above the ground an ankle is not planted however slowly it moves, as at the top of a jump."""
SETTLE = 0.5
"""Part of its distance to the ground's height that a planted ankle loses in a frame."""


class FootContact:
    """Shifts the root of one motion, frame by frame, so that the planted ankle rests on the ground.

    The lower of the ankles that move slower than PLANTED_SPEED, in the motion as it came, is planted. From then on the
    root is shifted so that this ankle stays at the place where it came down, and within a few frames at the ground's
    height, until it moves faster again. The shift then stays: the motion goes on from where it is, so that neither
    taking off nor landing makes a jump. One ankle is held at a time; of two feet on the ground the other may slide.
    Angles are left alone, so that a foot's roll, which the body has no joint for, is lost in the planted ankle's place.

    ground_m: height of a standing person's ankles, m. planted: which of ANKLES is held, None in the air.
    """

    def __init__(self, skeleton: Skeleton, ground_m: float) -> None:
        self._skeleton, self._ground_m = skeleton, ground_m
        self._shift = np.zeros(3)
        self._last: FloatArray | None = None
        self.planted: int | None = None
        self._anchor = np.zeros(3)

    def follow(self, pose: FloatArray, dt_s: float) -> FloatArray:
        """The next pose (P,), `dt_s` seconds after the one before, with its root shifted."""
        ankles = ankle_positions(self._skeleton, pose[None])[0]
        if self._last is not None:
            self._plant(ankles, np.linalg.norm(ankles - self._last, axis=1) / dt_s)
        self._last = ankles
        if self.planted is not None:
            self._anchor[2] += SETTLE * (self._ground_m - self._anchor[2])
            self._shift = self._anchor - ankles[self.planted]
        shifted = pose.copy()
        shifted[:3] += self._shift
        return shifted

    def _plant(self, ankles: FloatArray, speeds: FloatArray) -> None:
        if self.planted is not None and speeds[self.planted] < PLANTED_SPEED:
            return
        places = ankles + self._shift
        slow = (speeds < PLANTED_SPEED) & (places[:, 2] < self._ground_m + REACH_M)
        self.planted = int(np.where(slow, places[:, 2], np.inf).argmin()) if slow.any() else None
        if self.planted is not None:
            self._anchor = places[self.planted].copy()


def ankle_positions(skeleton: Skeleton, poses: FloatArray) -> FloatArray:
    """Both ankles (N, 2, 3), m, of poses (N, P)."""
    both: FloatArray = joints(skeleton, poses)[:, [skeleton.joint(name) for name in ANKLES]]
    return both
