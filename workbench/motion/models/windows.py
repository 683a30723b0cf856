"""Windows of motion: the database of paper C's implicit prior and its low-dimensional description (C, section 4).

A *row* holds m numbers of one frame: the A modelled joint angles (rad), their angular velocities (rad/s) and, if the
root is modelled, six root channels. A *window* is the d rows up to a frame, newest first as in the paper: lag k is k
frames ago. Velocities are backward differences, so that a window is independent of the frame after it, which it
predicts.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from workbench.body.skeleton import N_ROOT, POSE_NAMES, parameters
from workbench.motion.pose_sequence import Motion
from workbench.utils.arrays import BoolArray, Float32Array, FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.kernel_cache import kernel

log = logging.getLogger(__name__)
SCALINGS = ("deviations", "none")
ROOT_CHANNELS = ("forward", "sideways", "up", "turn", "root_pitch", "root_roll")
"""The root in the body's heading frame: three velocities, m/s, the heading's, rad/s, and pitch and roll, rad."""

_BLOCK = 1 << 14  # windows per batch, so that d copies of all rows are never in memory


@dataclass(frozen=True, eq=False)
class Windows:
    """n windows of d frames, their coefficients c_i, and the projection of other windows (C, eq. 4 and 5).

    angles : names of the A joint angles. include_root : whether rows contain the root's channels. rate_hz : of frames.
    rows : (R, m) float32, the rows of all clips in sequence; overlapping windows share them. ends : (n,) the last row
    of each window; row `ends + 1` is its successor in the same clip, which every window has. clips, activities : of the
    C clips, in the order of their rows. firsts : (C,) the first row of each clip. scales : (m,) standard deviation of
    each channel, in its unit; √Σ of the paper. divisors : (m,) of the channels before the SVD, see `learn_windows`.
    mean : (d, m) Ψ̄ of the divided windows. basis : (d, m, b) Ũ. sigmas : (b,) σ_l, standard deviation of component l.
    coefficients : (n, b) float32, *whitened*: c_i,l / σ_l.
    """

    angles: tuple[str, ...]
    include_root: bool
    rate_hz: float
    rows: Float32Array
    ends: IntArray
    clips: tuple[str, ...]
    activities: tuple[str, ...]
    firsts: IntArray
    scales: FloatArray
    divisors: FloatArray
    mean: FloatArray
    basis: FloatArray
    sigmas: FloatArray
    coefficients: Float32Array

    def __len__(self) -> int:
        return len(self.ends)

    @property
    def window_frames(self) -> int:
        """d, the number of frames in a window."""
        return len(self.mean)

    @cached_property
    def clip_of(self) -> IntArray:
        """Index (n,) of each window's clip."""
        return np.asarray(np.searchsorted(self.firsts, self.ends, side="right") - 1, dtype=np.int64)

    @cached_property
    def followers(self) -> IntArray:
        """Number (n,) of recorded frames after each window in its clip, at least one."""
        lasts = np.append(self.firsts[1:], len(self.rows)) - 1
        return lasts[self.clip_of] - self.ends

    def only(self, mask: BoolArray) -> "Windows":
        """Return the database with the windows in a mask (n,); rows and projection are unchanged."""
        return replace(self, ends=self.ends[mask], coefficients=self.coefficients[mask])

    @cached_property
    def filters(self) -> FloatArray:
        """Contribution (m, d·b) of each channel of a row to the coefficients now and in the next d − 1 frames."""
        filters = self.basis / self.divisors[:, None] / self.sigmas
        return np.ascontiguousarray(filters.transpose(1, 0, 2).reshape(len(self.divisors), -1))

    @cached_property
    def offset(self) -> FloatArray:
        """Contribution (d·b,) of the mean window."""
        return (self.mean[:, :, None] * self.basis / self.sigmas).sum(axis=1).ravel()

    def window_rows(self, entries: IntArray) -> FloatArray:
        """Return the windows (N, d, m) of entries (N,), newest row first."""
        return self.rows[self.ends[entries][:, None] - np.arange(self.window_frames)].astype(np.float64)

    def memory(self, windows: FloatArray) -> FloatArray:
        """Return the memory (N, d·b), see `advance`, of windows (N, d, m) of rows, newest first.

        Its first b columns are the whitened coefficients c_t of eq. 5.
        """
        memory = np.zeros((len(windows), self.window_frames * len(self.sigmas)))
        for lag in range(self.window_frames - 1, -1, -1):
            memory = advance(memory, windows[:, lag], self.filters, self.offset, len(self.sigmas))
        return memory

    def project(self, windows: FloatArray) -> FloatArray:
        """Return the whitened coefficients (N, b) of windows (N, d, m), newest row first (eq. 5)."""
        return np.ascontiguousarray(self.memory(windows)[:, : len(self.sigmas)])


def learn_windows(
    motions: Sequence[Motion], *, rate_hz: float = 30.0, window_frames: int = 10, angles: Sequence[str] = ("body",),
    include_root: bool = True, scaling: str = "deviations",
) -> Windows:  # fmt: skip
    """Return the windows of all motions at one rate, and their PCA with b = ⌊log₂ n⌋ components (C, section 4, eq.
    3–5).

    b is smaller if components have no variance. Clips too short for a window and its successor are excluded, with a
    warning.

    Parameters
    ----------
    motions : of the database.
    rate_hz : of the rows, Hz.
    window_frames : d.
    angles : names of the joint angles to model, or of body parts (`skeleton.PARTS`).
    include_root : model the root's channels too.
    scaling : "deviations" divides every channel by its standard deviation before the SVD; "none" does not, as in the
        paper. The velocities are then per frame, the unit of paper A, on whose body C's is based.

    Raises
    ------
    InputError : an angle or the scaling is unknown, d or the rate is not positive, or fewer than four windows remain.
    """
    angles = parameters("windows: angles", angles)
    if unknown := [name for name in angles if name not in POSE_NAMES[N_ROOT:]]:
        raise InputError(f"windows: expected joint angles such as {POSE_NAMES[N_ROOT]!r}, found {unknown[0]!r}")
    if not angles or window_frames < 1 or not rate_hz > 0.0:
        raise InputError(
            f"windows: expected angles, window_frames and a rate, found {len(angles)}, {window_frames}, {rate_hz}"
        )
    if scaling not in SCALINGS:
        raise InputError(f"windows: scaling must be one of {', '.join(SCALINGS)}, found {scaling!r}")
    clips, included, short = [], [], []
    for motion in motions:
        poses = motion.resampled(rate_hz).poses
        if len(poses) < window_frames + 2:  # one frame before the first velocity, one after the last window
            short.append(motion.name)
        else:
            clips.append(pose_rows(poses, rate_hz, angles, include_root).astype(np.float32))
            included.append(motion)
    if short:
        log.warning("windows: %d clips are shorter than %d frames: %s", len(short), window_frames + 2, ", ".join(short))
    firsts = np.cumsum([0, *map(len, clips)])
    spans = [np.arange(first + window_frames - 1, last - 1) for first, last in pairwise(firsts)]  # with a successor
    ends = np.concatenate([np.empty(0, dtype=np.int64), *spans])
    if len(ends) < 4:
        raise InputError(
            f"windows: expected motions with at least 4 windows of {window_frames} frames, found {len(ends)}"
        )
    rows = np.concatenate(clips)
    spread = rows.std(axis=0, dtype=np.float64)
    scales = np.where(spread > 1e-9, spread, 1.0)  # a constant channel has no information
    divisors = scales if scaling == "deviations" else _frame_units(len(angles), include_root, rate_hz)
    mean, basis, sigmas = _principal_components(rows, ends, window_frames, divisors)
    windows = Windows(
        angles=angles, include_root=include_root, rate_hz=rate_hz, rows=rows, ends=ends,
        clips=tuple(motion.name for motion in included), activities=tuple(motion.activity for motion in included),
        firsts=firsts[:-1], scales=scales, divisors=divisors, mean=mean, basis=basis, sigmas=sigmas,
        coefficients=np.empty((0, len(sigmas)), dtype=np.float32),
    )  # fmt: skip
    return _with_coefficients(windows)


def pose_rows(poses: FloatArray, rate_hz: float, angles: Sequence[str], include_root: bool) -> FloatArray:
    """Return the rows (F − 1, m) of poses (F, 25): of every frame but the first, which has no velocity."""
    modelled = poses[:, [POSE_NAMES.index(name) for name in angles]]
    channels = [modelled[1:], np.diff(modelled, axis=0) * rate_hz]
    if include_root:
        velocity, heading = np.diff(poses[:, :4], axis=0) * rate_hz, poses[:-1, 3]
        c, s = np.cos(heading), np.sin(heading)
        forward, sideways = c * velocity[:, 0] + s * velocity[:, 1], c * velocity[:, 1] - s * velocity[:, 0]
        channels.append(np.column_stack([forward, sideways, velocity[:, 2:], poses[1:, 4:N_ROOT]]))
    return np.concatenate(channels, axis=1)


def _frame_units(n_angles: int, include_root: bool, rate_hz: float) -> FloatArray:
    """Return the divisors (m,) of a row's channels that make its velocities per frame."""
    root = [rate_hz] * 4 + [1.0] * 2  # of ROOT_CHANNELS
    return np.array([1.0] * n_angles + [rate_hz] * n_angles + root * include_root)


def advance(memory: FloatArray, rows: FloatArray, filters: FloatArray, offset: FloatArray, b: int) -> FloatArray:
    """Return the memory (N, d·b) of a sliding window after one more row (N, m), without storing the window.

    The coefficients of a window are Σ_k Ũ_kᵀ (ψ_{t−k} − ψ̄_k) with lag k = 0…d−1: a finite impulse response filter over
    the rows. In its transposed form, block j of the memory is the partial sum of the coefficients j frames ahead, and
    block 0 the coefficients themselves. This is exact, with d·b numbers per particle instead of d·m; see
    `Windows.filters`, `Windows.offset`.
    """
    updated = np.empty_like(memory)
    _advance(np.ascontiguousarray(memory), np.ascontiguousarray(rows), filters, offset, b, updated)
    return updated


@kernel()
def _advance(memory: Any, rows: Any, filters: Any, offset: Any, b: int, updated: Any) -> None:
    # not a matrix product, whose order of addition depends on the number of BLAS threads
    n, size = memory.shape
    for i in range(n):
        for k in range(size - b):
            updated[i, k] = memory[i, k + b] - offset[k]
        for k in range(size - b, size):
            updated[i, k] = -offset[k]
        for channel in range(rows.shape[1]):
            value = rows[i, channel]
            for k in range(size):
                updated[i, k] += value * filters[channel, k]


def _principal_components(
    rows: Float32Array, ends: IntArray, window_frames: int, divisors: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean (d, m), basis (d, m, b) and sigmas (b,).

    They are computed from the covariance, dm × dm, rather than the equivalent SVD of dm × n numbers.
    """
    lags, size = np.arange(window_frames), window_frames * rows.shape[1]
    total, products = np.zeros(size), np.zeros((size, size))
    centre = rows.mean(axis=0, dtype=np.float64)  # near the mean, to avoid cancellation below
    for first in range(0, len(ends), _BLOCK):
        block = (rows[ends[first : first + _BLOCK][:, None] - lags] - centre) / divisors
        block = block.reshape(-1, size)
        total += block.sum(axis=0)
        products += block.T @ block
    mean = total / len(ends)
    variances, vectors = np.linalg.eigh(products / len(ends) - np.outer(mean, mean))
    variances, vectors = variances[::-1].clip(min=0.0), vectors[:, ::-1]
    rank = int((variances > 1e-12 * variances[0]).sum())
    b = max(1, min(int(np.log2(len(ends))), rank))
    vectors = vectors[:, :b] * np.sign(vectors[np.abs(vectors[:, :b]).argmax(axis=0), np.arange(b)])
    uncentred_mean = mean.reshape(window_frames, -1) + centre / divisors
    return uncentred_mean, vectors.reshape(window_frames, -1, b), np.sqrt(variances[:b])


def _with_coefficients(windows: Windows) -> Windows:
    d, b = windows.window_frames, len(windows.sigmas)
    filters = windows.filters.reshape(-1, d, b)
    constant = windows.offset.reshape(d, b).sum(axis=0)
    coefficients = np.empty((len(windows), b), dtype=np.float32)
    for first in range(0, len(windows), _BLOCK):
        block = windows.window_rows(np.arange(first, min(first + _BLOCK, len(windows))))
        coefficients[first : first + _BLOCK] = np.einsum("ndm,mdb->nb", block, filters, optimize=True) - constant
    return replace(windows, coefficients=coefficients)
