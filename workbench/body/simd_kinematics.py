"""Forward kinematics in kernels, with SIMD instructions: LANES poses at once, one per lane.

A row is LANES numbers, one of each pose. Every innermost loop runs over a row, has no branch and calls no function, not
even the mathematical library, so that the compiler vectorises it.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import numba
import numpy as np

_Function = TypeVar("_Function", bound=Callable[..., Any])

LANES = 16
"""Poses processed at once: two vectors of float32 or four of float64 on common processors, which hides latencies."""
FAST = {"reassoc", "contract", "nsz", "arcp"}  # every reordering of sums that keeps NaN and infinity meaningful
inlined: Callable[[_Function], _Function] = numba.njit(  # type: ignore[call-overload]
    error_model="numpy", fastmath=FAST, forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True
)
"""Compile functions of kernels for inlining; not callable from Python, which saves compile time. Without inlining, a
call may use either the copy compiled by itself or that in the caller, with different rounding of sums, depending on
which is in memory."""
inlined_exactly: Callable[[_Function], _Function] = numba.njit(  # type: ignore[call-overload]
    error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True
)
"""As `inlined`, without reordering of sums, for kernels that call functions of the other kind."""

# Rows of a joint's frame: its rotation row by row, and its position, m.
ROTATION, POSITION, FRAME = 0, 9 * LANES, 12 * LANES


@inlined
def lane_frames(poses: Any, first: int, last: int, skeleton: Any, values: Any, frames: Any) -> None:
    """Write the joints' world frames (J, FRAME) of poses (N, P) from `first` on, repeating the one before `last`; equal
    to `kinematics.forward` up to rounding. skeleton: its parents, offsets, dof_joints and dof_axes. values: ((P + 9) ·
    LANES,), overwritten."""
    n_dofs, (parents, offsets, dof_joints, dof_axes) = poses.shape[1], skeleton
    rotation, numbers = values[: 9 * LANES], values[9 * LANES :]
    for p in range(n_dofs):
        for lane in range(LANES):
            numbers[p * LANES + lane] = poses[min(first + lane, last - 1), p]
    p = 3
    for j in range(parents.shape[0]):
        frame = frames[j]
        if parents[j] < 0:
            _root(numbers, frame)
        else:
            _attach(frames[parents[j]], offsets[j, 0], offsets[j, 1], offsets[j, 2], frame)
        while p < n_dofs and dof_joints[p] == j:
            _axis_rotations(dof_axes[p, 0], dof_axes[p, 1], dof_axes[p, 2], numbers[p * LANES :], rotation)
            _multiply(frame, rotation)
            p += 1


@inlined
def load_frames(rotations: Any, positions: Any, first: int, frames: Any) -> None:
    """Load precomputed frames: rotations (N, J, 3, 3) and positions (N, J, 3)."""
    for lane in range(LANES):
        i = min(first + lane, positions.shape[0] - 1)
        for j in range(frames.shape[0]):
            for a in range(3):
                frames[j, POSITION + a * LANES + lane] = positions[i, j, a]
                for b in range(3):
                    frames[j, ROTATION + (3 * a + b) * LANES + lane] = rotations[i, j, a, b]


@inlined
def _root(position: Any, frame: Any) -> None:
    """Write the root's frame before its rotations."""
    for row in range(9):
        for lane in range(LANES):
            frame[row * LANES + lane] = 1.0 if row % 4 == 0 else 0.0
    for i in range(3 * LANES):
        frame[POSITION + i] = position[i]


@inlined
def _attach(parent: Any, x: float, y: float, z: float, frame: Any) -> None:
    """Write the frame of a joint at (x, y, z) in its parent's frame, before its rotations."""
    for lane in range(LANES):
        for a in range(3):
            row = 3 * a * LANES + lane
            u, v, w = parent[row], parent[row + LANES], parent[row + 2 * LANES]
            frame[row], frame[row + LANES], frame[row + 2 * LANES] = u, v, w
            place = parent[POSITION + a * LANES + lane]
            frame[POSITION + a * LANES + lane] = place + u * x + v * y + w * z


@inlined
def _axis_rotations(x: float, y: float, z: float, angles: Any, rotation: Any) -> None:
    """Write the rotations (9 rows) about a unit axis: Rodrigues' formula."""
    for lane in range(LANES):
        s, c = _sine_cosine(angles[lane])
        t = 1.0 - c
        rotation[lane], rotation[LANES + lane], rotation[2 * LANES + lane] = (
            c + t * x * x, t * x * y - s * z, t * x * z + s * y,
        )  # fmt: skip
        rotation[3 * LANES + lane], rotation[4 * LANES + lane] = t * x * y + s * z, c + t * y * y
        rotation[5 * LANES + lane], rotation[6 * LANES + lane] = t * y * z - s * x, t * x * z - s * y
        rotation[7 * LANES + lane], rotation[8 * LANES + lane] = t * y * z + s * x, c + t * z * z


@inlined
def _multiply(frame: Any, rotation: Any) -> None:
    """Rotate the frame about its origin."""
    for lane in range(LANES):
        for a in range(3):
            row = 3 * a * LANES + lane
            x, y, z = frame[row], frame[row + LANES], frame[row + 2 * LANES]
            for b in range(3):
                to = b * LANES + lane
                frame[row + b * LANES] = x * rotation[to] + y * rotation[to + 3 * LANES] + z * rotation[to + 6 * LANES]


@inlined
def _sine_cosine(angle: float) -> Any:
    """Return sine and cosine, by Taylor's series on −π/4..π/4, with remainders below 5e-17, and the quadrant's signs.
    The error is that of π/2 times the number of quadrants: negligible for people; for angles of 1e15 rad, beyond the
    resolution of float64, the result is merely finite."""
    quarter = np.floor(angle * (2.0 / np.pi) + 0.5)
    r = min(max(angle - quarter * (np.pi / 2.0), -1.0), 1.0)
    q = r * r
    # 1 − q/2·3 (1 − q/4·5 (1 − …)), the series of r times it and of the cosine in the same way
    s = 1.0 - q / 156.0 * (1.0 - q / 210.0)
    s = 1.0 - q / 6.0 * (1.0 - q / 20.0 * (1.0 - q / 42.0 * (1.0 - q / 72.0 * (1.0 - q / 110.0 * s))))
    c = 1.0 - q / 132.0 * (1.0 - q / 182.0 * (1.0 - q / 240.0))
    c = 1.0 - q / 2.0 * (1.0 - q / 12.0 * (1.0 - q / 30.0 * (1.0 - q / 56.0 * (1.0 - q / 90.0 * c))))
    s *= r
    half = np.floor(quarter * 0.5)
    odd = quarter - 2.0 * half  # 1 in the second and the fourth quadrant
    sign = 1.0 - 2.0 * (half - 2.0 * np.floor(half * 0.5))  # −1 in the third and the fourth
    sine, cosine = (c, -s) if odd > 0.5 else (s, c)
    return sign * sine, sign * cosine
