"""The frames of a video in which a person is visible."""

import logging
from itertools import pairwise

import numpy as np

from workbench.utils.arrays import IntArray
from workbench.utils.errors import InputError

log = logging.getLogger(__name__)

MAX_BRIDGE_S = 0.5
"""Longest time without a detection over which a motion is interpolated. With the accelerations of recorded motions, a
standard deviation q = 0.11 rad of second differences at 30 Hz, a joint angle is known to q √(n³ / 192) in the middle of
n frames (a cubic spline's variance): to 0.5 rad after 0.5 s, which is as little as is known of any posture."""


def visible_frames(source: str, detected: IntArray, span: tuple[int, int], rate_hz: float) -> IntArray:
    """Return the numbers of the frames with a person, increasing, and of those in gaps up to MAX_BRIDGE_S.

    Parameters
    ----------
    source : of the frames, for messages.
    detected : (M,) numbers of the frames with a detection, increasing.
    span : numbers of the first and the last frame.
    rate_hz : frames per second.

    Raises
    ------
    InputError
        For no detection in the span.
    """
    detected = detected[(detected >= span[0]) & (detected <= span[1])]
    if not len(detected):
        raise InputError(f"{source}: expected a person in frames {span[0]} to {span[1]}, found none")
    longest = MAX_BRIDGE_S * rate_hz
    gaps = [(int(a) + 1, int(b) - 1) for a, b in pairwise(detected) if b - a - 1 > longest]
    ends = [(span[0], int(detected[0]) - 1), *gaps, (int(detected[-1]) + 1, span[1])]
    frames = np.arange(span[0], span[1] + 1)
    for first, last in ends:
        frames = frames[(frames < first) | (frames > last)]
        if first <= last:
            log.info("%s: the person is not detected in frames %d to %d, which are omitted", source, first, last)
    return frames
