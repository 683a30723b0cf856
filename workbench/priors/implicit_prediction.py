"""Where a window of paper C's database leads a particle, and what the particle remembers of it (C, section 4)."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from workbench.body.skeleton import POSE_NAMES
from workbench.motion.models.windows import Windows, advance
from workbench.utils.arrays import FloatArray, IntArray

N_POSE = len(POSE_NAMES)


@dataclass(frozen=True, eq=False)
class WindowPrediction:
    """The move of states {pose, memory} by the row that follows a window, one library frame.

    pull: part of the way towards the database's angles. inertia: part of the noise that enters the velocities in the
    memory. deviations: (P,) of the pose's noise, m or rad, the root's place in the body's own heading frame.
    """

    windows: Windows
    blend_rate: float
    velocity_noise_fraction: float
    deviations: FloatArray

    @cached_property
    def columns(self) -> IntArray:
        """The pose's columns of the A modelled angles."""
        return np.array([POSE_NAMES.index(name) for name in self.windows.angles])

    @cached_property
    def absolute(self) -> tuple[IntArray, IntArray]:
        """Columns of a pose, and of a row, that hold the same angle."""
        n_angles = len(self.columns)
        if not self.windows.include_root:
            return self.columns, np.arange(n_angles)
        lean = np.array([4, 5])
        return np.concatenate([self.columns, lean]), np.concatenate([np.arange(n_angles), 2 * n_angles + lean])

    @cached_property
    def moved(self) -> IntArray:
        """The K columns of a pose that are modelled: the place and heading of the root, if it is, and `absolute`."""
        return np.concatenate([np.arange(4), self.absolute[0]]) if self.windows.include_root else self.columns

    def predict(self, state: FloatArray, entries: IntArray, noise: FloatArray) -> FloatArray:
        """The states (N, D) one library frame later when entries (N,) were drawn; noise: (N, P) standard normal."""
        before, after = self._rows(entries)
        noise = noise * self.deviations
        pose = state[:, :N_POSE].copy()
        ours, theirs = self.absolute
        pose[:, ours] += after[:, theirs] - before[:, theirs] + self.blend_rate * (before[:, theirs] - pose[:, ours])
        if self.windows.include_root:
            change = after[:, self._velocities] / self.windows.rate_hz + noise[:, :4]
            c, s = np.cos(pose[:, 3]), np.sin(pose[:, 3])
            pose[:, 0] += c * change[:, 0] - s * change[:, 1]
            pose[:, 1] += s * change[:, 0] + c * change[:, 1]
            pose[:, 2:4] += change[:, 2:]
        pose[:, 4:] += noise[:, 4:]
        return self._remembered(state, pose, after, noise)

    def arrive(self, state: FloatArray, pose: FloatArray, entries: IntArray) -> FloatArray:
        """The states (N, D) one library frame later at given poses (N, P): `predict` by the noise that leads there."""
        noise = np.zeros((len(state), N_POSE))
        noise[:, self.moved] = self.way(state[:, :N_POSE], pose) - self.ways(entries)
        return self._remembered(state, pose, self._rows(entries)[1], noise)

    def way(self, before: FloatArray, after: FloatArray) -> FloatArray:
        """Return what of the way between poses (N, P) a window must account for, (N, K), in the order of `moved`.

        It is how far the root went, as it headed, and the angles without the part (1 − pull) of the ones before; noise
        comes on top, so that given the window `way − ways` is N(0, deviations²).
        """
        ours = self.absolute[0]
        angles = after[:, ours] - (1.0 - self.blend_rate) * before[:, ours]
        if not self.windows.include_root:
            return angles
        step = after[:, :4] - before[:, :4]
        c, s = np.cos(before[:, 3]), np.sin(before[:, 3])
        ahead, aside = c * step[:, 0] + s * step[:, 1], c * step[:, 1] - s * step[:, 0]
        return np.column_stack([ahead, aside, step[:, 2:], angles])

    def ways(self, entries: IntArray) -> FloatArray:
        """Return what entries (N,) account for of a way, (N, K)."""
        before, after = self._rows(entries)
        theirs = self.absolute[1]
        angles = after[:, theirs] - (1.0 - self.blend_rate) * before[:, theirs]
        if not self.windows.include_root:
            return angles
        return np.concatenate([after[:, self._velocities] / self.windows.rate_hz, angles], axis=1)

    @property
    def _velocities(self) -> slice:
        """The row's columns of the root's velocities."""
        return slice(2 * len(self.columns), 2 * len(self.columns) + 4)

    def _rows(self, entries: IntArray) -> tuple[FloatArray, FloatArray]:
        """The last rows (N, m) of the windows, and those that follow them."""
        rows, ends = self.windows.rows, self.windows.ends[entries]
        return rows[ends].astype(np.float64), rows[ends + 1].astype(np.float64)

    def _remembered(self, state: FloatArray, pose: FloatArray, after: FloatArray, noise: FloatArray) -> FloatArray:
        """The states (N, D) at poses (N, P) that rows (N, m) and noise (N, P), m or rad, led to."""
        windows, n_angles = self.windows, len(self.columns)
        if windows.include_root:
            after[:, self._velocities] += self.velocity_noise_fraction * windows.rate_hz * noise[:, :4]
        after[:, n_angles : 2 * n_angles] += self.velocity_noise_fraction * windows.rate_hz * noise[:, self.columns]
        ours, theirs = self.absolute
        after[:, theirs] = pose[:, ours]
        memory = advance(state[:, N_POSE:], after, windows.filters, windows.offset, len(windows.sigmas))
        return np.concatenate([pose, memory], axis=1)
