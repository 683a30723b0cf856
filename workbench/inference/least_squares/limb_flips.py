"""Limbs turned over in depth, which one camera cannot tell from what they were: the search of `smooth_fit` for them.

A forearm or calf that points away from a camera looks like one that points towards it (Sminchisescu & Triggs, Kinematic
Jump Processes for Monocular 3D Human Tracking, CVPR 2003). Between two times at which a limb lies across the view it
can point one way or the other.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from workbench.body.camera import Camera
from workbench.body.kinematics import joints
from workbench.body.skeleton import Skeleton
from workbench.inference.least_squares.keypoint_problem import KeypointProblem, reaching
from workbench.inference.least_squares.solver import Minimum, Quadratic, minimise
from workbench.utils.arrays import FloatArray, IntArray

LIMBS = tuple(
    (f"{side}_{upper}", f"{side}_{middle}", f"{side}_{lower}")
    for side in ("left", "right")
    for upper, middle, lower in (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle"))
)
MIN_FRAMES = 3
"""A shorter stretch is left to the fit, which gets there by itself."""
FLIP_SIGMA_M = 0.03
"""How near the joints of a limb come to where the flip has them, against the body's limits."""
MARGIN = 10
"""Frames before and after a stretch that move with it."""
ROUNDS, MIN_GAIN, HOPELESS, TOLERANCE, MAX_ITERATIONS = 4, 0.5, 1000.0, 0.1, 12
"""Flips are tried in rounds until none gains MIN_GAIN nats. Not those that cost HOPELESS nats more at first. A fit ends
when it promises less than TOLERANCE nats."""


class Stretch(NamedTuple):
    """A limb, its joints (3,), in the frames from `first` to before `last`."""

    limb: IntArray
    first: int
    last: int


def turn_limbs(problem: KeypointProblem, camera: Camera, poses: FloatArray) -> FloatArray:
    """Return the poses (T, P), or such with limbs turned over in depth that fit better.

    Each flip is fitted in a window, its stretch with MARGIN frames on either side, against fixed neighbours, and taken
    at once where the cost falls. A round after the first tries what a gain of the one before may have changed.
    """
    poses, changed = poses.copy(), np.ones(len(poses), dtype=bool)
    for _ in range(ROUNDS):
        moved = np.zeros(len(poses), dtype=bool)
        for stretch in tqdm(stretches(problem.skeleton, camera, poses), desc="flips", disable=None, leave=False):
            window = slice(max(stretch.first - MARGIN, 0), min(stretch.last + MARGIN, len(poses)))
            if (changed[window] | moved[window]).any() and _flip(problem, camera, poses, stretch, window):
                moved[window] = True
        if not moved.any():
            break
        changed = moved
    return poses


def stretches(skeleton: Skeleton, camera: Camera, poses: FloatArray) -> list[Stretch]:
    """List the stretches in poses (T, P) in which a limb's lower part points one way, towards the camera or away, and
    all frames where it does not do so throughout."""
    away, found = dict(_away(skeleton, camera, poses)), []
    for limb, depth in away.items():
        edges = [0, *(np.flatnonzero(np.diff(np.sign(depth))) + 1), len(poses)]
        if len(edges) > 2:
            found.append(Stretch(np.array(limb), 0, len(poses)))
        found += [
            Stretch(np.array(limb), int(first), int(last))
            for first, last in pairwise(edges)
            if last - first >= MIN_FRAMES
        ]
    return found


def turned(skeleton: Skeleton, camera: Camera, poses: FloatArray, limb: IntArray) -> FloatArray:
    """Return poses (n, P) with the lower part of a limb, joints (3,), turned over in depth as far as its limits
    allow."""
    places = joints(skeleton, poses)[:, limb]
    rays, depth = _behind(camera, places[:, 1], places[:, 2])
    aims = places[:, 1:].copy()
    aims[:, 1] -= 2.0 * depth[:, None] * rays
    return reaching(skeleton, poses, limb, aims, FLIP_SIGMA_M)


def fit_window(problem: KeypointProblem, poses: FloatArray, window: slice) -> Minimum:
    """Fit the frames of a window of poses (T, P), in place, the others held."""
    own = poses[window]

    def expand(x: FloatArray) -> Quadratic:
        own[:] = x.reshape(own.shape)
        return problem.expand_frames(poses, window.start, window.stop)

    minimum = minimise(expand, own.flatten(), max_iterations=MAX_ITERATIONS, tolerance=0.0, least_gain=TOLERANCE)
    own[:] = minimum.x.reshape(own.shape)
    return minimum


def _flip(problem: KeypointProblem, camera: Camera, poses: FloatArray, stretch: Stretch, window: slice) -> bool:
    """Turn a stretch over in poses (T, P), in place, where that fits better; return whether it does."""
    before, cost = poses[window].copy(), problem.cost_of_frames(poses, window.start, window.stop)
    own = slice(stretch.first, stretch.last)
    poses[own] = turned(problem.skeleton, camera, poses[own], stretch.limb)
    hopeless = problem.cost_of_frames(poses, window.start, window.stop) > cost + HOPELESS
    if not hopeless and fit_window(problem, poses, window).costs[-1] < cost - MIN_GAIN:
        return True
    poses[window] = before
    return False


def _away(skeleton: Skeleton, camera: Camera, poses: FloatArray) -> Iterator[tuple[tuple[int, ...], FloatArray]]:
    """Yield each limb's joints and how far its end is behind its middle, (T,) m, seen from the camera."""
    places = joints(skeleton, poses)
    for names in LIMBS:
        if set(names) <= set(skeleton.names):
            limb = tuple(skeleton.joint(name) for name in names)
            yield limb, _behind(camera, places[:, limb[1]], places[:, limb[2]])[1]


def _behind(camera: Camera, middle: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the directions (T, 3) from the camera to a limb's middle (T, 3), and how far its end (T, 3) is behind it
    along them, (T,) m."""
    rays = middle - camera.position
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    return rays, ((end - middle) * rays).sum(axis=1)
