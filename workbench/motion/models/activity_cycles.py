"""Cycles of several activities, cut from motions and brought to one length by slerp (paper D, section 3.2)."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy
from tqdm import tqdm

from workbench.body.kinematics import forward
from workbench.body.skeleton import N_ROOT, PARTS, Skeleton, person_skeleton
from workbench.motion.pose_sequence import LONGEST_S, SHORTEST_RUN_S, Motion, gait_events
from workbench.motion.retarget import continuous_turns
from workbench.utils.arrays import BoolArray, FloatArray
from workbench.utils.errors import InputError

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class ActivityCycles:
    """n cycles of C joint angles at T phases 0, 1/T, … (one cycle is 1).

    angles: C names. curves: (n, T, C), rad, periodic. durations_s: (n,). activities: n labels. sources: n motions.
    """

    angles: tuple[str, ...]
    curves: FloatArray
    durations_s: FloatArray
    activities: tuple[str, ...]
    sources: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.curves)

    def only(self, kept: BoolArray) -> "ActivityCycles":
        """The cycles that are kept (n,)."""
        numbers = np.flatnonzero(kept)
        return replace(
            self, curves=self.curves[numbers], durations_s=self.durations_s[numbers],
            activities=tuple(self.activities[k] for k in numbers), sources=tuple(self.sources[k] for k in numbers),
        )  # fmt: skip

    def of_angles(self, names: Sequence[str]) -> "ActivityCycles":
        """Keep some angles of the cycles only: their names or those of parts of the body, see `skeleton.PARTS`.

        Raises InputError for a name that stands for none of the angles, or no name.
        """
        wanted = {name: {name, *PARTS.get(name, ())} & set(self.angles) for name in names}
        unknown = [name for name in names if not wanted[name]]
        if unknown or not wanted:
            known, found = f"({', '.join(PARTS)}) or some of {', '.join(self.angles)}", [*unknown, "none"][0]
            raise InputError(f"activities: angles: expected parts of the body {known}, found {found!r}")
        chosen = set[str]().union(*wanted.values())
        columns = [k for k, name in enumerate(self.angles) if name in chosen]
        return replace(self, angles=tuple(self.angles[k] for k in columns), curves=self.curves[:, :, columns])


Followed = tuple[Skeleton, FloatArray]
"""A skeleton and its poses (F, P) in every frame of a motion."""


def followed_person(motion: Motion) -> Followed:
    """The motion as it is: the person's 25 numbers."""
    return person_skeleton(motion.shape), motion.poses


def activity_cycles(
    motions: Sequence[Motion], *, n_phases: int = 64, most_per_clip: int = 4,
    followed: Callable[[Motion], Followed] = followed_person,
) -> ActivityCycles:  # fmt: skip
    """Whole cycles of walking, running and their like in the motions, at most `most_per_clip` of each.

    followed: gives the skeleton and the poses to cut cycles from; the gait's events are always the person's.
    Phase 0 is where the left thigh is furthest ahead of the right. Motions without a whole cycle are named in a
    warning. Raises InputError when there is none in any, and as `cut`.
    """
    parts, without = [], []
    for motion in tqdm(motions, desc="cycles", unit="clip", disable=None):
        part = cut(
            *followed(motion), gait_events(motion, SHORTEST_RUN_S), rate_hz=motion.rate_hz,
            activity=motion.activity, source=motion.name, n_phases=n_phases, most=most_per_clip,
        )  # fmt: skip
        if len(part):
            parts.append(part)
        else:
            without.append(motion.name)
    if without:
        log.warning("activities: %d motions without a whole cycle left out: %s", len(without), ", ".join(without))
    if not parts:
        raise InputError(f"activities: expected walking, running or the like, found no cycle in {len(motions)} motions")
    return joined(parts)


def cut(
    skeleton: Skeleton, poses: FloatArray, events: FloatArray, *, rate_hz: float, activity: str, source: str,
    n_phases: int = 64, most: int = 4,
) -> ActivityCycles:  # fmt: skip
    """The cycles between the events (K,), in frames, of poses (F, P) of any skeleton; perhaps none.

    The paper has four cycles of every person at every speed; of a clip with more, `most` of them spread evenly over it
    are taken, so that long clips outweigh none. Raises InputError below one cycle or two phases, and as `normalised`.
    """
    if n_phases < 2 or most < 1:
        raise InputError(f"activities: expected 2 phases and 1 cycle or more, found {n_phases} and {most}")
    spans = np.stack([events[:-1], events[1:]], axis=1)
    seconds = np.diff(spans, axis=1)[:, 0] / rate_hz
    spans = spans[(seconds >= SHORTEST_RUN_S) & (seconds <= LONGEST_S)]
    n = min(most, len(spans))
    spans = spans[((np.arange(n) + 0.5) * len(spans) / max(n, 1)).astype(np.int64)]
    return ActivityCycles(
        angles=skeleton.dof_names[N_ROOT:], curves=normalised(skeleton, poses, spans, n_phases),
        durations_s=np.diff(spans, axis=1)[:, 0] / rate_hz, activities=(activity,) * n, sources=(source,) * n,
    )  # fmt: skip


def joined(parts: Sequence[ActivityCycles]) -> ActivityCycles:
    """All cycles of several sets. Raises InputError when they are of different angles."""
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
    """Cycles (K, T, P − 6) of the joint angles, rad, of poses (F, P) between the frames spans (K, 2), whole or not.

    Every joint's rotation is interpolated by slerp, which takes the shorter way between two frames: q and −q are one
    rotation, so their signs are first put in one hemisphere. The rotations are turned back into the skeleton's own
    angles, continuous and near the middle of their limits (`retarget.continuous_turns`). A recorded cycle does not
    quite close; half the gap is taken from each end, linearly in between (a deviation: the paper does not say).

    A joint of two turns whose slerp leaves them, by less than a frame's turn squared, is put back to the nearest
    angles. Raises InputError for a joint whose consecutive axes are not perpendicular, or that has more than three.
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
        for curve, places in zip(curves, frames, strict=True):
            curve[:, columns - N_ROOT] = _angles(between(places), axes, skeleton.limits[columns])
    gaps = curves[:, -1:] - curves[:, :1]
    return curves[:, :-1] - (phases[:-1, None] - 0.5) * gaps


def _axes(joint: str, axes: FloatArray) -> FloatArray:
    """Three axes (3, 3) for a joint's one to three (k, 3), each perpendicular to the next."""
    if len(axes) > 3 or any(abs(first @ second) > 1e-9 for first, second in pairwise(axes)):
        raise InputError(f"skeleton: expected turns of {joint} about one to three axes, each perpendicular to the last")
    if len(axes) == 1:
        axes = np.vstack([axes, np.cross(axes[0], np.eye(3)[np.argmin(np.abs(axes[0]))])])
        axes[1] /= np.linalg.norm(axes[1])
    return axes if len(axes) == 3 else np.vstack([axes, np.cross(axes[0], axes[1])])


def _angles(turns: "scipy.spatial.transform.Rotation", axes: FloatArray, limits: FloatArray) -> FloatArray:
    """Angles (F, k), rad, of turns about the first k of three axes, near the limits (k, 2); the others stay near 0."""
    all_limits = np.zeros((3, 2))
    all_limits[: len(limits)] = limits
    return continuous_turns(turns.as_davenport(axes, "intrinsic"), all_limits)[:, : len(limits)]
