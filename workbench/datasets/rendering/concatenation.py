"""Concatenation of motions with blended transitions, such as a walk and a run."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from workbench.body.skeleton import POSE_NAMES
from workbench.motion.pose_sequence import MIN_RUN_CYCLE_S, Motion, gait_events
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

BLEND_S = 0.3  # duration of the transition between two motions
_X, _Y, _Z, _HEADING = range(4)
_PHASE = len(POSE_NAMES)
_PERIODS = np.array([1e9] * 3 + [2.0 * np.pi] * (_PHASE - 3) + [1.0])
"""Period of each number of a row: angles one turn, phases one cycle; lengths are not periodic."""


@dataclass(frozen=True, eq=False)
class _Concatenation:
    """A concatenated motion. clips: (F,) index of the motion with the larger weight in each frame. phases: (F,) gait
    phase, cycles, an increasing whole number where the left thigh is furthest ahead of the right; NaN where a motion
    has no cycle."""

    motion: Motion
    clips: IntArray
    phases: FloatArray


def concatenate(motions: Sequence[Motion], n_frames: int, first_frame: int = 0) -> _Concatenation:
    """Concatenate K motions of one rate in n_frames, each in an equal share of the frames.

    The next motion starts in the same phase of its gait cycle, near its middle. During about BLEND_S seconds the
    motion in the person's own frame (steps ahead and to the left, turns, height, lean and joint angles) is blended from
    one motion to the next, so that position and heading are continuous. Steps and heights are scaled by the length of
    the legs; the shape is the first person's. A single motion is cut, and its poses stay bitwise identical.

    first_frame: frame of the first motion at which the result starts. Raises InputError for a motion that is too short,
    and for fewer than two frames per motion.
    """
    first, n = motions[0], len(motions)
    if n == 1:
        frames = _frame_range(first, first_frame, first_frame + n_frames)
        motion = replace(first, poses=first.poses[frames])
        return _Concatenation(motion, np.zeros(n_frames, dtype=np.int64), gait_phases(first)[frames])
    lengths: IntArray = np.diff(np.round(np.linspace(0, n_frames, n + 1)).astype(np.int64)).astype(np.int64)
    if lengths.min() < 2:
        raise InputError(f"dataset: expected n_frames of at least {2 * n} to concatenate {n} motions, found {n_frames}")
    half = int(np.clip(round(0.5 * BLEND_S * first.rate_hz), 1, lengths.min() // 2))
    ends = lengths + half  # each overlaps with the next one
    ends[-1] -= half
    rows = _person_frame_rows(first, first)[_frame_range(first, first_frame, first_frame + int(ends[0]))]
    for motion, end in zip(motions[1:], ends[1:], strict=True):
        rows = _blended(rows, _person_frame_rows(motion, first), motion, half, int(end))
    metadata: dict[str, Any] = {
        name: " + ".join(dict.fromkeys(str(getattr(motion, name)) for motion in motions))
        for name in ("name", "activity", "source", "sha256", "licence")
    }
    motion = replace(first, poses=_world_poses(rows[:, :_PHASE], first.poses[first_frame]), **metadata)
    return _Concatenation(motion, np.repeat(np.arange(n), lengths), rows[:, _PHASE])


def gait_phases(motion: Motion) -> FloatArray:
    """Return gait phases (F,), cycles, whole numbers at the events where the left thigh is furthest ahead
    (`gait_events`): linear between events, extrapolated at the nearest cycle's rate, NaN for fewer than two events."""
    events, frames = gait_events(motion, MIN_RUN_CYCLE_S), np.arange(len(motion), dtype=np.float64)
    if len(events) < 2:
        return np.full(len(motion), np.nan)
    phases = np.interp(frames, events, np.arange(len(events)))
    early, late = frames < events[0], frames > events[-1]
    phases[early] = (frames[early] - events[0]) / (events[1] - events[0])
    phases[late] += (frames[late] - events[-1]) / (events[-1] - events[-2])
    return phases


def _person_frame_rows(motion: Motion, first: Motion) -> FloatArray:
    """Return rows (F, 26): poses with the steps to the next frame, ahead, left and in heading, instead of position and
    heading, lengths scaled to the legs of the person of `first`; and the phase."""
    legs = (first.shape.thigh + first.shape.calf) / (motion.shape.thigh + motion.shape.calf)
    rows = np.column_stack([motion.poses, gait_phases(motion)])
    c, s = np.cos(motion.poses[:, _HEADING]), np.sin(motion.poses[:, _HEADING])
    steps = np.diff(motion.poses[:, [_X, _Y, _HEADING]], axis=0, append=np.nan)
    steps[-1] = steps[-2]  # the last step repeats the one before
    rows[:, _X], rows[:, _Y] = legs * (c * steps[:, 0] + s * steps[:, 1]), legs * (c * steps[:, 1] - s * steps[:, 0])
    rows[:, _Z], rows[:, _HEADING] = legs * motion.poses[:, _Z], steps[:, 2]
    return rows


def _world_poses(rows: FloatArray, start: FloatArray) -> FloatArray:
    """Return poses (F, 25) from rows (F, 25) in the person's own frame, from the position and heading of `start`."""
    poses = rows.copy()
    poses[:, _HEADING] = start[_HEADING] + np.concatenate([[0.0], np.cumsum(rows[:-1, _HEADING])])
    c, s = np.cos(poses[:-1, _HEADING]), np.sin(poses[:-1, _HEADING])
    ahead, left = rows[:-1, _X], rows[:-1, _Y]
    poses[:, _X] = start[_X] + np.concatenate([[0.0], np.cumsum(c * ahead - s * left)])
    poses[:, _Y] = start[_Y] + np.concatenate([[0.0], np.cumsum(s * ahead + c * left)])
    return poses


def _blended(rows: FloatArray, following: FloatArray, motion: Motion, half: int, end: int) -> FloatArray:
    """Return rows (F, 26) continued by those of `motion`, `following` (M, 26), with 2 · half blended frames and `end`
    frames from the middle of the transition to the end."""
    entry = _entry(rows[-half, _PHASE], following[:, _PHASE], half, end, motion)
    following = following[entry - half : entry + end]
    ending, beginning = rows[-2 * half :], following[: 2 * half]
    following = following + _PERIODS * np.round((ending - beginning).mean(axis=0) / _PERIODS)
    u = (np.arange(2 * half) + 0.5) / (2 * half)
    weight = (u * u * (3.0 - 2.0 * u))[:, None]
    blend = (1.0 - weight) * ending + weight * following[: 2 * half]
    return np.concatenate([rows[: -2 * half], blend, following[2 * half :]])


def _entry(phase: float, phases: FloatArray, before: int, after: int, motion: Motion) -> int:
    """Return the frame of a motion with phases (M,), nearest to its middle, at which the motion is entered.

    Its phase is `phase` within 0.02 cycles (any without cycles), with `before` frames before it and `after` from it on.
    """
    _frame_range(motion, 0, before + after)
    candidates = np.arange(before, len(phases) - after + 1)
    offset = phases[candidates] - phase
    offset = np.nan_to_num(np.abs(offset - np.round(offset)))
    candidates = candidates[offset <= offset.min() + 0.02]
    return int(candidates[np.argmin(np.abs(candidates - 0.5 * (len(phases) - after + before)))])


def _frame_range(motion: Motion, begin: int, end: int) -> slice:
    """Return the slice of frames from `begin` to before `end`; raises InputError for a shorter motion."""
    if end > len(motion):
        duration_s, expected_s = len(motion) / motion.rate_hz, end / motion.rate_hz
        duration = f"lasts {duration_s:.2f} s, expected at least {expected_s:.2f} s"
        raise InputError(f"dataset: motion {motion.name!r} {duration}")
    return slice(begin, end)
