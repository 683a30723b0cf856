"""Prediction of a particle by a window of paper C's database, and the update of its memory (C, section 4)."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from workbench.body.skeleton import POSE_NAMES
from workbench.motion.models.windows import Windows, advance
from workbench.utils.arrays import FloatArray, IntArray

N_POSE = len(POSE_NAMES)


@dataclass(frozen=True, eq=False)
class WindowPrediction:
    """Prediction of states {pose, memory} over one library frame by the row that follows a window.

    blend_rate : fraction of the difference to the database's angles that is removed. velocity_noise_fraction : fraction
    of the noise that enters the velocities in the memory. std : (P,) of the pose's noise, m or rad, with the root's
    translation in the body's heading frame.
    """

    windows: Windows
    blend_rate: float
    velocity_noise_fraction: float
    std: FloatArray

    @cached_property
    def columns(self) -> IntArray:
        """Columns (A,) of the modelled angles in a pose."""
        return np.array([POSE_NAMES.index(name) for name in self.windows.angles])

    @cached_property
    def absolute(self) -> tuple[IntArray, IntArray]:
        """Columns of a pose, and of a row, with the same angles."""
        n_angles = len(self.columns)
        if not self.windows.include_root:
            return self.columns, np.arange(n_angles)
        lean = np.array([4, 5])
        return np.concatenate([self.columns, lean]), np.concatenate([np.arange(n_angles), 2 * n_angles + lean])

    @cached_property
    def modelled(self) -> IntArray:
        """The K modelled columns of a pose: translation and heading of the root, if modelled, and `absolute`."""
        return np.concatenate([np.arange(4), self.absolute[0]]) if self.windows.include_root else self.columns

    def predict(self, state: FloatArray, entries: IntArray, noise: FloatArray) -> FloatArray:
        """Return the states (N, D) one library frame later for entries (N,); noise : (N, P) standard normal."""
        before, after = self._rows(entries)
        noise = noise * self.std
        pose = state[:, :N_POSE].copy()
        pose_columns, row_columns = self.absolute
        start, end = before[:, row_columns], after[:, row_columns]
        pose[:, pose_columns] += end - start + self.blend_rate * (start - pose[:, pose_columns])
        if self.windows.include_root:
            change = after[:, self._velocities] / self.windows.rate_hz + noise[:, :4]
            c, s = np.cos(pose[:, 3]), np.sin(pose[:, 3])
            pose[:, 0] += c * change[:, 0] - s * change[:, 1]
            pose[:, 1] += s * change[:, 0] + c * change[:, 1]
            pose[:, 2:4] += change[:, 2:]
        pose[:, 4:] += noise[:, 4:]
        return self._with_memory(state, pose, after, noise)

    def with_pose(self, state: FloatArray, pose: FloatArray, entries: IntArray) -> FloatArray:
        """Return the states (N, D) one library frame later at poses (N, P): `predict` with the implied noise."""
        noise = np.zeros((len(state), N_POSE))
        noise[:, self.modelled] = self.displacement(state[:, :N_POSE], pose) - self.predicted_displacements(entries)
        return self._with_memory(state, pose, self._rows(entries)[1], noise)

    def displacement(self, before: FloatArray, after: FloatArray) -> FloatArray:
        """Return the displacement (N, K) between poses (N, P) that a window predicts, in the order of `modelled`.

        It holds the root's displacement in the heading frame, and the angles minus (1 − blend_rate) times the previous
        ones. Given the window, `displacement − predicted_displacements` is N(0, std²).
        """
        columns = self.absolute[0]
        angles = after[:, columns] - (1.0 - self.blend_rate) * before[:, columns]
        if not self.windows.include_root:
            return angles
        step = after[:, :4] - before[:, :4]
        c, s = np.cos(before[:, 3]), np.sin(before[:, 3])
        forward, sideways = c * step[:, 0] + s * step[:, 1], c * step[:, 1] - s * step[:, 0]
        return np.column_stack([forward, sideways, step[:, 2:], angles])

    def predicted_displacements(self, entries: IntArray) -> FloatArray:
        """Return the noise-free displacements (N, K) of entries (N,), see `displacement`."""
        before, after = self._rows(entries)
        columns = self.absolute[1]
        angles = after[:, columns] - (1.0 - self.blend_rate) * before[:, columns]
        if not self.windows.include_root:
            return angles
        return np.concatenate([after[:, self._velocities] / self.windows.rate_hz, angles], axis=1)

    @property
    def _velocities(self) -> slice:
        """Columns of the root's velocities in a row."""
        return slice(2 * len(self.columns), 2 * len(self.columns) + 4)

    def _rows(self, entries: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the last rows (N, m) of the windows, and their successors."""
        rows, ends = self.windows.rows, self.windows.ends[entries]
        return rows[ends].astype(np.float64), rows[ends + 1].astype(np.float64)

    def _with_memory(self, state: FloatArray, pose: FloatArray, after: FloatArray, noise: FloatArray) -> FloatArray:
        """Return the states (N, D) at poses (N, P) after rows (N, m) and noise (N, P), m or rad."""
        windows, n_angles = self.windows, len(self.columns)
        if windows.include_root:
            after[:, self._velocities] += self.velocity_noise_fraction * windows.rate_hz * noise[:, :4]
        after[:, n_angles : 2 * n_angles] += self.velocity_noise_fraction * windows.rate_hz * noise[:, self.columns]
        pose_columns, row_columns = self.absolute
        after[:, row_columns] = pose[:, pose_columns]
        memory = advance(state[:, N_POSE:], after, windows.filters, windows.offset, len(windows.sigmas))
        return np.concatenate([pose, memory], axis=1)
