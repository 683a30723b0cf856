"""Search over limbs flipped in depth, an ambiguity of a single camera, for `smooth_fit`.

A forearm or calf that points away from a camera looks like one that points towards it (Sminchisescu & Triggs, Kinematic
Jump Processes for Monocular 3D Human Tracking, CVPR 2003). Between two times at which a limb is parallel to the image
plane it can point either way.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from workbench.body.kinematics import joints
from workbench.body.skeleton import Skeleton
from workbench.cameras.camera import Camera
from workbench.inference.least_squares.solver.sparse_solver import Minimum, Quadratic, minimise
from workbench.inference.least_squares.video.pose_problem import PoseProblem, reach_targets
from workbench.utils.arrays import FloatArray, IntArray

LIMBS = tuple(
    (f"{side}_{upper}", f"{side}_{middle}", f"{side}_{lower}")
    for side in ("left", "right")
    for upper, middle, lower in (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle"))
)
MIN_FRAMES = 3
"""Shortest interval of a flip; the fit itself corrects shorter ones."""
FLIP_SIGMA_M = 0.03
"""Standard deviation of a limb's joints from their flipped positions, against the body's limits."""
MARGIN = 10
"""Frames before and after an interval that are fitted with it."""
ROUNDS, MIN_GAIN, MAX_FLIP_COST, TOLERANCE, MAX_ITERATIONS = 4, 0.5, 1000.0, 0.1, 12
"""Flips are tried in rounds until none gains MIN_GAIN nats; those whose initial cost is MAX_FLIP_COST nats higher are
rejected. A fit ends at a predicted decrease below TOLERANCE nats."""


class FlipInterval(NamedTuple):
    """A limb, its joints (3,), in the frames [first, last)."""

    limb: IntArray
    first: int
    last: int


def flip_limbs(problem: PoseProblem, camera: Camera, poses: FloatArray) -> FloatArray:
    """Return the poses (T, P) with those limbs flipped in depth that lower the cost.

    Each flip is fitted in a window, its interval with MARGIN frames on either side, with all other frames fixed, and
    accepted immediately if the cost decreases. Later rounds try only intervals near the changes of the previous round.
    """
    poses, changed = poses.copy(), np.ones(len(poses), dtype=bool)
    for _ in range(ROUNDS):
        moved = np.zeros(len(poses), dtype=bool)
        for interval in tqdm(flip_intervals(problem.skeleton, camera, poses), desc="flips", disable=None, leave=False):
            window = slice(max(interval.first - MARGIN, 0), min(interval.last + MARGIN, len(poses)))
            if (changed[window] | moved[window]).any() and _try_flip(problem, camera, poses, interval, window):
                moved[window] = True
        if not moved.any():
            break
        changed = moved
    return poses


def flip_intervals(skeleton: Skeleton, camera: Camera, poses: FloatArray) -> list[FlipInterval]:
    """Return the intervals of poses (T, P) in which a limb's lower part points towards the camera or away from it, and
    for limbs that change direction also all frames."""
    depths, intervals = dict(_limb_depths(skeleton, camera, poses)), []
    for limb, depth in depths.items():
        edges = [0, *(np.flatnonzero(np.diff(np.sign(depth))) + 1), len(poses)]
        if len(edges) > 2:
            intervals.append(FlipInterval(np.array(limb), 0, len(poses)))
        intervals += [
            FlipInterval(np.array(limb), int(first), int(last))
            for first, last in pairwise(edges)
            if last - first >= MIN_FRAMES
        ]
    return intervals


def flipped(skeleton: Skeleton, camera: Camera, poses: FloatArray, limb: IntArray) -> FloatArray:
    """Return poses (n, P) with the lower part of a limb, joints (3,), flipped in depth as far as its limits allow."""
    positions = joints(skeleton, poses)[:, limb]
    rays, depth = _depth_along_ray(camera, positions[:, 1], positions[:, 2])
    targets = positions[:, 1:].copy()
    targets[:, 1] -= 2.0 * depth[:, None] * rays
    return reach_targets(skeleton, poses, limb, targets, FLIP_SIGMA_M)


def fit_window(problem: PoseProblem, poses: FloatArray, window: slice) -> Minimum:
    """Fit the frames of a window of poses (T, P), in place, with all others fixed; return the minimum."""
    window_poses = poses[window]

    def expand(x: FloatArray) -> Quadratic:
        window_poses[:] = x.reshape(window_poses.shape)
        return problem.expand_frames(poses, window.start, window.stop)

    minimum = minimise(expand, window_poses.flatten(), max_iterations=MAX_ITERATIONS, tolerance=0.0, min_gain=TOLERANCE)
    window_poses[:] = minimum.x.reshape(window_poses.shape)
    return minimum


def _try_flip(problem: PoseProblem, camera: Camera, poses: FloatArray, interval: FlipInterval, window: slice) -> bool:
    """Flip a limb in poses (T, P), in place, if that lowers the cost; return whether it does."""
    previous, cost = poses[window].copy(), problem.cost_of_frames(poses, window.start, window.stop)
    frames = slice(interval.first, interval.last)
    poses[frames] = flipped(problem.skeleton, camera, poses[frames], interval.limb)
    too_costly = problem.cost_of_frames(poses, window.start, window.stop) > cost + MAX_FLIP_COST
    if not too_costly and fit_window(problem, poses, window).costs[-1] < cost - MIN_GAIN:
        return True
    poses[window] = previous
    return False


def _limb_depths(skeleton: Skeleton, camera: Camera, poses: FloatArray) -> Iterator[tuple[tuple[int, ...], FloatArray]]:
    """Yield each limb's joints and the depth (T,), m, of its end behind its middle, seen from the camera."""
    positions = joints(skeleton, poses)
    for names in LIMBS:
        if set(names) <= set(skeleton.names):
            limb = tuple(skeleton.joint(name) for name in names)
            yield limb, _depth_along_ray(camera, positions[:, limb[1]], positions[:, limb[2]])[1]


def _depth_along_ray(camera: Camera, middle: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the directions (T, 3) from the camera to a limb's middle (T, 3), and the depths (T,), m, of its end (T, 3)
    behind it along them."""
    rays = middle - camera.position
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    return rays, ((end - middle) * rays).sum(axis=1)
