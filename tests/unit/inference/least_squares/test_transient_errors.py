"""Transient errors of a detector's joints are omitted, lasting differences are believed."""

from dataclasses import replace

import numpy as np
import pytest
from keypoint_scenes import BODY
from view_scenes import CAMERAS, frames, observed, swinging

from workbench.core.losses import KEYPOINT_LOSS, Loss
from workbench.core.prior import Smoothness
from workbench.inference.least_squares.video.pose_problem import KeypointArrays, PoseProblem
from workbench.inference.least_squares.video.transient_errors import (
    MAX_DURATION_S,
    OUTLIER,
    transient_errors,
    trusting_lasting_joints,
)

SKELETON = BODY.skeleton
SIGMA_PX, RATE_HZ = 3.0, 30.0
KNEE = SKELETON.joint("left_knee")


def displaced(first, last, deviations, neighbours=None):
    """Return a problem whose left knee is displaced in the frames [first, last], and possibly in the frames before and
    after; the true poses (T, P); and the keypoints (K,) that are displaced in [first, last]."""
    times, poses = swinging(SKELETON, 30, rate_hz=RATE_HZ)
    observations = observed(SKELETON, frames(SKELETON, times, poses, CAMERAS[:1], 0.0))
    keypoints = KeypointArrays.of(observations, lambda weights: np.ones(len(weights)) / SIGMA_PX)
    frame = np.repeat(np.arange(30), np.diff(keypoints.first))
    moved = (keypoints.joints == KNEE) & (frame >= first) & (frame <= last)
    sizes = np.where(moved, deviations, 0.0)
    if neighbours is not None:
        sizes[(keypoints.joints == KNEE) & np.isin(frame, [first - 1, last + 1])] = neighbours
    keypoints = replace(keypoints, pixels=keypoints.pixels + np.outer(sizes * SIGMA_PX, [1.0, 0.0]))
    contacts = np.zeros((30, 2), bool)
    return PoseProblem(SKELETON, keypoints, times, KEYPOINT_LOSS, Smoothness(), contacts), poses, moved


@pytest.mark.parametrize(("n_frames", "is_transient"), [(1, True), (7, True), (8, False), (30, False)])
def test_an_error_of_up_to_a_fifth_of_a_second_is_transient(n_frames, is_transient):
    problem, poses, moved = displaced(0 if n_frames == 30 else 10, 9 + n_frames, 2.0 * OUTLIER)
    assert ((n_frames - 1) / RATE_HZ <= MAX_DURATION_S + 1e-9) == is_transient
    np.testing.assert_array_equal(transient_errors(problem, poses), moved & is_transient)


@pytest.mark.parametrize(("deviations", "is_outlier"), [(0.99 * OUTLIER, False), (1.01 * OUTLIER, True)])
def test_an_outlier_is_beyond_three_standard_deviations(deviations, is_outlier):
    problem, poses, moved = displaced(10, 11, deviations)
    np.testing.assert_array_equal(transient_errors(problem, poses), moved & is_outlier)


@pytest.mark.parametrize(("jump", "is_transient"), [(0.99 * OUTLIER, False), (1.01 * OUTLIER, True)])
def test_an_error_that_grows_from_frame_to_frame_is_not_transient(jump, is_transient):
    problem, poses, moved = displaced(10, 12, 1.5 * OUTLIER, neighbours=1.5 * OUTLIER - jump)
    np.testing.assert_array_equal(transient_errors(problem, poses), moved & is_transient)


def test_transient_errors_are_omitted_and_lasting_ones_have_an_influence():
    problem, poses, moved = displaced(10, 11, 50.0)
    trusting = trusting_lasting_joints(problem, poses)
    assert len(trusting.keypoints.joints) == len(moved) - 2
    assert np.abs(trusting.residuals(poses)).max() < 1e-9
    problem, poses, moved = displaced(5, 25, 50.0)
    trusting = trusting_lasting_joints(problem, poses)
    assert len(trusting.keypoints.joints) == len(moved)
    undisturbed = displaced(5, 25, 0.0)[0].expand(poses.ravel()).gradient
    influence = [np.abs(each.expand(poses.ravel()).gradient - undisturbed).max() for each in (problem, trusting)]
    assert influence[1] > 100.0 * influence[0]


def test_a_loss_that_does_not_redescend_is_kept():
    problem, poses, _ = displaced(10, 11, 50.0)
    problem = replace(problem, loss=Loss("huber", 2.0))
    assert trusting_lasting_joints(problem, poses) is problem
