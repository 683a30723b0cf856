"""Joint angles over the gait cycle: from one strike of a foot to its next, on 101 points."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.body.angles import wrapped
from workbench.evaluation.gait.estimates import expected_extremes
from workbench.evaluation.gait.stretches import Stretch
from workbench.evaluation.gait.strides import Strides
from workbench.utils.arrays import FloatArray

N_POINTS = 101
"""Points of a cycle, in percent from 0 to 100."""


@dataclass(frozen=True, eq=False)
class AngleCycles:
    """A angles over the strides of one foot, rad.

    strides: (n, N_POINTS, A), of the expected motion. means: (M, N_POINTS, A), of M motions. ranges, maxima: (M, A),
    means over strides of the range and of the largest value in each, see `expected_extremes`.
    """

    strides: FloatArray
    means: FloatArray
    ranges: FloatArray
    maxima: FloatArray


def angle_cycles(parts: Sequence[tuple[Stretch, Strides]], rotation: int | None) -> AngleCycles | None:
    """Return the angles over the strides of one foot in stretches; None without a stride.

    rotation: column of the torso's heading, which becomes relative to the direction of each stride.
    """
    curves, total, ranges, maxima = [], None, [], []
    for stretch, strides in parts:
        for k in range(len(strides)):
            starts_s, ends_s = strides.starts_s[:, k, None], strides.ends_s[:, k, None]
            cycle = stretch.at(stretch.angles, starts_s + np.linspace(0.0, 1.0, N_POINTS) * (ends_s - starts_s))
            if rotation is not None:
                cycle[..., rotation] = wrapped(cycle[..., rotation] - strides.directions_rad[:, k, None])
            curves.append(cycle[0])
            total = cycle if total is None else total + cycle
            maxima.append(cycle.max(axis=1))
            ranges.append(maxima[-1] - cycle.min(axis=1))
    if total is None:
        return None
    extremes = (expected_extremes(np.mean(each, axis=0)) for each in (ranges, maxima))
    return AngleCycles(np.stack(curves), total / len(curves), *extremes)
