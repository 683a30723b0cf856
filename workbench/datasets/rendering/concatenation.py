"""Motions joined end to end: someone walks and then runs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from workbench.body.skeleton import POSE_NAMES
from workbench.motion.pose_sequence import MIN_RUN_CYCLE_S, Motion, gait_events
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

BLEND_S = 0.3  # how long one motion takes to become the next
_X, _Y, _Z, _HEADING = range(4)
_PHASE = len(POSE_NAMES)
_PERIODS = np.array([1e9] * 3 + [2.0 * np.pi] * (_PHASE - 3) + [1.0])
"""After how much a number of a row is the same again: angles after a turn, a phase after a cycle, lengths never."""


@dataclass(frozen=True, eq=False)
class _Spliced:
    """A motion and what it is made of. clips: (F,) number of the clip that each frame is mostly of. phases: (F,) place
    in the gait cycle, cycles, rising through whole numbers where the left thigh is furthest ahead of the right; NaN
    where a clip has no cycle."""

    motion: Motion
    clips: IntArray
    phases: FloatArray


def splice(motions: Sequence[Motion], n_frames: int, first_frame: int = 0, blend_s: float = BLEND_S) -> _Spliced:
    """n_frames in which K motions of one rate take even turns, the first one from `first_frame` on.

    The next motion is entered in the same phase of its cycle, near its middle, and over about `blend_s` seconds what
    the person does in their own frame (steps ahead and to the left, turns, height, lean and joint angles) passes from
    one motion to the next, so that place and heading are continuous. Steps and heights are scaled by the length of the
    legs; the shape is the first person's. A single motion is only cut, to the bit. Raises InputError for a motion that
    is too short and for turns of less than two frames.
    """
    first, n = motions[0], len(motions)
    if n == 1:
        kept = _stretch(first, first_frame, first_frame + n_frames)
        motion = replace(first, poses=first.poses[kept])
        return _Spliced(motion, np.zeros(n_frames, dtype=np.int64), gait_phases(first)[kept])
    turns: IntArray = np.diff(np.round(np.linspace(0, n_frames, n + 1)).astype(np.int64)).astype(np.int64)
    if turns.min() < 2:
        raise InputError(f"splice: {n} motions need {2 * n} frames or more, found {n_frames}")
    half = int(np.clip(round(0.5 * blend_s * first.rate_hz), 1, turns.min() // 2))
    ends = turns + half  # each goes on while the next one comes in
    ends[-1] -= half
    rows = _own_frame(first, first)[_stretch(first, first_frame, first_frame + int(ends[0]))]
    for motion, end in zip(motions[1:], ends[1:], strict=True):
        rows = _joined(rows, _own_frame(motion, first), motion, half, int(end))
    words: dict[str, Any] = {
        word: " + ".join(dict.fromkeys(str(getattr(motion, word)) for motion in motions))
        for word in ("name", "activity", "source", "sha256", "licence")
    }
    motion = replace(first, poses=_in_the_world(rows[:, :_PHASE], first.poses[first_frame]), **words)
    return _Spliced(motion, np.repeat(np.arange(n), turns), rows[:, _PHASE])


def gait_phases(motion: Motion) -> FloatArray:
    """Find the place in the gait cycle (F,), cycles, whole where the left thigh is furthest ahead (`gait_events`):
    linear between those events and, at the nearest cycle's rate, beyond them; NaN without two of them."""
    events, frames = gait_events(motion, MIN_RUN_CYCLE_S), np.arange(len(motion), dtype=np.float64)
    if len(events) < 2:
        return np.full(len(motion), np.nan)
    phases = np.interp(frames, events, np.arange(len(events)))
    early, late = frames < events[0], frames > events[-1]
    phases[early] = (frames[early] - events[0]) / (events[1] - events[0])
    phases[late] += (frames[late] - events[-1]) / (events[-1] - events[-2])
    return phases


def _own_frame(motion: Motion, first: Motion) -> FloatArray:
    """Rows (F, 26): poses with the steps to the next frame, ahead, left and round, in place of place and heading,
    lengths scaled to the legs of the person of `first`; and the phase."""
    legs = (first.shape.thigh + first.shape.calf) / (motion.shape.thigh + motion.shape.calf)
    rows = np.column_stack([motion.poses, gait_phases(motion)])
    c, s = np.cos(motion.poses[:, _HEADING]), np.sin(motion.poses[:, _HEADING])
    steps = np.diff(motion.poses[:, [_X, _Y, _HEADING]], axis=0, append=np.nan)
    steps[-1] = steps[-2]  # the last frame goes on as the one before
    rows[:, _X], rows[:, _Y] = legs * (c * steps[:, 0] + s * steps[:, 1]), legs * (c * steps[:, 1] - s * steps[:, 0])
    rows[:, _Z], rows[:, _HEADING] = legs * motion.poses[:, _Z], steps[:, 2]
    return rows


def _in_the_world(rows: FloatArray, start: FloatArray) -> FloatArray:
    """The poses (F, 25) that rows (F, 25) in the person's own frame lead to from the place and heading of `start`."""
    poses = rows.copy()
    poses[:, _HEADING] = start[_HEADING] + np.concatenate([[0.0], np.cumsum(rows[:-1, _HEADING])])
    c, s = np.cos(poses[:-1, _HEADING]), np.sin(poses[:-1, _HEADING])
    ahead, left = rows[:-1, _X], rows[:-1, _Y]
    poses[:, _X] = start[_X] + np.concatenate([[0.0], np.cumsum(c * ahead - s * left)])
    poses[:, _Y] = start[_Y] + np.concatenate([[0.0], np.cumsum(s * ahead + c * left)])
    return poses


def _joined(rows: FloatArray, following: FloatArray, motion: Motion, half: int, end: int) -> FloatArray:
    """Rows (F, 26) whose last 2 · half pass into those of `motion`, (M, 26), which end `end` after the middle."""
    entry = _entry(rows[-half, _PHASE], following[:, _PHASE], half, end, motion)
    following = following[entry - half : entry + end]
    ending, beginning = rows[-2 * half :], following[: 2 * half]
    following = following + _PERIODS * np.round((ending - beginning).mean(axis=0) / _PERIODS)
    u = (np.arange(2 * half) + 0.5) / (2 * half)
    weight = (u * u * (3.0 - 2.0 * u))[:, None]
    blend = (1.0 - weight) * ending + weight * following[: 2 * half]
    return np.concatenate([rows[: -2 * half], blend, following[2 * half :]])


def _entry(phase: float, phases: FloatArray, before: int, after: int, motion: Motion) -> int:
    """The frame nearest the middle of a motion of phases (M,) that is in `phase` to within 0.02 cycles, or any without
    cycles, with `before` frames before it and `after` from it on."""
    _stretch(motion, 0, before + after)
    possible = np.arange(before, len(phases) - after + 1)
    offset = phases[possible] - phase
    offset = np.nan_to_num(np.abs(offset - np.round(offset)))
    possible = possible[offset <= offset.min() + 0.02]
    return int(possible[np.argmin(np.abs(possible - 0.5 * (len(phases) - after + before)))])


def _stretch(motion: Motion, begin: int, end: int) -> slice:
    """The frames from `begin` to before `end`; InputError where the motion has fewer."""
    if end > len(motion):
        found, wanted = len(motion) / motion.rate_hz, end / motion.rate_hz
        raise InputError(f"dataset: motion {motion.name!r} lasts {found:.2f} s, expected at least {wanted:.2f} s of it")
    return slice(begin, end)
