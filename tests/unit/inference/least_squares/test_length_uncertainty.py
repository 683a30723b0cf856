"""Uncertain limb lengths: their default deviations, and the covariances that they add to a fit of keypoints."""

from dataclasses import replace

import numpy as np
import pytest
from keypoint_scenes import BODY, CAMERA, streams
from view_scenes import CAMERAS, frames, observed, swinging

from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.stature import LIMBS, usual_height
from workbench.inference.initialization.limb_lengths import AVERAGE_M, HEIGHT_SIGMA, _initial_height_m, fit_lengths
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.video.systematic_errors import DEFAULT_LENGTH_SIGMA, default_length_uncertainty
from workbench.likelihoods.keypoints import KeypointLikelihood

SKELETON = BODY.skeleton


def fitted(skeleton, length_std, **options):
    """Return the fit of one camera's keypoints of a skeleton, with the body's default lengths."""
    times, poses = swinging(SKELETON, 8)
    body = replace(BODY, limb_length_std=length_std[:, :, None])
    inference = LeastSquares(body, KeypointLikelihood(body, **options))
    fit, _, _ = inference.fit_frames(frames(skeleton, times, poses, CAMERAS[:1]), poses[0], streams()["start"])
    return fit, poses


def test_default_deviations_are_proportional_to_the_lengths_and_common_to_both_sides():
    uncertainty = default_length_uncertainty(SKELETON)
    expected = DEFAULT_LENGTH_SIGMA * np.linalg.norm(SKELETON.offsets, axis=1)
    assert np.allclose(np.linalg.norm(uncertainty, axis=(1, 2)), expected)
    left, right = uncertainty[SKELETON.joint("left_knee")], uncertainty[SKELETON.joint("right_knee")]
    assert np.flatnonzero(np.abs(left).sum(axis=0)).tolist() == np.flatnonzero(np.abs(right).sum(axis=0)).tolist()


def test_an_uncertain_height_makes_the_depth_of_one_camera_as_uncertain():
    (uncertain, poses), (certain, _) = (fitted(SKELETON, factor * SKELETON.offsets) for factor in (0.05, 0.0))
    ray = poses[4, :3] - CAMERA.position
    distance = np.linalg.norm(ray)
    variance = (uncertain.covariance - certain.covariance)[4, :3, :3] @ ray / distance @ ray / distance
    assert np.sqrt(variance) == pytest.approx(0.05 * distance, rel=0.15)


def test_the_added_covariance_is_the_shift_of_a_fit_to_a_larger_person():
    cause = 0.03 * SKELETON.offsets
    larger = replace(SKELETON, offsets=SKELETON.offsets + cause)
    (uncertain, _), (shifted, _), (certain, _) = (
        fitted(skeleton, length_std, loss="squared")
        for skeleton, length_std in ((SKELETON, cause), (larger, cause), (SKELETON, 0.0 * cause))
    )
    shift = (shifted.poses - uncertain.poses)[:, :3]
    added = (uncertain.covariance - certain.covariance)[:, :3, :3]
    np.testing.assert_allclose(np.einsum("ti,tj->tij", shift, shift), added, rtol=0.3, atol=0.1 * np.abs(added).max())


def test_the_deviation_of_measured_lengths_depends_on_height_and_cameras():
    times, poses = swinging(SKELETON, 6)
    knee, ankle = SKELETON.joint("left_knee"), SKELETON.joint("left_ankle")
    leg = abs(SKELETON.offsets[knee, 2] + SKELETON.offsets[ankle, 2])

    def sigma(n_cameras, height_m):
        observations = observed(SKELETON, frames(SKELETON, times, poses, CAMERAS[:n_cameras]))
        uncertainty = fit_lengths([frame.keypoints for frame in observations], height_m).length_uncertainty
        return np.linalg.norm(uncertainty[knee, 2] + uncertainty[ankle, 2]) / leg

    unknown = sigma(1, None)
    assert unknown == pytest.approx(HEIGHT_SIGMA, rel=0.3)
    assert sigma(1, 1.75) < 0.6 * unknown  # only the proportions are uncertain
    assert sigma(2, None) < 0.6 * unknown


@pytest.mark.parametrize("height_m", [0.6, 1.1, 2.3])
def test_several_cameras_measure_people_who_are_no_adults(height_m):
    small = person(from_height(height_m)).skeleton
    times, poses = swinging(small, 6)
    observations = observed(small, frames(small, times, poses, CAMERAS))
    shape = fit_lengths([frame.keypoints for frame in observations]).shape
    assert usual_height({limb: getattr(shape, limb) for limb in LIMBS}) == pytest.approx(height_m, rel=0.05)


@pytest.mark.parametrize(("height_m", "is_adult"), [(1.19, False), (1.21, True), (2.19, True), (2.21, False)])
def test_the_fit_starts_from_an_adult_unless_the_cameras_show_another_person(height_m, is_adult):
    skeleton = person(from_height(height_m)).skeleton
    times, poses = swinging(skeleton, 6)
    views = [frame.keypoints for frame in observed(skeleton, frames(skeleton, times, poses, CAMERAS))]
    assert _initial_height_m(views) == pytest.approx(AVERAGE_M if is_adult else height_m)
    assert _initial_height_m([one[:1] for one in views]) == AVERAGE_M  # one camera measures no height


def test_length_deviations_scale_with_the_body():
    body = replace(BODY, limb_length_std=default_length_uncertainty(SKELETON))
    assert np.allclose(body.scaled(2.0).limb_length_std, 2.0 * body.limb_length_std)
    assert BODY.scaled(2.0).limb_length_std is None
