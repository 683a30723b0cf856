"""Strides of a walk, and its spatio-temporal parameters.

A stride of one foot lasts from one of its strikes to its next, with one strike of the other foot between them. Places
of the feet are where they stand, and lengths and widths are relative to the other foot's stride (Huxham et al., *Gait &
Posture* 23, 2006). On a treadmill places are relative to the belt.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np

from workbench.evaluation.gait.foot_events import MIN_STRIDE_S, FootEvents
from workbench.evaluation.gait.stretches import Stretch
from workbench.utils.arrays import FloatArray
from workbench.utils.nan_statistics import nan_mean, nan_median

MAX_STRIDE_S = 2.5
"""Longest stride; a longer one is a pause. Very slow walks, of 0.2 m/s, take 2 s."""
MAX_TURN_RAD = np.pi / 4.0
"""Largest change of direction from a stride's begin to its end. A walk on a circle of 2 m turns by 37° a stride, a
person who turns round by 60° or more."""
BELT_SPEED = 0.5
"""Backward speed of standing feet over the speed relative to the pelvis from which on they stand on a belt: half way
from the ground, where it is about 0, to a treadmill, where it is about 1."""
SLIDING_SPEED = 0.25
"""The same, in either direction, from which on feet slide on the ground: recorded walks reach 0.05, a run 0.1."""
_LOADED = 0.15
"""Part of the stride after a strike at which a run's leg is bent most and a walk's leg carries the pelvis up."""
_FLAT_FROM, _FLAT_TO = 0.25, 0.45
"""Part of the stance in which the whole foot is on the ground: in recorded walks an ankle moves ahead least in it, at
0.02 ± 0.01 of the walking speed."""


@dataclass(frozen=True, eq=False)
class Strides:
    """n strides of one foot in M motions, (M, n) each; NaN where unknown.

    starts_s, ends_s: the foot's strikes. toe_offs_s: its toe-off. other_strikes_s, other_toe_offs_s: the other foot's.
    lengths_m: of the stride. step_lengths_m, step_widths_m: of the step of the other foot in it; a width is negative
    where the feet cross. distances_m: of the pelvis over the ground or the belt. directions_rad: of the stride, from
    the world's x axis. rises_m: of the pelvis from the strike to _LOADED of the stride.
    """

    starts_s: FloatArray
    ends_s: FloatArray
    toe_offs_s: FloatArray
    other_strikes_s: FloatArray
    other_toe_offs_s: FloatArray
    lengths_m: FloatArray
    step_lengths_m: FloatArray
    step_widths_m: FloatArray
    distances_m: FloatArray
    directions_rad: FloatArray
    rises_m: FloatArray

    @property
    def durations_s(self) -> FloatArray:
        """Durations (M, n), s."""
        return self.ends_s - self.starts_s

    def __len__(self) -> int:
        return self.starts_s.shape[1]


def joined(strides: Sequence[Strides]) -> Strides:
    """Return the strides of several stretches of one foot."""
    names = [field.name for field in fields(Strides)]
    return Strides(*(np.concatenate([getattr(each, name) for each in strides], axis=1) for name in names))


def ground_velocity(stretch: Stretch, events: Sequence[FootEvents]) -> tuple[FloatArray, FloatArray]:
    """Return the mean horizontal velocity (M, 2), m/s, of standing feet, and their backward speed (M,) over the speed
    of the pelvis relative to them; NaN without steps."""
    feet, relative = [], []
    for foot, each in enumerate(events):
        for first, end in filter(None, _flat_frames(stretch, each)):
            seconds = max(end - first, 1) * stretch.step_s
            moved = (stretch.heels[:, end, foot] - stretch.heels[:, first, foot])[:, :2] / seconds
            pelvis = (stretch.pelvis[:, end] - stretch.pelvis[:, first])[:, :2] / seconds
            ahead = stretch.facing[:, (first + end) // 2]
            feet.append(moved)
            relative.append(np.stack([-(moved * ahead).sum(axis=1), ((pelvis - moved) * ahead).sum(axis=1)], axis=1))
    if not feet:
        return np.full((len(stretch.pelvis), 2), np.nan), np.full(len(stretch.pelvis), np.nan)
    back, speed = np.median(relative, axis=0).T
    return np.mean(feet, axis=0), back / np.where(speed > 0.0, speed, np.nan)


def strides_of(
    stretch: Stretch, events: Sequence[FootEvents], belt_velocity: FloatArray
) -> tuple[tuple[Strides, Strides], int]:
    """Return the strides of left and right foot, and how many were left out as they turn by more than MAX_TURN_RAD.

    Parameters
    ----------
    stretch : the motions.
    events : of left and right foot.
    belt_velocity : (M, 2), m/s, of the surface the feet stand on; 0 of the ground.
    """
    travelled = stretch.times_s[None, :, None] * belt_velocity[:, None]
    pelvis, height = stretch.pelvis[..., :2] - travelled, stretch.pelvis[..., 2]
    places = [_places(stretch, each, stretch.heels[:, :, foot, :2] - travelled) for foot, each in enumerate(events)]
    found, n_turning = [], 0
    for foot in (0, 1):
        columns: list[list[FloatArray]] = []
        for k, other in _pairs(events[foot], events[1 - foot]):
            starts, ends = events[foot].strikes_s[:, k], events[foot].strikes_s[:, k + 1]
            loaded = starts + _LOADED * (ends - starts)
            if _turn(stretch, float(starts[0]), float(ends[0])) > MAX_TURN_RAD:
                n_turning += 1
                continue
            stride = places[foot][k + 1] - places[foot][k]
            step = places[1 - foot][other] - places[foot][k]
            moved = np.diff(stretch.at(pelvis, np.stack([starts, ends], axis=1)), axis=1)[:, 0]
            along = np.where(np.isfinite(stride).all(axis=1, keepdims=True), stride, moved)
            length = np.maximum(np.linalg.norm(along, axis=1), 1e-12)
            left_of = (along[:, 0] * step[:, 1] - along[:, 1] * step[:, 0]) / length
            columns.append([
                starts, ends, events[foot].toe_offs_s[:, k + 1], events[1 - foot].strikes_s[:, other],
                events[1 - foot].toe_offs_s[:, other], np.linalg.norm(stride, axis=1),
                (step * along).sum(axis=1) / length, left_of if foot == 1 else -left_of,
                np.linalg.norm(moved, axis=1), np.arctan2(along[:, 1], along[:, 0]),
                np.diff(stretch.at(height, np.stack([starts, loaded], axis=1)), axis=1)[:, 0],
            ])  # fmt: skip
        empty = [np.empty((len(pelvis), 0))] * len(fields(Strides))
        found.append(Strides(*(np.stack(each, axis=1) for each in zip(*columns, strict=True)) if columns else empty))
    return (found[0], found[1]), n_turning


def parameters(left: Strides, right: Strides) -> dict[str, dict[str, FloatArray]]:
    """Return the spatio-temporal parameters (M,) by name and side, left, right or both, means over strides.

    Lengths are in m, times in s, shares are fractions of the stride. Double support is negative in flight.
    """
    both = joined([left, right])
    measures: dict[str, dict[str, FloatArray]] = {
        "speed_m_s": {"both": nan_mean(both.distances_m / both.durations_s)},
        "cadence_steps_min": {"both": 120.0 / nan_mean(both.durations_s)},
    }
    for name, (own, other) in _BY_SIDE.items():
        sides = {"left": own(left) if own else other(right), "right": own(right) if own else other(left)}  # type: ignore[misc]
        measures[name] = {side: nan_mean(values) for side, values in sides.items()}
    measures["double_support_fraction"] = {"both": nan_mean(double_support(both) / both.durations_s)}
    return measures


def is_run(strides: Strides) -> bool:
    """Return whether the expected motion runs: both feet are off the ground between steps, and the pelvis sinks after a
    strike, as on a spring, where a walk's rises over the leg (Cavagna, Thys & Zamboni, *J. Physiol.* 262, 1976). Either
    alone is not sure: toe-offs are known to 25 ms, and some walkers sink."""
    flies = nan_median(double_support(strides)[0]) < 0.0
    return bool(flies and np.median(strides.rises_m[0]) < 0.0)


def double_support(strides: Strides) -> FloatArray:
    """Return the time, s, in which both feet are on the ground in each stride (M, n), less the time of flight."""
    return (strides.other_toe_offs_s - strides.starts_s) + (strides.toe_offs_s - strides.other_strikes_s)


_BY_SIDE = {
    "step_length_m": (None, lambda strides: strides.step_lengths_m),
    "step_width_m": (None, lambda strides: strides.step_widths_m),
    "step_time_s": (None, lambda strides: strides.other_strikes_s - strides.starts_s),
    "stride_length_m": (lambda strides: strides.lengths_m, None),
    "stride_time_s": (lambda strides: strides.durations_s, None),
    "stance_fraction": (lambda strides: (strides.toe_offs_s - strides.starts_s) / strides.durations_s, None),
}
"""Parameters of a side, by its own strides, or by the steps in the strides of the other foot."""


def _pairs(own: FootEvents, other: FootEvents) -> Iterator[tuple[int, int]]:
    """Yield the first strike of each stride of a foot, and the one strike of the other foot in it."""
    strikes_s, others_s = own.strikes_s[0], other.strikes_s[0]
    for k in range(len(strikes_s) - 1):
        between = np.flatnonzero((others_s > strikes_s[k]) & (others_s < strikes_s[k + 1]))
        if len(between) == 1 and MIN_STRIDE_S <= strikes_s[k + 1] - strikes_s[k] <= MAX_STRIDE_S:
            yield k, int(between[0])


def _flat_frames(stretch: Stretch, events: FootEvents) -> list[tuple[int, int] | None]:
    """Return the first and last frame in which the foot is flat after each strike of the expected motion; None where
    they are outside of the stretch."""
    strikes_s, offs_s = events.strikes_s[0], events.toe_offs_s[0]
    stances_s = np.append(offs_s[1:] - strikes_s[:-1], np.nan)
    known = stances_s[np.isfinite(stances_s)]
    if not len(known):
        return [None] * len(strikes_s)
    stances_s = np.where(np.isfinite(stances_s), stances_s, np.median(known))
    last = len(stretch.times_s) - 1
    frames: list[tuple[int, int] | None] = []
    for strike_s, stance_s in zip(strikes_s, stances_s, strict=True):
        start = (strike_s - stretch.times_s[0]) / stretch.step_s
        first, end = (round(start + part * stance_s / stretch.step_s) for part in (_FLAT_FROM, _FLAT_TO))
        frames.append((first, max(end, first + 1)) if first >= 0 and max(end, first + 1) <= last else None)
    return frames


def _places(stretch: Stretch, events: FootEvents, heels: FloatArray) -> list[FloatArray]:
    """Return the places (M, 2), m, where the foot stands after each strike, from the heel's (M, F, 2)."""
    unknown = np.full((len(heels), 2), np.nan)
    return [
        unknown if frames is None else heels[:, frames[0] : frames[1] + 1].mean(axis=1)
        for frames in _flat_frames(stretch, events)
    ]


def _turn(stretch: Stretch, start_s: float, end_s: float) -> float:
    """Return the angle, rad, by which the expected motion turns from one time to another."""
    first, last = (
        stretch.facing[0, min(round((each - stretch.times_s[0]) / stretch.step_s), len(stretch.times_s) - 1)]
        for each in (start_s, end_s)
    )
    return float(np.arccos(np.clip(first @ last, -1.0, 1.0)))
