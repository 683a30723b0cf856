"""The likelihood of surface points against the mixture density of their distances."""

import numpy as np
import pytest
from likelihood_scenes import log_prob, notes

from workbench.body.kinematics import forward
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.surface import attach, person_surface, residuals
from workbench.core.frame import Frame
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.likelihoods.keypoints import KeypointLikelihood
from workbench.likelihoods.product import Product
from workbench.likelihoods.surface_points import SurfacePoints

BODY = person(from_height(1.75))


def poses(n, spread=0.1, seed=0):
    return spread * np.random.default_rng(seed).standard_normal((n, 25))


def frame(points):
    return Frame(1, 0.1, (), points=points)


def points_on(pose, n=50, seed=1):
    """Return points at the joints with noise of 8 cm."""
    frames = forward(BODY.skeleton, pose[None])
    rng = np.random.default_rng(seed)
    return frames.positions[0][rng.integers(15, size=n)] + 0.08 * rng.standard_normal((n, 3))


@pytest.mark.parametrize("sharpness", [2.0, 0.5])
def test_the_log_likelihood_is_the_sum_of_mixture_log_densities(sharpness):
    candidates, points = poses(4), points_on(poses(1)[0])
    likelihood = SurfacePoints(BODY, sigma=0.03, outlier_fraction=0.2, likelihood_power=0.4, sharpness=sharpness)
    log_probs = log_prob(likelihood, frame(None), frame(points), candidates, candidates)
    surface = person_surface(BODY, sharpness)
    for pose, value in zip(candidates, log_probs, strict=True):
        parts = attach(surface, forward(BODY.skeleton, pose[None]), points)
        distances = residuals(BODY.skeleton, surface, pose, points, "distance", parts)
        density = 0.8 * np.exp(-(distances**2) / (2 * 0.03**2)) / (np.sqrt(2 * np.pi) * 0.03) + 0.2 / 2.0
        assert value == pytest.approx(0.4 * np.log(density).sum(), rel=1e-12)


def test_least_squares_fits_the_surface_of_the_likelihood():
    points = SurfacePoints(BODY, sharpness=0.5)
    both = Product({"points": points, "keypoints": KeypointLikelihood(BODY)}, {"points": 1.0, "keypoints": 1.0})
    assert [LeastSquares(BODY, likelihood).surface.sharpness for likelihood in (points, both)] == [0.5, 0.5]


def test_the_maximum_is_the_true_pose():
    truth = poses(1)[0]
    surface = person_surface(BODY)
    cloud = points_on(truth, 3000)
    parts = attach(surface, forward(BODY.skeleton, truth[None]), cloud)
    surface_points = cloud[np.abs(residuals(BODY.skeleton, surface, truth, cloud, "distance", parts)) < 0.003]
    assert len(surface_points) > 50
    candidates = np.vstack([truth, truth + 0.05 * np.random.default_rng(3).standard_normal((30, 25))])
    log_probs = log_prob(SurfacePoints(BODY), frame(None), frame(surface_points), candidates, candidates)
    assert log_probs.argmax() == 0


def test_points_that_are_not_finite_are_omitted_with_a_note():
    likelihood, points = SurfacePoints(BODY), points_on(poses(1)[0])
    with_nan = points.copy()
    with_nan[3] = np.nan
    candidates = poses(3)
    expected = log_prob(likelihood, frame(None), frame(np.delete(points, 3, axis=0)), candidates, candidates)
    assert notes(likelihood, frame(None), frame(points), candidates, candidates) == ()
    np.testing.assert_array_equal(log_prob(likelihood, frame(None), frame(with_nan), candidates, candidates), expected)
    messages = notes(likelihood, frame(None), frame(with_nan), candidates, candidates)
    assert messages == ("frame 1: 1 of 50 points are not finite; omitted",)
    candidates[1, 4] = np.inf
    assert log_prob(likelihood, frame(None), frame(points), candidates, candidates)[1] == -np.inf


@pytest.mark.parametrize("points", [None, np.empty((0, 3))])
def test_a_frame_without_points_has_a_uniform_likelihood(points):
    likelihood = SurfacePoints(BODY)
    assert (log_prob(likelihood, frame(None), frame(points), poses(3), poses(3)) == 0.0).all()
    assert likelihood.prepare(None, frame(points)).notes == ("frame 1: no points",)
