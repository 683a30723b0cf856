"""Cycles of several activities, segmented from motions and time-normalised by slerp (paper D, section 3.2)."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy
from tqdm import tqdm

from workbench.body.kinematics import forward
from workbench.body.skeleton import N_ROOT, PARTS, Skeleton, person_skeleton
from workbench.motion.pose_sequence import MAX_CYCLE_S, MIN_RUN_CYCLE_S, Motion, gait_events
from workbench.motion.retarget import continuous_angles
from workbench.utils.arrays import BoolArray, FloatArray
from workbench.utils.errors import InputError

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class ActivityCycles:
    """n cycles of C joint angles at T phases 0, 1/T, … (one cycle is 1).

    angles : C names. curves : (n, T, C), rad, periodic. durations_s : (n,). activities : n labels. sources : n motions.
    """

    angles: tuple[str, ...]
    curves: FloatArray
    durations_s: FloatArray
    activities: tuple[str, ...]
    sources: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.curves)

    def only(self, mask: BoolArray) -> "ActivityCycles":
        """Return the cycles in a mask (n,)."""
        rows = np.flatnonzero(mask)
        return replace(
            self, curves=self.curves[rows], durations_s=self.durations_s[rows],
            activities=tuple(self.activities[k] for k in rows), sources=tuple(self.sources[k] for k in rows),
        )  # fmt: skip

    def of_angles(self, names: Sequence[str]) -> "ActivityCycles":
        """Return the cycles with some of their angles: by name or by body part, see `skeleton.PARTS`.

        Raises InputError if a name matches none of the angles, or there is no name.
        """
        matches = {name: {name, *PARTS.get(name, ())} & set(self.angles) for name in names}
        unknown = [name for name in names if not matches[name]]
        if unknown or not matches:
            options, found = f"({', '.join(PARTS)}) or some of {', '.join(self.angles)}", [*unknown, "none"][0]
            raise InputError(f"activities: angles: expected parts of the body {options}, found {found!r}")
        chosen = set[str]().union(*matches.values())
        columns = [k for k, name in enumerate(self.angles) if name in chosen]
        return replace(self, angles=tuple(self.angles[k] for k in columns), curves=self.curves[:, :, columns])


PosedSkeleton = tuple[Skeleton, FloatArray]
"""A skeleton and its poses (F, P) in the frames of a motion."""


def person_poses(motion: Motion) -> PosedSkeleton:
    """Return the person's skeleton and the 25-parameter poses of a motion."""
    return person_skeleton(motion.shape), motion.poses


def activity_cycles(
    motions: Sequence[Motion], *, n_phases: int = 64, max_per_clip: int = 4,
    poses_of: Callable[[Motion], PosedSkeleton] = person_poses,
) -> ActivityCycles:  # fmt: skip
    """Return whole cycles of walking, running and similar activities.

    Phase 0 is where the left thigh is furthest ahead of the right. Motions without a whole cycle cause a warning.

    Parameters
    ----------
    motions : to segment.
    n_phases : T.
    max_per_clip : maximum number of cycles of each motion.
    poses_of : returns the skeleton and poses to segment; gait events are always the person's.

    Raises
    ------
    InputError : no motion has a cycle, and as `cut`.
    """
    segments, without = [], []
    for motion in tqdm(motions, desc="cycles", unit="clip", disable=None):
        segment = cut(
            *poses_of(motion), gait_events(motion, MIN_RUN_CYCLE_S), rate_hz=motion.rate_hz,
            activity=motion.activity, source=motion.name, n_phases=n_phases, max_cycles=max_per_clip,
        )  # fmt: skip
        if len(segment):
            segments.append(segment)
        else:
            without.append(motion.name)
    if without:
        log.warning("activities: %d motions without a whole cycle excluded: %s", len(without), ", ".join(without))
    if not segments:
        raise InputError(
            f"activities: expected walking, running or a similar activity, found no cycle in {len(motions)} motions"
        )
    return concatenated(segments)


def cut(
    skeleton: Skeleton, poses: FloatArray, events: FloatArray, *, rate_hz: float, activity: str, source: str,
    n_phases: int = 64, max_cycles: int = 4,
) -> ActivityCycles:  # fmt: skip
    """Return the cycles between gait events of a motion of any skeleton; possibly none.

    The paper has four cycles of every person at every speed. Of a clip with more, `max_cycles` evenly spaced ones are
    used, so that long clips have no more weight.

    Parameters
    ----------
    poses : (F, P).
    events : (K,), in frames.
    rate_hz, activity, source : of the motion.
    n_phases : T.
    max_cycles : maximum number of cycles.

    Raises
    ------
    InputError : fewer than one cycle or two phases, and as `normalised`.
    """
    if n_phases < 2 or max_cycles < 1:
        raise InputError(f"activities: expected 2 phases and 1 cycle or more, found {n_phases} and {max_cycles}")
    spans = np.stack([events[:-1], events[1:]], axis=1)
    seconds = np.diff(spans, axis=1)[:, 0] / rate_hz
    spans = spans[(seconds >= MIN_RUN_CYCLE_S) & (seconds <= MAX_CYCLE_S)]
    n = min(max_cycles, len(spans))
    spans = spans[((np.arange(n) + 0.5) * len(spans) / max(n, 1)).astype(np.int64)]
    return ActivityCycles(
        angles=skeleton.dof_names[N_ROOT:], curves=normalised(skeleton, poses, spans, n_phases),
        durations_s=np.diff(spans, axis=1)[:, 0] / rate_hz, activities=(activity,) * n, sources=(source,) * n,
    )  # fmt: skip


def concatenated(parts: Sequence[ActivityCycles]) -> ActivityCycles:
    """Return all cycles of several sets; raises InputError if their angles differ."""
    if other := [part for part in parts if part.angles != parts[0].angles]:
        source = next(iter(other[0].sources), "a motion")
        raise InputError(f"activities: expected one skeleton, found other angles in {source}")
    return ActivityCycles(
        angles=parts[0].angles,
        curves=np.concatenate([part.curves for part in parts]),
        durations_s=np.concatenate([part.durations_s for part in parts]),
        activities=tuple(name for part in parts for name in part.activities),
        sources=tuple(name for part in parts for name in part.sources),
    )


def normalised(skeleton: Skeleton, poses: FloatArray, spans: FloatArray, n_phases: int) -> FloatArray:
    """Return time-normalised cycles (K, T, P − 6) of the joint angles, rad.

    Every joint's rotation is interpolated by slerp along the shorter arc between two frames: q and −q are the same
    rotation, so their signs are first put in one hemisphere. The rotations are converted back into the skeleton's
    angles, continuous and near the middle of their limits (`retarget.continuous_angles`). A recorded cycle does not
    quite close; the gap is distributed linearly, half of it at each end (a deviation: the paper does not specify this).
    For a joint with two axes, slerp leaves the rotations about them by less than the squared rotation per frame; the
    nearest angles are used.

    Parameters
    ----------
    poses : (F, P).
    spans : (K, 2), first and last frame of each cycle, not necessarily whole.
    n_phases : T.

    Raises
    ------
    InputError : consecutive axes of a joint are not perpendicular, or there are more than three.
    """
    phases = np.arange(n_phases + 1) / n_phases
    frames = spans[:, :1] + (spans[:, 1:] - spans[:, :1]) * phases
    rotations = forward(skeleton, poses).rotations
    curves = np.empty((*frames.shape, poses.shape[1] - N_ROOT))
    for joint in np.unique(skeleton.dof_joints[N_ROOT:]):
        columns = N_ROOT + np.flatnonzero(skeleton.dof_joints[N_ROOT:] == joint)
        relative = rotations[:, skeleton.parents[joint]].swapaxes(1, 2) @ rotations[:, joint]
        between = scipy.spatial.transform.Slerp(
            np.arange(len(poses)), scipy.spatial.transform.Rotation.from_matrix(relative)
        )
        axes = _axes(skeleton.names[joint], skeleton.dof_axes[columns])
        for curve, times in zip(curves, frames, strict=True):
            curve[:, columns - N_ROOT] = _angles(between(times), axes, skeleton.limits[columns])
    gaps = curves[:, -1:] - curves[:, :1]
    return curves[:, :-1] - (phases[:-1, None] - 0.5) * gaps


def _axes(joint: str, axes: FloatArray) -> FloatArray:
    """Return three axes (3, 3), each perpendicular to the next, that begin with a joint's one to three (k, 3)."""
    if len(axes) > 3 or any(abs(first @ second) > 1e-9 for first, second in pairwise(axes)):
        raise InputError(f"skeleton: expected rotations of {joint} about 1 to 3 axes, each perpendicular to the last")
    if len(axes) == 1:
        axes = np.vstack([axes, np.cross(axes[0], np.eye(3)[np.argmin(np.abs(axes[0]))])])
        axes[1] /= np.linalg.norm(axes[1])
    return axes if len(axes) == 3 else np.vstack([axes, np.cross(axes[0], axes[1])])


def _angles(rotations: "scipy.spatial.transform.Rotation", axes: FloatArray, limits: FloatArray) -> FloatArray:
    """Return angles (F, k), rad, of rotations about the first k of three axes, near the limits (k, 2)."""
    all_limits = np.zeros((3, 2))
    all_limits[: len(limits)] = limits
    return continuous_angles(rotations.as_davenport(axes, "intrinsic"), all_limits)[:, : len(limits)]
