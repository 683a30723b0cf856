"""Walking cycles cut out of motions at gait events and brought to one length."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline

from workbench.arrays import FloatArray
from workbench.body.skeleton import N_ROOT, POSE_NAMES
from workbench.mocap.gait_events import LONGEST_S, SHORTEST_S, gait_events
from workbench.mocap.motion import Motion

CHANNEL_NAMES = ("torso_speed", *POSE_NAMES[N_ROOT:])
"""One cycle's content (paper A, section 6.2): the torso's speed, m/s, and the 19 relative joint angles, rad."""
ANGLES = slice(1, len(CHANNEL_NAMES))  # which channels are the joint angles
ROOT_CHANNELS = ("root_aside", "root_up", "root_heading", "root_pitch", "root_roll")
"""Further content: how the root sways about its even way, m, and turns about its even direction, rad."""


@dataclass(frozen=True, eq=False)
class Cycles:
    """m cycles of C channels at T phases 0, 1/T, … (one cycle is 1).

    curves: (m, T, C), channels named CHANNEL_NAMES, and ROOT_CHANNELS where the root's were asked for. durations_s:
    (m,). sources: the motion each one was cut from.
    """

    curves: FloatArray
    durations_s: FloatArray
    sources: tuple[str, ...]


def walking_cycles(motions: Sequence[Motion], n_phases: int = 64, root: bool = False) -> Cycles:
    """Every whole walking cycle in the motions, resampled to `n_phases` phases (paper A, section 6.2).

    Phase 0 is where the left thigh is furthest ahead of the right. A recorded cycle does not quite close; half the
    gap is taken from each end, linearly in between, so that the curves are periodic (a deviation: the paper does not
    say). Motions without a whole cycle add nothing. The result may be empty. root: with ROOT_CHANNELS, see `root_sway`.
    """
    curves, durations, sources, phases = [], [], [], np.arange(n_phases) / n_phases
    for motion in motions:
        events = gait_events(motion)
        if len(events) < 2:
            continue
        channels = CubicSpline(np.arange(len(motion)), motion_channels(motion))
        for first, last in pairwise(events):
            duration = (last - first) / motion.rate_hz
            if SHORTEST_S <= duration <= LONGEST_S:
                gap = channels(last) - channels(first)
                curve = channels(first + (last - first) * phases) - (phases - 0.5)[:, None] * gap
                curves.append(np.hstack([curve, root_sway(motion, first, last, n_phases)]) if root else curve)
                durations.append(duration)
                sources.append(motion.name)
    shape = (len(curves), n_phases, len(CHANNEL_NAMES) + len(ROOT_CHANNELS) * root)
    return Cycles(np.array(curves).reshape(shape), np.array(durations), tuple(sources))


def motion_channels(motion: Motion) -> FloatArray:
    """The channels (F, C) of a motion: speed over the ground along the heading, m/s, and the joint angles, rad.

    The paper takes the speed's absolute value; the component along the heading does not count sway as progress.
    """
    ground = motion.velocities[:, :2]
    heading = motion.poses[:, POSE_NAMES.index("root_heading")]
    speed = ground[:, 0] * np.cos(heading) + ground[:, 1] * np.sin(heading)
    return np.column_stack([speed, motion.poses[:, N_ROOT:]])


def root_sway(motion: Motion, first: float, last: float, n_phases: int) -> FloatArray:
    """How the root moves about its even way in one cycle, ROOT_CHANNELS (T, 5), each with mean zero over the cycle.

    The even way turns and rises evenly, from what the root does in the mean over the cycle; aside is the integral of
    the velocity across it. What the root does ahead of it is in the torso's speed.
    """
    frames = first + (last - first) * np.arange(n_phases + 1) / n_phases
    root = CubicSpline(np.arange(len(motion)), motion.poses[:, :N_ROOT])(frames)
    ground = CubicSpline(np.arange(len(motion)), motion.velocities[:, :2])(frames)
    even = np.linspace(-0.5, 0.5, n_phases + 1)[:, None] * (root[-1] - root[0])
    swayed = root - even
    swayed -= swayed[:-1].mean(axis=0)
    heading = root[:, 3] - swayed[:, 3]
    across = -ground[:, 0] * np.sin(heading) + ground[:, 1] * np.cos(heading)
    way = np.concatenate([[0.0], np.cumsum(0.5 * (across[1:] + across[:-1]))]) * (frames[1] - frames[0])
    way = way / motion.rate_hz - np.linspace(0.0, 1.0, n_phases + 1) * way[-1] / motion.rate_hz
    aside = way - way[:-1].mean()
    return np.column_stack([aside, swayed[:, 2:]])[:-1]
