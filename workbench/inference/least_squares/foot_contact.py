"""Feet that stand: an ankle whose image keeps still keeps its place, and all that stand do so on one floor.

One camera tells how far away a person is by their size in the image, frame by frame. A foot that stands ties the frames
together, and where the floor is follows from all of them.
"""

from collections.abc import Sequence

import numpy as np

from workbench.body.kinematics import joint_jacobian, joints
from workbench.body.skeleton import Skeleton
from workbench.core.observations import Keypoints, Observed, person_px
from workbench.core.residual import Loss, robust
from workbench.inference.least_squares.all_frames import Tie
from workbench.utils.arrays import BoolArray, FloatArray

ANKLES = ("left_ankle", "right_ankle")
STILL = 0.15
"""Heights of the person a second, 0.25 m/s: an ankle that moves slower in every view that sees it stands."""
WINDOW_S = 0.1
"""Time before and after a frame over which an ankle's speed in the image is measured: detectors tremble."""
LEAST_SEEN = 3
"""Frames in that time which have to show the ankle."""
LEAST_S = 0.25
"""A foot that keeps still for less turns round in the air."""
DRIFT_M = 0.013
"""How far a standing foot's ankle gets along each axis in a second, growing with the time's root: rms over 17
activities in CMU's and Bandai's recordings, over 0.07 to 0.5 s."""
DRIFT_LOSS = Loss("huber", 2.0)
"""A foot may only seem to stand, as it comes straight towards the camera."""


def standing_feet(skeleton: Skeleton, seen: Sequence[Observed], times_s: FloatArray) -> BoolArray:
    """Return which of ANKLES (T, 2) stand in each of T frames at times (T,), s, by all views that show them; none where
    there are no keypoints, or the skeleton has no such joints."""
    stand, shown = np.ones((len(seen), len(ANKLES)), dtype=bool), np.zeros((len(seen), len(ANKLES)), dtype=bool)
    for name in dict.fromkeys(view.camera.name for frame in seen for view in frame.keypoints):
        views = [next((view for view in frame.keypoints if view.camera.name == name), None) for frame in seen]
        height_px = person_px([view for view in views if view is not None])
        for k, joint in enumerate(ANKLES):
            speeds = image_speeds(_track(views, skeleton, joint), times_s) / height_px
            shown[:, k] |= np.isfinite(speeds)
            stand[:, k] &= ~(speeds > STILL)
    stand &= shown
    return np.stack([_lasting(own, times_s) for own in stand.T], axis=1)


def image_speeds(places: FloatArray, times_s: FloatArray) -> FloatArray:
    """Measure how fast a point (T, 2), px, NaN where it is not seen, moves, px/s: (T,), the slope of a line fitted to
    what is within WINDOW_S, NaN where that is too little."""
    speeds = np.full(len(times_s), np.nan)
    for t, time_s in enumerate(times_s):
        near = np.flatnonzero((np.abs(times_s - time_s) < 1.01 * WINDOW_S) & np.isfinite(places).all(axis=1))
        if len(near) >= LEAST_SEEN:
            apart = times_s[near] - times_s[near].mean()
            speeds[t] = np.linalg.norm(apart @ places[near]) / (apart @ apart)
    return speeds


def ties_of_feet(skeleton: Skeleton, stand: BoolArray, times_s: FloatArray) -> list[tuple[int, Tie]]:
    """Tie the ankles that stand, (T, 2), in two frames on end to one place: the first one's number, and the tie."""
    held = stand[:-1] & stand[1:]
    return [
        (int(t), _tie(skeleton, skeleton.joint(ANKLES[k]), DRIFT_M * np.sqrt(times_s[t + 1] - times_s[t])))
        for t, k in np.argwhere(held)
    ]


def standing_height(skeleton: Skeleton, poses: FloatArray, stand: BoolArray) -> float:
    """Return the median height, m, of the ankles that stand, (T, 2), of which there are some, in poses (T, P)."""
    places = joints(skeleton, poses)[:, [skeleton.joint(name) for name in ANKLES], 2]
    return float(np.median(places[stand]))


def _lasting(still: BoolArray, times_s: FloatArray) -> BoolArray:
    """Keep of what holds in some of T frames the stretches that last."""
    kept, edges = still.copy(), np.flatnonzero(np.diff(still, prepend=False, append=False))
    for first, end in edges.reshape(-1, 2):
        kept[first:end] = times_s[end - 1] - times_s[first] >= LEAST_S
    return kept


def _track(views: Sequence[Keypoints | None], skeleton: Skeleton, joint: str) -> FloatArray:
    """Pick where a joint is in the views (T,) of one camera, (T, 2), px; NaN where it is not seen."""
    places = np.full((len(views), 2), np.nan)
    for t, view in enumerate(views):
        if view is not None and joint in skeleton.names and (own := view.joints == skeleton.joint(joint)).any():
            places[t] = view.marks[own][0, :2]
    return places


def _tie(skeleton: Skeleton, joint: int, sigma_m: float) -> Tie:
    """Measure how far a joint gets from one pose to the next, with this deviation along each axis."""

    def moved(both: FloatArray) -> tuple[FloatArray, FloatArray]:
        poses = both.reshape(2, -1)
        places, slopes = joints(skeleton, poses)[:, joint], joint_jacobian(skeleton, poses)[:, joint]
        return (places[1] - places[0]) / sigma_m, np.hstack([-slopes[0], slopes[1]]) / sigma_m

    return robust(moved, DRIFT_LOSS)
