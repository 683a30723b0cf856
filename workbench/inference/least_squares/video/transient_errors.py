"""Transient errors of the joints that a detector finds in the images of one camera.

A redescending loss rejects every joint that is far from the fit. That is right where the detector confuses joints,
which begins and ends from one frame to the next and lasts for a few frames, as when one leg passes the other. A joint
that the detector sees far from the fit for longer, or that moves away from the fit and back, is where it sees it: the
fit is wrong there, for example because it started in another posture, or because it smooths the swing of a leg. Several
cameras decide such cases by themselves, as a joint that one of them confuses for long has the others against it.
"""

from dataclasses import replace

import numpy as np

from workbench.core.losses import Loss
from workbench.inference.least_squares.video.pose_problem import PoseProblem
from workbench.utils.arrays import BoolArray, FloatArray

OUTLIER = 3.0
"""Standard deviations from which on a keypoint is an outlier, and from which on an error has jumped."""
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
    of successive detections of a joint to the last, with a jump of their error before and after."""
    keypoints, residuals = problem.keypoints, problem.residuals(poses)
    outliers = np.linalg.norm(residuals, axis=1) > OUTLIER
    times_s = np.repeat(problem.times_s, np.diff(keypoints.first))
    transient = np.zeros(len(outliers), bool)
    for joint in np.unique(keypoints.joints):
        k = np.flatnonzero(keypoints.joints == joint)
        jumps = np.linalg.norm(np.diff(residuals[k], axis=0), axis=1) > OUTLIER
        jumps = np.concatenate([[True], jumps, [True]])  # nothing is known before the first frame and after the last
        for first, end in np.flatnonzero(np.diff(outliers[k], prepend=False, append=False)).reshape(-1, 2):
            lasting = times_s[k[end - 1]] - times_s[k[first]] > MAX_DURATION_S
            transient[k[first:end]] = jumps[first] and jumps[end] and not lasting
    return transient
