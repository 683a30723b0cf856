"""The residuals of likelihoods and of their product."""

import numpy as np
import pytest
from keypoint_scenes import BODY
from view_scenes import CAMERAS, frames, swinging

from workbench.body.surface import person_surface
from workbench.core.capabilities import RESIDUALS
from workbench.core.losses import Loss
from workbench.core.observations import Observables, Observed, observe
from workbench.core.residual import keypoint_residual, robust, surface_residual
from workbench.likelihoods.keypoints import KeypointLikelihood
from workbench.likelihoods.product import Product
from workbench.likelihoods.surface_points import SurfacePoints
from workbench.likelihoods.uniform import Uniform

SKELETON = BODY.skeleton
UNIT_WEIGHTS = {"points": 1.0, "keypoints": 1.0}


@pytest.fixture(scope="module")
def scene():
    """The observations of one frame, and a pose near the true one."""
    times, poses = swinging(SKELETON, 1)
    (observed,), _ = observe(frames(SKELETON, times, poses, sigma_px=2.0), SKELETON, 100, np.random.default_rng(0))
    cloud = poses[0, :3] + 0.2 * np.random.default_rng(1).standard_normal((40, 3))
    return Observed(cloud, observed.keypoints), poses[0] + 0.02


def terms_of_both(**keypoints):
    return {"points": SurfacePoints(BODY), "keypoints": KeypointLikelihood(BODY, **keypoints)}


def assert_equal(computed, expected):
    for a, b in zip(computed, expected, strict=True):
        np.testing.assert_array_equal(a, b)


def test_residuals_of_points_are_whitened(scene):
    observed, pose = scene
    likelihood = SurfacePoints(BODY, sigma=0.04, residual="field", loss="huber", loss_scale=0.1)
    assert_equal(
        likelihood.residual_function(observed)(pose),
        surface_residual(SKELETON, person_surface(BODY), observed.points, "field", 0.04)(pose),
    )
    assert likelihood.residual_loss == Loss("huber", 2.5)
    assert likelihood.observables == Observables(sigma=0.04, residual="field", common_bias_std_m=0.012)


def test_a_keypoint_of_four_times_the_weight_is_four_equal_keypoints(scene):
    """The cost, its gradient and its Gauss–Newton matrix are equal: weights divide the variance."""
    observed, pose = scene
    view = observed.keypoints[0]
    joints, marks = view.joints[:1], view.detections[:1].copy()

    def model(joints, marks):
        residuals, jacobian = keypoint_residual(SKELETON, view.camera, joints, marks, 3.0)(pose)
        return residuals @ residuals, jacobian.T @ residuals, jacobian.T @ jacobian

    marks[0, 2] = 0.2
    four_keypoints = model(np.repeat(joints, 4), np.repeat(marks, 4, axis=0))
    marks[0, 2] = 0.8
    for a, b in zip(model(joints, marks), four_keypoints, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12)


def test_residuals_of_keypoints_are_those_of_the_chosen_cameras(scene):
    observed, pose = scene
    likelihood = KeypointLikelihood(BODY, sigma_px=3.0, cameras=["side"], loss_scale=2.0)
    side = next(view for view in observed.keypoints if view.camera.name == "side")
    assert_equal(
        likelihood.residual_function(observed)(pose),
        keypoint_residual(SKELETON, side.camera, side.joints, side.detections, 3.0)(pose),
    )
    assert likelihood.residual_loss == Loss("geman_mcclure", 2.0)
    assert KeypointLikelihood(BODY).residual_function(observed)(pose)[0].shape == (2 * 2 * 15,)


def test_a_frame_without_observations_has_no_residuals():
    empty = Observed(np.empty((0, 3)))
    for likelihood in terms_of_both().values():
        residuals, jacobian = likelihood.residual_function(empty)(np.zeros(25))
        assert residuals.shape == (0,)
        assert jacobian.shape == (0, 25)


def test_residuals_of_terms_with_one_loss_are_concatenated(scene):
    observed, pose = scene
    terms = terms_of_both()
    separate = [term.residual_function(observed)(pose) for term in terms.values()]
    assert_equal(
        Product(terms, UNIT_WEIGHTS).residual_function(observed)(pose),
        [np.concatenate(part) for part in zip(*separate, strict=True)],
    )
    assert Product(terms, UNIT_WEIGHTS).residual_loss == Loss("geman_mcclure", 1.5)


@pytest.mark.parametrize(("loss", "weight"), [("huber", 1.0), ("geman_mcclure", 0.5), ("huber", 0.25)])
def test_the_cost_of_a_product_is_the_weighted_sum_of_its_losses(scene, loss, weight):
    observed, pose = scene
    terms, weights = terms_of_both(loss=loss), {"points": 1.0, "keypoints": weight}
    product = Product(terms, weights)
    expected = sum(
        weights[name] * term.residual_loss(term.residual_function(observed)(pose)[0])[0].sum()
        for name, term in terms.items()
    )
    residuals, jacobian = product.residual_function(observed)(pose)
    assert product.residual_loss(residuals)[0].sum() == pytest.approx(expected, rel=1e-12)
    robust_residuals = robust(terms["keypoints"].residual_function(observed), terms["keypoints"].residual_loss)(pose)
    np.testing.assert_allclose(jacobian[40:], np.sqrt(weight) * robust_residuals[1])


def test_a_product_has_the_observables_of_its_terms():
    front, side = (
        KeypointLikelihood(BODY, sigma_px=sigma_px, cameras=[camera.name])
        for sigma_px, camera in zip((2.0, 3.0), CAMERAS, strict=True)
    )
    two = Product({"a": front, "b": side}, {"a": 1.0, "b": 1.0})
    assert two.observables == Observables(sigma_px=2.0, cameras=("front", "side"))
    terms = {"a": front, "b": KeypointLikelihood(BODY), "c": SurfacePoints(BODY, sigma=0.01)}
    three = Product(terms, dict.fromkeys(terms, 1.0))
    assert three.observables == Observables(sigma=0.01, sigma_px=2.0, common_bias_std_m=0.012)


def test_a_product_has_residuals_if_all_terms_with_a_weight_have_some():
    traits = {"points": SurfacePoints.traits, "colour": Uniform.traits}
    for weight in (0.0, 0.5):
        provided = Product.traits({"terms": traits, "weights": {"points": 1.0, "colour": weight}}).provides
        assert (RESIDUALS in provided) == (weight == 0.0)
    terms = {**terms_of_both(), "colour": Uniform()}
    assert set(Product(terms, {**UNIT_WEIGHTS, "colour": 0.0}).residual_terms) == {"points", "keypoints"}
