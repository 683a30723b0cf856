"""A motion as named joints over time, such as any program's result."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from workbench.body.skeleton import JOINT_NAMES
from workbench.utils.arrays import FloatArray

_LONGEST_GAP = 1.5
"""Of the median interval of frames: over a longer one, nothing is interpolated."""


@dataclass(frozen=True, eq=False)
class JointMotion:
    """J joints in F frames.

    source: the file. names: J of JOINT_NAMES. times_s: (F,), increasing. positions: (F, J, 3), m, z up, NaN where
    missing. samples: (S, F, J, 3), m, of the posterior; S = 0 without one. angles_deg: (F,) by name, which a file has
    in addition, or, with J = 0, in place of joints.
    """

    source: str
    names: tuple[str, ...]
    times_s: FloatArray
    positions: FloatArray
    samples: FloatArray
    angles_deg: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def interval_s(self) -> float:
        """Return the median interval of the frames, s; infinite for a single frame."""
        return float(np.median(np.diff(self.times_s))) if len(self.times_s) > 1 else np.inf

    def of_joints(self, names: Sequence[str]) -> "JointMotion":
        """Return the motion of some of its joints, in this order."""
        rows = [self.names.index(name) for name in names]
        positions, samples = self.positions[:, rows], self.samples[:, :, rows]
        return replace(self, names=tuple(names), positions=positions, samples=samples)

    def at(self, times_s: FloatArray) -> "JointMotion":
        """Return the motion at times (T,), s, interpolated linearly; NaN outside of the frames and in gaps."""
        last = len(self.times_s) - 1
        high = np.clip(np.searchsorted(self.times_s, times_s - 1e-9), 0, last)
        exact = np.abs(self.times_s[high] - times_s) < 1e-6
        low = np.where(exact, high, np.maximum(high - 1, 0))
        width = self.times_s[high] - self.times_s[low]
        known = exact | ((width > 0.0) & (width <= _LONGEST_GAP * self.interval_s) & (times_s <= self.times_s[high]))
        part = np.where(exact, 0.0, (times_s - self.times_s[low]) / np.where(width > 0.0, width, 1.0))[:, None, None]

        def interpolated(values: FloatArray) -> FloatArray:
            before, after = values[..., low, :, :], values[..., high, :, :]
            mixed = np.where(part == 0.0, before, before + part * (after - before))
            return np.where(known[:, None, None], mixed, np.nan)

        angles = {name: interpolated(each[:, None, None])[:, 0, 0] for name, each in self.angles_deg.items()}
        return replace(
            self, times_s=times_s, positions=interpolated(self.positions), samples=interpolated(self.samples),
            angles_deg=angles,
        )  # fmt: skip


def with_pelvis(names: Sequence[str], positions: FloatArray) -> tuple[tuple[str, ...], FloatArray]:
    """Return the joints (F, J, 3) in the order of JOINT_NAMES, the pelvis, if absent, in the middle of the hips."""
    index = {name: positions[:, k] for k, name in enumerate(names)}
    if "pelvis" not in index and {"left_hip", "right_hip"} <= set(index):
        index["pelvis"] = 0.5 * (index["left_hip"] + index["right_hip"])
    ordered = tuple(name for name in JOINT_NAMES if name in index)
    return ordered, np.stack([index[name] for name in ordered], axis=1)
