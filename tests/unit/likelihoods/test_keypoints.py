"""The likelihood of 2-D joints, against the formula worked out joint by joint."""

import numpy as np
import pytest
from keypoint_scenes import BODY
from likelihood_scenes import log_prob
from view_scenes import CAMERAS, frames, swinging

from workbench.body.kinematics import joints
from workbench.core.frame import Frame, View
from workbench.likelihoods.keypoints import KeypointLikelihood

SKELETON = BODY.skeleton


def test_it_is_student_s_density_of_every_joint_in_every_view():
    times, poses = swinging(SKELETON, 1)
    (frame,) = frames(SKELETON, times, poses, sigma_px=8.0)
    weights = np.linspace(0.2, 1.0, 15)
    views = [View(v.camera, v.image, np.column_stack([v.keypoints[:, :2], weights])) for v in frame.views]
    views[1].keypoints[3] = np.nan
    views[1].keypoints[4, 2] = 0.0
    some = poses + 0.1 * np.random.default_rng(1).standard_normal((5, 25))
    likelihood = KeypointLikelihood(BODY, sigma_px=3.0, likelihood_power=0.4)
    found = log_prob(likelihood, frame, Frame(0, 0.0, tuple(views)), some, some)
    for pose, value in zip(some, found, strict=True):
        expected = 0.0
        for view in views:
            pixels = view.camera.project(joints(SKELETON, pose[None])[0])
            for (u, v), (x, y, w) in zip(pixels, view.keypoints, strict=True):
                if w > 0.0:
                    expected += np.log((1.0 + w * ((u - x) ** 2 + (v - y) ** 2) / (4.0 * 9.0)) ** -3.0)
        assert value == pytest.approx(0.4 * expected, rel=1e-12)


def test_two_cameras_tell_the_pose_from_its_neighbours_and_one_wrong_joint_does_not_matter():
    times, poses = swinging(SKELETON, 1)
    (frame,) = frames(SKELETON, times, poses)
    frame.views[0].keypoints[5, 0] += 300.0
    others = np.concatenate([poses, poses + 0.1 * np.random.default_rng(2).standard_normal((50, 25))])
    found = log_prob(KeypointLikelihood(BODY), frame, frame, others, others)
    assert found.argmax() == 0


def test_what_cannot_be_is_impossible_and_what_is_not_there_is_told():
    times, poses = swinging(SKELETON, 1)
    (frame,) = frames(SKELETON, times, poses, CAMERAS[:1])
    behind, broken = poses[0].copy(), poses[0].copy()
    behind[1] -= 8.0
    broken[7] = np.nan
    likelihood = KeypointLikelihood(BODY)
    frame_likelihood = likelihood.prepare(frame, frame)
    assert frame_likelihood.evaluate(poses, np.stack([behind, broken])).log_prob.tolist() == [-np.inf, -np.inf]
    assert frame_likelihood.notes + frame_likelihood.evaluate(poses, behind[None]).notes == ()
    blind = Frame(7, 0.1, ())
    assert log_prob(likelihood, frame, blind, poses, poses).tolist() == [0.0]
    assert likelihood.prepare(frame, blind).notes == ("frame 7: no usable keypoints",)
