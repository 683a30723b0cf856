"""Limbs that are not as long as told: what keypoints make of them, by finite differences and by fits misled."""

from dataclasses import replace

import numpy as np
import pytest
from keypoint_scenes import BODY, CAMERA, streams
from view_scenes import CAMERAS, frames, observed, swinging

from workbench.inference.initialization.limb_lengths import HEIGHT_SIGMA, fit_lengths
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.systematic_errors import DEFAULT_LENGTH_SIGMA, default_length_uncertainty
from workbench.likelihoods.keypoints import KeypointLikelihood

SKELETON = BODY.skeleton


def test_told_bones_are_off_by_a_part_of_their_length_both_sides_alike():
    doubt = default_length_uncertainty(SKELETON)
    expected = DEFAULT_LENGTH_SIGMA * np.linalg.norm(SKELETON.offsets, axis=1)
    assert np.allclose(np.linalg.norm(doubt, axis=(1, 2)), expected)
    left, right = doubt[SKELETON.joint("left_knee")], doubt[SKELETON.joint("right_knee")]
    assert np.flatnonzero(np.abs(left).sum(axis=0)).tolist() == np.flatnonzero(np.abs(right).sum(axis=0)).tolist()


def test_who_may_be_a_twentieth_taller_may_be_a_twentieth_farther_away():
    times, poses = swinging(SKELETON, 8)
    taller = 0.05 * SKELETON.offsets[:, :, None]
    covariances = []
    for doubt in (taller, 0.0 * taller):
        body = replace(BODY, limb_length_std=doubt)
        fitting = LeastSquares(body, KeypointLikelihood(body))
        shown = frames(SKELETON, times, poses, CAMERAS[:1])
        fit, _, _ = fitting.fit_frames(shown, poses[0], streams()["start"])
        covariances.append(fit.covariance)
    ray = poses[4, :3] - CAMERA.position
    distance = np.linalg.norm(ray)
    along = (covariances[0] - covariances[1])[4, :3, :3] @ ray / distance @ ray / distance
    assert np.sqrt(along) == pytest.approx(0.05 * distance, rel=0.15)


def test_a_fit_to_someone_larger_is_off_as_it_says_it_may_be():
    times, poses = swinging(SKELETON, 8)
    cause = 0.03 * SKELETON.offsets
    larger = replace(SKELETON, offsets=SKELETON.offsets + cause)
    unsure, sure = (replace(BODY, limb_length_std=factor * cause[:, :, None]) for factor in (1.0, 0.0))

    def fitted(shown, body):
        fitting = LeastSquares(body, KeypointLikelihood(body, loss="squared"))
        return fitting.fit_frames(frames(shown, times, poses, CAMERAS[:1]), poses[0], streams()["start"])[0]

    fits = fitted(SKELETON, unsure), fitted(larger, unsure), fitted(SKELETON, sure)
    off = (fits[1].poses - fits[0].poses)[:, :3]
    told = (fits[0].covariance - fits[2].covariance)[:, :3, :3]
    np.testing.assert_allclose(np.einsum("ti,tj->tij", off, off), told, rtol=0.3, atol=0.1 * np.abs(told).max())


def test_a_measured_size_is_as_sure_as_what_is_known_of_it():
    times, poses = swinging(SKELETON, 6)
    knee, ankle = SKELETON.joint("left_knee"), SKELETON.joint("left_ankle")
    legs = abs(SKELETON.offsets[knee, 2] + SKELETON.offsets[ankle, 2])

    def sigma(cameras, height_m):
        seen = observed(SKELETON, frames(SKELETON, times, poses, CAMERAS[:cameras]))
        doubt = fit_lengths([frame.keypoints for frame in seen], height_m).length_uncertainty
        return np.linalg.norm(doubt[knee, 2] + doubt[ankle, 2]) / legs

    unknown = sigma(1, None)
    assert unknown == pytest.approx(HEIGHT_SIGMA, rel=0.3)
    assert sigma(1, 1.75) < 0.6 * unknown  # which leaves proportions
    assert sigma(2, None) < 0.6 * unknown


def test_a_body_of_another_size_is_as_unsure_of_itself():
    body = replace(BODY, limb_length_std=default_length_uncertainty(SKELETON))
    assert np.allclose(body.scaled(2.0).limb_length_std, 2.0 * body.limb_length_std)
    assert BODY.scaled(2.0).limb_length_std is None
