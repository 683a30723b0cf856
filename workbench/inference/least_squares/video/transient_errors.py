"""Transient errors of the joints that a detector finds in the images of one camera.

A redescending loss rejects every joint that is far from the fit. That is right where the detector confuses joints,
which lasts for a few frames, as when one leg passes the other. A joint that the detector sees far from the fit for
longer is where it sees it: the fit is wrong there, for example because it started in another posture. Several cameras
decide such cases by themselves, as a joint that one of them confuses for long has the others against it.
"""

from dataclasses import replace

import numpy as np

from workbench.core.losses import Loss
from workbench.inference.least_squares.video.pose_problem import PoseProblem
from workbench.utils.arrays import BoolArray, FloatArray

OUTLIER = 3.0
"""Standard deviations from which on a keypoint is an outlier."""
MAX_DURATION_S = 0.2
"""Longest transient error: the time in which one leg of a walking person hides the other."""


def trusting_lasting_joints(problem: PoseProblem, poses: FloatArray) -> PoseProblem:
    """Return the problem of one camera without the transient errors of its keypoints at poses (T, P), and with a loss
    that does not redescend, so that the fit leaves no other keypoint; the same problem for such a loss."""
    if not problem.loss.redescends:
        return problem
    keypoints = problem.keypoints.select(~transient_errors(problem, poses))
    return replace(problem, keypoints=keypoints, loss=Loss("huber", problem.loss.scale))


def transient_errors(problem: PoseProblem, poses: FloatArray) -> BoolArray:
    """Return which keypoints (K,) of one camera are outliers at poses (T, P) for at most MAX_DURATION_S, from the first
    of successive detections of a joint to the last."""
    keypoints = problem.keypoints
    outliers = np.linalg.norm(problem.residuals(poses), axis=1) > OUTLIER
    times_s = np.repeat(problem.times_s, np.diff(keypoints.first))
    transient = np.zeros(len(outliers), bool)
    for joint in np.unique(keypoints.joints):
        k = np.flatnonzero(keypoints.joints == joint)
        for first, end in np.flatnonzero(np.diff(outliers[k], prepend=False, append=False)).reshape(-1, 2):
            transient[k[first:end]] = times_s[k[end - 1]] - times_s[k[first]] <= MAX_DURATION_S
    return transient
