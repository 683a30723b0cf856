"""The likelihood of detected joints against the sum of Student's t densities."""

import numpy as np
import pytest
from keypoint_scenes import BODY
from likelihood_scenes import log_prob
from view_scenes import CAMERAS, frames, swinging

from workbench.body.kinematics import joints
from workbench.core.frame import Frame, View
from workbench.likelihoods.keypoints import KeypointLikelihood

SKELETON = BODY.skeleton


def test_the_log_likelihood_is_the_sum_of_students_log_densities():
    times, poses = swinging(SKELETON, 1)
    (frame,) = frames(SKELETON, times, poses, sigma_px=8.0)
    weights = np.linspace(0.2, 1.0, 15)
    views = [View(v.camera, v.image, np.column_stack([v.keypoints[:, :2], weights])) for v in frame.views]
    views[1].keypoints[3] = np.nan
    views[1].keypoints[4, 2] = 0.0
    candidates = poses + 0.1 * np.random.default_rng(1).standard_normal((5, 25))
    likelihood = KeypointLikelihood(BODY, sigma_px=3.0, likelihood_power=0.4)
    log_probs = log_prob(likelihood, frame, Frame(0, 0.0, tuple(views)), candidates, candidates)
    for pose, value in zip(candidates, log_probs, strict=True):
        expected = 0.0
        for view in views:
            pixels = view.camera.project(joints(SKELETON, pose[None])[0])
            for (u, v), (x, y, w) in zip(pixels, view.keypoints, strict=True):
                if w > 0.0:
                    expected += np.log((1.0 + w * ((u - x) ** 2 + (v - y) ** 2) / (4.0 * 9.0)) ** -3.0)
        assert value == pytest.approx(0.4 * expected, rel=1e-12)


def test_the_maximum_is_the_true_pose_in_spite_of_an_outlier():
    times, poses = swinging(SKELETON, 1)
    (frame,) = frames(SKELETON, times, poses)
    frame.views[0].keypoints[5, 0] += 300.0
    candidates = np.concatenate([poses, poses + 0.1 * np.random.default_rng(2).standard_normal((50, 25))])
    log_probs = log_prob(KeypointLikelihood(BODY), frame, frame, candidates, candidates)
    assert log_probs.argmax() == 0


def test_invalid_poses_are_impossible_and_a_frame_without_keypoints_is_noted():
    times, poses = swinging(SKELETON, 1)
    (frame,) = frames(SKELETON, times, poses, CAMERAS[:1])
    behind, not_finite = poses[0].copy(), poses[0].copy()
    behind[1] -= 8.0
    not_finite[7] = np.nan
    likelihood = KeypointLikelihood(BODY)
    frame_likelihood = likelihood.prepare(frame, frame)
    assert frame_likelihood.evaluate(poses, np.stack([behind, not_finite])).log_prob.tolist() == [-np.inf, -np.inf]
    assert frame_likelihood.notes + frame_likelihood.evaluate(poses, behind[None]).notes == ()
    empty = Frame(7, 0.1, ())
    assert log_prob(likelihood, frame, empty, poses, poses).tolist() == [0.0]
    assert likelihood.prepare(frame, empty).notes == ("frame 7: no usable keypoints",)
