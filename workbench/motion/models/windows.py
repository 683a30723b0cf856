"""Windows of motion: the database of paper C's implicit prior and its low-dimensional description (C, section 4).

A *row* holds what the model knows of one frame, m numbers: the A modelled joint angles (rad), their angular velocities
(rad/s) and, where the root is modelled, six root channels. A *window* is the d rows up to a frame, newest first as in
the paper: lag k is k frames ago. Every velocity looks back, from the frame before to this one, so that a window never
knows the frame after it, which is what it is asked for.
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
ROOT_CHANNELS = ("forward", "sideways", "up", "turn", "root_pitch", "root_roll")
"""The root in the body's own heading frame: three velocities, m/s, the heading's, rad/s, and the lean itself, rad."""

_BLOCK = 1 << 14  # windows worked on at a time, so that only the rows, not d copies of them, are ever in memory


@dataclass(frozen=True, eq=False)
class Windows:
    """n windows of d frames, their coefficients c_i, and how to project other windows (C, eq. 4 and 5).

    angles: names of the A joint angles. root: whether the root's channels are in the rows. rate_hz: frames per second.
    rows: (R, m) float32, the rows of all clips one after the other; windows that overlap share them.
    ends: (n,) the row each window ends at; row `ends + 1` is its successor, of the same clip. A clip's last window has
    none and is left out. clips, activities: the C clips' names and what is done in them, in the order of their rows.
    firsts: (C,) the row each clip begins at.
    scales: (m,) standard deviation of each channel, in its unit; √Σ of the paper.
    mean: (d, m) Ψ̄ of the scaled windows. basis: (d, m, b) Ũ. sigmas: (b,) σ_l, the standard deviation of component l.
    coefficients: (n, b) float32, *whitened*: c_i,l / σ_l. explained: part of the scaled variance in b components.
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
    mean: FloatArray
    basis: FloatArray
    sigmas: FloatArray
    coefficients: Float32Array
    explained: float

    def __len__(self) -> int:
        return len(self.ends)

    @property
    def window_frames(self) -> int:
        """d, the frames in a window."""
        return len(self.mean)

    @cached_property
    def clip_of(self) -> IntArray:
        """(n,): the index of each window's clip."""
        return np.asarray(np.searchsorted(self.firsts, self.ends, side="right") - 1, dtype=np.int64)

    @cached_property
    def followers(self) -> IntArray:
        """(n,): how many recorded frames follow each window in its clip, at least one."""
        lasts = np.append(self.firsts[1:], len(self.rows)) - 1
        return lasts[self.clip_of] - self.ends

    def only(self, kept: BoolArray) -> "Windows":
        """Keep the database and its projection with the windows kept (n,) alone to be drawn; their rows stay."""
        return replace(self, ends=self.ends[kept], coefficients=self.coefficients[kept])

    @cached_property
    def filters(self) -> FloatArray:
        """(m, d·b): what each channel of a row adds to the coefficients now and in the next d − 1 frames."""
        filters = self.basis / self.scales[:, None] / self.sigmas
        return np.ascontiguousarray(filters.transpose(1, 0, 2).reshape(len(self.scales), -1))

    @cached_property
    def offset(self) -> FloatArray:
        """(d·b,): what the mean window takes off again."""
        return (self.mean[:, :, None] * self.basis / self.sigmas).sum(axis=1).ravel()

    def window_rows(self, entries: IntArray) -> FloatArray:
        """The windows (N, d, m) of entries (N,), newest row first."""
        return self.rows[self.ends[entries][:, None] - np.arange(self.window_frames)].astype(np.float64)

    def memory(self, windows: FloatArray) -> FloatArray:
        """The memory (N, d·b), see `advance`, of windows (N, d, m) of rows, newest first.

        Its first b columns are the whitened coefficients c_t of eq. 5.
        """
        memory = np.zeros((len(windows), self.window_frames * len(self.sigmas)))
        for lag in range(self.window_frames - 1, -1, -1):
            memory = advance(memory, windows[:, lag], self.filters, self.offset, len(self.sigmas))
        return memory

    def project(self, windows: FloatArray) -> FloatArray:
        """The whitened coefficients (N, b) of windows (N, d, m), newest row first (eq. 5)."""
        return np.ascontiguousarray(self.memory(windows)[:, : len(self.sigmas)])


def learn_windows(
    motions: Sequence[Motion], *, rate_hz: float = 30.0, window_frames: int = 10, angles: Sequence[str] = ("body",),
    include_root: bool = True,
) -> Windows:  # fmt: skip
    """The windows of all motions at one rate, and their PCA with b = ⌊log₂ n⌋ components (C, section 4, eq. 3–5).

    length: d. angles: names of the joint angles to model, or of parts of the body (`skeleton.PARTS`). Components
    without variance are left out, so that b may be smaller on a tiny library. Clips too short for a window and its
    successor are left out and named in a warning. Raises InputError when an angle is unknown, d or the rate is not
    positive, or fewer than four windows remain.
    """
    angles = parameters("windows: angles", angles)
    if unknown := [name for name in angles if name not in POSE_NAMES[N_ROOT:]]:
        raise InputError(f"windows: expected joint angles such as {POSE_NAMES[N_ROOT]!r}, found {unknown[0]!r}")
    if not angles or window_frames < 1 or not rate_hz > 0.0:
        raise InputError(
            f"windows: expected angles, a length and a rate, found {len(angles)}, {window_frames}, {rate_hz}"
        )
    clips, kept, short = [], [], []
    for motion in motions:
        poses = motion.resampled(rate_hz).poses
        if len(poses) < window_frames + 2:  # one frame before the first velocity, one after the last window
            short.append(motion.name)
        else:
            clips.append(pose_rows(poses, rate_hz, angles, include_root).astype(np.float32))
            kept.append(motion)
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
    scales, mean, basis, sigmas, explained = _principal_components(rows, ends, window_frames)
    windows = Windows(
        angles=angles, include_root=include_root, rate_hz=rate_hz, rows=rows, ends=ends,
        clips=tuple(motion.name for motion in kept), activities=tuple(motion.activity for motion in kept),
        firsts=firsts[:-1], scales=scales, mean=mean, basis=basis, sigmas=sigmas,
        coefficients=np.empty((0, len(sigmas)), dtype=np.float32), explained=explained,
    )  # fmt: skip
    return _with_coefficients(windows)


def pose_rows(poses: FloatArray, rate_hz: float, angles: Sequence[str], include_root: bool) -> FloatArray:
    """The rows (F − 1, m) of poses (F, 25): every frame but the first, which has no velocity."""
    columns = [POSE_NAMES.index(name) for name in angles]
    chosen = poses[:, columns]
    parts = [chosen[1:], np.diff(chosen, axis=0) * rate_hz]
    if include_root:
        moved, heading = np.diff(poses[:, :4], axis=0) * rate_hz, poses[:-1, 3]
        c, s = np.cos(heading), np.sin(heading)
        forward, sideways = c * moved[:, 0] + s * moved[:, 1], c * moved[:, 1] - s * moved[:, 0]
        parts.append(np.column_stack([forward, sideways, moved[:, 2:], poses[1:, 4:N_ROOT]]))
    return np.concatenate(parts, axis=1)


def advance(memory: FloatArray, rows: FloatArray, filters: FloatArray, offset: FloatArray, b: int) -> FloatArray:
    """The memory (N, d·b) after one more row (N, m): a window slides on without being stored.

    The coefficients of a window are Σ_k Ũ_kᵀ (ψ_{t−k} − ψ̄_k) with lag k = 0…d−1: a filter over the rows. In its
    transposed form block j of the memory holds what is known so far of the coefficients j frames ahead, and block 0
    the coefficients themselves. Exact, with d·b numbers a particle instead of d·m; see `Windows.filters`, `offset`.
    """
    moved = np.empty_like(memory)
    _advance(np.ascontiguousarray(memory), np.ascontiguousarray(rows), filters, offset, b, moved)
    return moved


@kernel()
def _advance(memory: Any, rows: Any, filters: Any, offset: Any, b: int, moved: Any) -> None:
    # not a matrix product, whose order of addition depends on the number of BLAS threads
    n, size = memory.shape
    for i in range(n):
        for k in range(size - b):
            moved[i, k] = memory[i, k + b] - offset[k]
        for k in range(size - b, size):
            moved[i, k] = -offset[k]
        for channel in range(rows.shape[1]):
            value = rows[i, channel]
            for k in range(size):
                moved[i, k] += value * filters[channel, k]


def _principal_components(
    rows: Float32Array, ends: IntArray, window_frames: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, float]:
    """scales (m,), mean (d, m), basis (d, m, b), sigmas (b,) and the explained part of the variance.

    From the covariance, dm × dm, rather than from the SVD of dm × n numbers; the components are the same.
    """
    spread = rows.std(axis=0, dtype=np.float64)
    scales = np.where(spread > 1e-9, spread, 1.0)  # a channel that never moves says nothing
    lags, size = np.arange(window_frames), window_frames * rows.shape[1]
    total, products = np.zeros(size), np.zeros((size, size))
    centre = rows.mean(axis=0, dtype=np.float64)  # near the mean already, so that nothing cancels below
    for first in range(0, len(ends), _BLOCK):
        block = (rows[ends[first : first + _BLOCK][:, None] - lags] - centre) / scales
        block = block.reshape(-1, size)
        total += block.sum(axis=0)
        products += block.T @ block
    mean = total / len(ends)
    variances, vectors = np.linalg.eigh(products / len(ends) - np.outer(mean, mean))
    variances, vectors = variances[::-1].clip(min=0.0), vectors[:, ::-1]
    rank = int((variances > 1e-12 * variances[0]).sum())
    b = max(1, min(int(np.log2(len(ends))), rank))
    vectors = vectors[:, :b] * np.sign(vectors[np.abs(vectors[:, :b]).argmax(axis=0), np.arange(b)])
    whole_mean = mean.reshape(window_frames, -1) + centre / scales
    explained = float(variances[:b].sum() / variances.sum())
    return scales, whole_mean, vectors.reshape(window_frames, -1, b), np.sqrt(variances[:b]), explained


def _with_coefficients(windows: Windows) -> Windows:
    d, b = windows.window_frames, len(windows.sigmas)
    filters = windows.filters.reshape(-1, d, b)
    constant = windows.offset.reshape(d, b).sum(axis=0)
    coefficients = np.empty((len(windows), b), dtype=np.float32)
    for first in range(0, len(windows), _BLOCK):
        block = windows.window_rows(np.arange(first, min(first + _BLOCK, len(windows))))
        coefficients[first : first + _BLOCK] = np.einsum("ndm,mdb->nb", block, filters, optimize=True) - constant
    return replace(windows, coefficients=coefficients)
