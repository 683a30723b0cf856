"""Foot contacts detected in the images: an ankle at rest in the image, which is not raised above the other one, keeps
its position, and all of them are on one floor.

One camera determines a person's distance by their size in the image, frame by frame. A foot contact couples the frames,
and all contacts determine the height of the floor.
"""

from collections.abc import Sequence

import numpy as np

from workbench.body.kinematics import joints
from workbench.body.skeleton import Skeleton
from workbench.core.observations import Keypoints, Observed, person_px
from workbench.inference.least_squares.video.landmark_depths import landmark_places
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.nan_statistics import nan_median

ANKLES = ("left_ankle", "right_ankle")
MAX_CONTACT_SPEED = 0.15
"""In heights of the person per second, 0.25 m/s: a slower ankle, in every view that shows it, is in contact."""
WINDOW_S = 0.1
"""Time before and after a frame over which an ankle's speed in the image is estimated, because detections are noisy; at
lower rates the time of one frame, up to MAX_PAIR_S."""
MIN_VISIBLE_FRAMES = 3
"""Smallest number of frames in that time which show the ankle."""
MIN_CONTACT_S = 0.25
"""Shortest contact; a foot at rest for less time is reversing in the air."""
MAX_RAISED_M = 0.15
"""Median height, by a detector's world landmarks, of an ankle in contact above the other one. It is below 0.1 m of the
standing foot of walks and squats, and above 0.15 m of a foot that is held in the air."""
DRIFT_M = 0.013
"""Displacement of the ankle of a foot in contact along each axis in one second, proportional to √time: rms over 17
activities in the CMU and Bandai recordings, over 0.07 to 0.5 s."""
MAX_PAIR_S = 0.5
"""Longest time between two frames of one contact."""


def detect_foot_contacts(skeleton: Skeleton, observations: Sequence[Observed], times_s: FloatArray) -> BoolArray:
    """Return which of ANKLES (T, 2) are in contact with the ground in T frames at times (T,), s, in all views that show
    them; none without keypoints or without these joints in the skeleton."""
    shape = (len(observations), len(ANKLES))
    foot_contacts, visible = np.ones(shape, dtype=bool), np.zeros(shape, dtype=bool)
    raised_m = np.empty((0, *shape))
    for name in dict.fromkeys(view.camera.name for frame in observations for view in frame.keypoints):
        views = [next((view for view in frame.keypoints if view.camera.name == name), None) for frame in observations]
        seen = [view for view in views if view is not None]
        height_px, turns = person_px(seen), not all(view.camera.is_equal(seen[0].camera) for view in seen)
        for k, joint in enumerate(ANKLES):
            speeds = image_speeds(_joint_track(views, skeleton, joint, turns), times_s) / height_px
            visible[:, k] |= np.isfinite(speeds)
            foot_contacts[:, k] &= ~(speeds > MAX_CONTACT_SPEED)
        raised_m = np.concatenate([raised_m, _raised_m(skeleton, views)[None]])
    foot_contacts &= visible
    heights_m = nan_median(raised_m, axis=0)
    return np.column_stack([_lasting(foot_contacts[:, k], heights_m[:, k], times_s) for k in range(len(ANKLES))])


def image_speeds(positions: FloatArray, times_s: FloatArray) -> FloatArray:
    """Return the speeds (T,), px/s, of a point (T, 2 or 3), px, NaN where invisible: the slope of a line fitted within
    WINDOW_S, NaN for too few frames."""
    speeds = np.full(len(times_s), np.nan)
    step_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else 0.0
    window_s = max(WINDOW_S, min(step_s, MAX_PAIR_S))
    for t, time_s in enumerate(times_s):
        nearby = np.flatnonzero((np.abs(times_s - time_s) < 1.01 * window_s) & np.isfinite(positions).all(axis=1))
        if len(nearby) >= MIN_VISIBLE_FRAMES:
            offsets = times_s[nearby] - times_s[nearby].mean()
            speeds[t] = np.linalg.norm(offsets @ positions[nearby]) / (offsets @ offsets)
    return speeds


def contact_pairs(foot_contacts: BoolArray, times_s: FloatArray) -> IntArray:
    """Return the first frames and the feet (K, 2) of contacts (T, 2) that last from one frame to the next."""
    near = np.diff(times_s)[:, None] <= MAX_PAIR_S
    return np.argwhere(foot_contacts[:-1] & foot_contacts[1:] & near)


def median_foot_height(skeleton: Skeleton, poses: FloatArray, foot_contacts: BoolArray) -> float:
    """Return the median height, m, of the ankles in contact (T, 2), at least one, in poses (T, P)."""
    positions = joints(skeleton, poses)[:, [skeleton.joint(name) for name in ANKLES], 2]
    return float(np.median(positions[foot_contacts]))


def _raised_m(skeleton: Skeleton, views: Sequence[Keypoints | None]) -> FloatArray:
    """Return the height (T, 2), m, of each ankle above the other one by the world landmarks of one camera's views; NaN
    without."""
    raised_m = np.full((len(views), len(ANKLES)), np.nan)
    for t, view in enumerate(views):
        if view is not None and view.world_landmarks is not None and set(ANKLES) <= set(skeleton.names):
            left_m, right_m = landmark_places(skeleton, view)[[skeleton.joint(name) for name in ANKLES], 2]
            raised_m[t] = left_m - right_m, right_m - left_m
    return raised_m


def _lasting(contacts: BoolArray, raised_m: FloatArray, times_s: FloatArray) -> BoolArray:
    """Return contacts (T,) without the intervals that are shorter than MIN_CONTACT_S, or of a raised foot."""
    lasting = contacts.copy()
    for frames in np.split(np.arange(len(contacts)), np.flatnonzero(np.diff(times_s) > MAX_PAIR_S) + 1):
        edges = np.flatnonzero(np.diff(contacts[frames], prepend=False, append=False)) + frames[0]
        for first, end in edges.reshape(-1, 2):
            is_raised = nan_median(raised_m[first:end]) > MAX_RAISED_M
            lasting[first:end] = times_s[end - 1] - times_s[first] >= MIN_CONTACT_S and not is_raised
    return lasting


def _joint_track(views: Sequence[Keypoints | None], skeleton: Skeleton, joint: str, turns: bool) -> FloatArray:
    """Return a joint's positions (T, 2), px, in the views (T,) of one camera; NaN where it is invisible. Of a camera
    that turns they lie on a sphere (T, 3) about it, with the focal length as radius."""
    positions = np.full((len(views), 3 if turns else 2), np.nan)
    for t, view in enumerate(views):
        if view is not None and joint in skeleton.names and (rows := view.joints == skeleton.joint(joint)).any():
            pixel, camera = view.detections[rows][0, :2], view.camera
            positions[t] = camera.matrix[0, 0] * camera.directions(camera.undistorted(pixel)) if turns else pixel
    return positions
