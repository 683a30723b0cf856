"""The residuals of likelihoods against those they are made of, and the product of several."""

import numpy as np
import pytest
from keypoint_scenes import BODY
from view_scenes import CAMERAS, frames, swinging

from workbench.body.surface import person_surface
from workbench.core.observations import Observables, Observed, observe
from workbench.core.residual import Loss, ResidualLikelihood, keypoint_residual, robust, surface_residual
from workbench.likelihoods.keypoints import KeypointLikelihood
from workbench.likelihoods.product import Product
from workbench.likelihoods.surface_points import SurfacePoints
from workbench.likelihoods.uniform import Uniform
from workbench.utils.errors import InputError

SKELETON = BODY.skeleton
EVEN = {"points": 1.0, "keypoints": 1.0}


@pytest.fixture(scope="module")
def scene():
    """What one frame shows, and a pose near the one that it shows."""
    times, poses = swinging(SKELETON, 1)
    (seen,), _ = observe(frames(SKELETON, times, poses, sigma_px=2.0), SKELETON, 100, np.random.default_rng(0))
    cloud = poses[0, :3] + 0.2 * np.random.default_rng(1).standard_normal((40, 3))
    return Observed(cloud, seen.keypoints), poses[0] + 0.02


def both(**keypoints):
    return {"points": SurfacePoints(BODY), "keypoints": KeypointLikelihood(BODY, **keypoints)}


def equal(found, expected):
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)


def test_points_are_whitened_by_their_deviation(scene):
    seen, pose = scene
    likelihood = SurfacePoints(BODY, sigma=0.04, residual="field", loss="huber", loss_scale=0.1)
    equal(
        likelihood.residual_function(seen)(pose),
        surface_residual(SKELETON, person_surface(BODY), seen.points, "field", 0.04)(pose),
    )
    assert likelihood.residual_loss == Loss("huber", 2.5)
    assert likelihood.observables == Observables(sigma=0.04, residual="field", common_bias_std_m=0.012)
    assert isinstance(likelihood, ResidualLikelihood)


def test_a_keypoint_of_four_times_the_weight_is_four_equal_marks(scene):
    """In the cost and its Gauss–Newton model: a weight is over the variance."""
    seen, pose = scene
    view = seen.keypoints[0]
    joints, marks = view.joints[:1], view.marks[:1].copy()

    def model(joints, marks):
        misses, slopes = keypoint_residual(SKELETON, view.camera, joints, marks, 3.0)(pose)
        return misses @ misses, slopes.T @ misses, slopes.T @ slopes

    marks[0, 2] = 0.2
    four = model(np.repeat(joints, 4), np.repeat(marks, 4, axis=0))
    marks[0, 2] = 0.8
    for one, other in zip(model(joints, marks), four, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)


def test_keypoints_of_the_cameras_that_count_are_whitened(scene):
    seen, pose = scene
    likelihood = KeypointLikelihood(BODY, sigma_px=3.0, cameras=["side"], loss_scale=2.0)
    side = next(one for one in seen.keypoints if one.camera.name == "side")
    equal(
        likelihood.residual_function(seen)(pose),
        keypoint_residual(SKELETON, side.camera, side.joints, side.marks, 3.0)(pose),
    )
    assert likelihood.residual_loss == Loss("geman_mcclure", 2.0)
    assert KeypointLikelihood(BODY).residual_function(seen)(pose)[0].shape == (2 * 2 * 15,)
    assert isinstance(likelihood, ResidualLikelihood)


def test_a_frame_that_shows_nothing_has_no_residuals():
    nothing = Observed(np.empty((0, 3)))
    for likelihood in both().values():
        misses, slopes = likelihood.residual_function(nothing)(np.zeros(25))
        assert misses.shape == (0,)
        assert slopes.shape == (0, 25)


def test_terms_with_one_loss_are_stacked_as_they_are(scene):
    seen, pose = scene
    terms = both()
    apart = [term.residual_function(seen)(pose) for term in terms.values()]
    equal(
        Product(terms, EVEN).residual_function(seen)(pose), [np.concatenate(part) for part in zip(*apart, strict=True)]
    )
    assert Product(terms, EVEN).residual_loss == Loss("geman_mcclure", 1.5)


@pytest.mark.parametrize(("loss", "weight"), [("huber", 1.0), ("geman_mcclure", 0.5), ("huber", 0.25)])
def test_the_cost_of_a_product_is_the_sum_of_its_terms_losses_times_their_weights(scene, loss, weight):
    seen, pose = scene
    terms, weights = both(loss=loss), {"points": 1.0, "keypoints": weight}
    product = Product(terms, weights)
    expected = sum(
        weights[name] * term.residual_loss(term.residual_function(seen)(pose)[0])[0].sum()
        for name, term in terms.items()
    )
    misses, slopes = product.residual_function(seen)(pose)
    assert product.residual_loss(misses)[0].sum() == pytest.approx(expected, rel=1e-12)
    own = robust(terms["keypoints"].residual_function(seen), terms["keypoints"].residual_loss)(pose)
    np.testing.assert_allclose(slopes[40:], np.sqrt(weight) * own[1])


def test_a_product_looks_at_all_that_its_terms_look_at():
    front, side = (
        KeypointLikelihood(BODY, sigma_px=sigma_px, cameras=[camera.name])
        for sigma_px, camera in zip((2.0, 3.0), CAMERAS, strict=True)
    )
    assert Product({"a": front, "b": side}, {"a": 1.0, "b": 1.0}).observables == Observables(
        sigma_px=2.0, cameras=("front", "side")
    )
    every = {"a": front, "b": KeypointLikelihood(BODY), "c": SurfacePoints(BODY, sigma=0.01)}
    assert Product(every, dict.fromkeys(every, 1.0)).observables == Observables(
        sigma=0.01, sigma_px=2.0, common_bias_std_m=0.012
    )


def test_a_term_without_residuals_is_named():
    terms = {**both(), "colour": Uniform()}
    with pytest.raises(InputError, match="least squares needs residuals of every term of a product, colour has none"):
        _ = Product(terms, {**EVEN, "colour": 0.5}).residual_terms
    assert set(Product(terms, {**EVEN, "colour": 0.0}).residual_terms) == {"points", "keypoints"}
