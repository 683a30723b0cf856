"""A walk or run: its strides in all stretches of a motion, its parameters, and its joint angles over the cycle."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.evaluation.gait.angle_cycles import AngleCycles, angle_cycles
from workbench.evaluation.gait.foot_events import foot_events
from workbench.evaluation.gait.stretches import Stretch, stretch_of
from workbench.evaluation.gait.strides import (
    BELT_SPEED,
    Strides,
    ground_velocity,
    is_run,
    joined,
    parameters,
    strides_of,
)
from workbench.utils.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Walk:
    """A walk or run in M motions.

    strides: of left and right foot. parameters: see `strides.parameters`. cycles: angles over the strides of left and
    right foot, None without one. standing_speed: backward speed of standing feet over the walking speed. on_belt: the
    walk is on a treadmill. is_run: see `strides.is_run`. n_turning, n_irregular: strides left out as they turn,
    or as the strikes of left and right do not alternate.
    """

    strides: tuple[Strides, Strides]
    parameters: dict[str, dict[str, FloatArray]]
    cycles: tuple[AngleCycles | None, AngleCycles | None]
    standing_speed: float
    on_belt: bool
    is_run: bool
    n_turning: int
    n_irregular: int


def walk_of(
    names: Sequence[str],
    joints: FloatArray,
    angles: FloatArray,
    rotation: int | None,
    times_s: FloatArray,
    stretches: Sequence[IntArray],
    height_m: float,
) -> Walk | None:
    """Return the walk in motions; None without a stride.

    Parameters
    ----------
    names : of the J joints, JOINT_NAMES and possibly heels and toes.
    joints : (M, F, J, 3), m, in the world, z up; motion 0 is the expected one, the others are samples.
    angles : (M, F, A), rad.
    rotation : column of the torso's heading in the angles, None without it.
    times_s : (F,), s, increasing.
    stretches : frames of each stretch without gaps.
    height_m : the person's.
    """
    parts = [stretch_of(names, joints, angles, times_s, rows) for rows in stretches]
    strides, standing_speed, n_turning, n_pairs = _strides(parts, height_m, runs=True)
    found = [foot for each in strides for foot in each]
    if not any(map(len, found)):
        return None
    both = joined(found)
    runs = is_run(both)
    if not runs:  # whose toe-offs are found otherwise, which changes no strike
        strides, standing_speed, n_turning, n_pairs = _strides(parts, height_m, runs=False)
    left, right = (joined([each[foot] for each in strides]) for foot in (0, 1))
    cycles = [
        angle_cycles([(part, each[foot]) for part, each in zip(parts, strides, strict=True)], rotation)
        for foot in (0, 1)
    ]
    return Walk(
        (left, right), parameters(left, right), (cycles[0], cycles[1]), standing_speed, standing_speed >= BELT_SPEED,
        runs, n_turning, n_pairs - len(both) - n_turning,
    )  # fmt: skip


def _strides(
    parts: Sequence[Stretch], height_m: float, runs: bool
) -> tuple[list[tuple[Strides, Strides]], float, int, int]:
    """Return the strides of left and right foot in each stretch, on the ground or on a belt; the standing speed, the
    number of strides that turn, and that of pairs of successive strikes of a foot."""
    events = [foot_events(part, height_m, runs) for part in parts]
    grounds = [ground_velocity(part, each) for part, each in zip(parts, events, strict=True)]
    counts = np.array([sum(foot.strikes_s.shape[1] for foot in each) for each in events])
    standing = np.array([share[0] for _, share in grounds])
    known = np.isfinite(standing)
    standing_speed = float(np.average(standing[known], weights=counts[known])) if known.any() else np.nan
    strides, n_turning = [], 0
    for part, each, (velocity, _) in zip(parts, events, grounds, strict=True):
        found, turning = strides_of(part, each, velocity if standing_speed >= BELT_SPEED else np.zeros_like(velocity))
        strides.append(found)
        n_turning += turning
    n_pairs = sum(max(foot.strikes_s.shape[1] - 1, 0) for each in events for foot in each)
    return strides, standing_speed, n_turning, n_pairs
