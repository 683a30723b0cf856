"""An arm with its own prior, while the other joints follow a fitted trajectory."""

from dataclasses import replace

import numpy as np
import pytest
from keypoint_scenes import BODY
from view_scenes import errors_mm, frames, swinging

from workbench.body.skeleton import PARTS, POSE_NAMES
from workbench.inference.initialization.from_keypoints import trajectory_of_keypoints
from workbench.likelihoods.keypoints import KeypointLikelihood
from workbench.priors.fitted_rest import FittedRest, Trajectory
from workbench.priors.smooth import Smooth
from workbench.utils.errors import InputError

SKELETON, RATE_HZ = BODY.skeleton, 14.0
ARM = np.isin(POSE_NAMES, PARTS["right_arm"])


def fitted_rest(times_s, poses):
    return FittedRest(Smooth(parameters=["right_arm"]), lambda: Trajectory(times_s, poses))


def test_the_rest_follows_the_trajectory_and_the_arm_its_prior():
    times, poses = swinging(SKELETON)
    prior, alone = fitted_rest(times, poses), Smooth(parameters=["right_arm"])
    rng, same = np.random.default_rng(0), np.random.default_rng(0)
    state, arm = prior.sample_initial(poses[0], 20, rng), alone.sample_initial(poses[0], 20, same)
    for t in range(1, 3 * len(times)):  # half frames, and past the last
        state, arm = (
            prior.sample_transition(state, 0.5 / RATE_HZ, rng),
            alone.sample_transition(arm, 0.5 / RATE_HZ, same),
        )
        low, high = (poses[min(k, len(times) - 1)] for k in (t // 2, (t + 1) // 2))
        tracked = prior.pose(state)
        np.testing.assert_allclose(tracked[:, ~ARM], np.tile(0.5 * (low + high)[~ARM], (20, 1)), atol=1e-12)
        assert (tracked[:, ARM] == alone.pose(arm)[:, ARM]).all()


def test_the_trajectory_of_two_cameras_keypoints_is_the_persons_motion():
    times, poses = swinging(SKELETON)
    observations = [replace(frame, time_s=frame.time_s + 3.0) for frame in frames(SKELETON, times, poses, sigma_px=2.0)]
    trajectory = trajectory_of_keypoints(SKELETON, observations)
    np.testing.assert_allclose(trajectory.times_s, times, atol=1e-12)
    assert errors_mm(SKELETON, trajectory.poses, poses) < 14.0


def test_a_selected_camera_is_evaluated_alone():
    times, poses = swinging(SKELETON, 1)
    (frame,) = frames(SKELETON, times, poses, sigma_px=8.0)
    candidates = poses + 0.1 * np.random.default_rng(1).standard_normal((5, 25))
    for view in frame.views:
        selected = (
            KeypointLikelihood(BODY, cameras=[view.camera.name]).prepare(frame, frame).evaluate(candidates, candidates)
        )
        alone = replace(frame, views=(view,))
        expected = KeypointLikelihood(BODY).prepare(alone, alone).evaluate(candidates, candidates)
        np.testing.assert_array_equal(selected.log_prob, expected.log_prob)
    with pytest.raises(InputError, match="unknown camera 'back'; expected some of front, side"):
        KeypointLikelihood(BODY, cameras=["back"]).prepare(frame, frame)
